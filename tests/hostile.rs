//! Hostile captures: texts that want to be markup, headers that want memory, and what must not leave the machine.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use tempfile::TempDir;

const SIMULATE: &str = "format = 1\nname = \"small\"\nseed = 1\nchannels = [\"R\", \"G\", \"B\"]\n[object]\nshape = \"cylinder\"\nradius = 0.05\n\
    [camera]\nimage_size = [96, 16]\nfocal_px = 480\ndistance = 0.6\n[views]\ncount = 6\norbit_step_deg = 60\n\
    [brdf]\nmodel = \"phong\"\ndiffuse = [0.30, 0.22, 0.15]\nspecular = 0.4\nexponent = 8\n\
    [lighting]\nsources = [{ theta_deg = 37.3, irradiance = [3.0, 2.9, 2.7] }]\nuniform = 0.05\n[sensor]\nformat = \"png\"\nbits = 16\n";

fn flatlight(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_flatlight"))
        .args(arguments)
        .output()
        .expect("starts")
}

fn shown(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

fn set() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let recipe = folder.path().join("simulate.toml");
    std::fs::write(&recipe, SIMULATE).expect("writes");
    let set = folder.path().join("set");
    let output = flatlight(&["simulate", shown(&recipe), "--out", shown(&set)]);
    assert!(output.status.success(), "{output:?}");
    (folder, set)
}

/// Texts that would run, load or break out if they reached a page as they are.
const TEXTS: [&str; 4] = [
    "<script>alert(1)</script>",
    "\"><img src=x onerror=alert(2)>",
    "</script><svg onload=alert(3)>",
    "'--><iframe src=javascript:alert(4)>",
];

fn in_toml(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// An EXIF block with a date that is markup, a place, a maker and an owner.
fn exif() -> Vec<u8> {
    use exif::experimental::Writer;
    use exif::{Field, In, Rational, Tag, Value};
    let field = |tag, value| Field {
        tag,
        ifd_num: In::PRIMARY,
        value,
    };
    let text = |text: &str| Value::Ascii(vec![text.as_bytes().to_vec()]);
    let fields = [
        field(Tag::DateTimeOriginal, text("<script>alert(5)</script>")),
        field(Tag::Make, text("SECRETMAKER")),
        field(Tag::Artist, text("SECRETARTIST")),
        field(Tag::Copyright, text("SECRETOWNER")),
        field(Tag::GPSLatitudeRef, text("N")),
        field(
            Tag::GPSLatitude,
            Value::Rational([48, 51, 30].map(|num| Rational { num, denom: 1 }).to_vec()),
        ),
        field(
            Tag::GPSAreaInformation,
            Value::Undefined(b"ASCII\0\0\0SECRETPLACE".to_vec(), 0),
        ),
        field(
            Tag::ExposureTime,
            Value::Rational(vec![Rational { num: 1, denom: 1 }]),
        ),
    ];
    let mut writer = Writer::new();
    fields.iter().for_each(|f| writer.push_field(f));
    let mut block = std::io::Cursor::new(Vec::new());
    writer.write(&mut block, true).expect("encodes");
    block.into_inner()
}

/// Puts an `eXIf` chunk and a text chunk into a PNG, after its header.
fn tagged(png: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let mut body = kind.to_vec();
        body.extend(data);
        let crc = !body.iter().fold(!0_u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                (crc >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(crc & 1))
            })
        });
        let mut chunk = (data.len() as u32).to_be_bytes().to_vec();
        chunk.extend(body);
        chunk.extend(crc.to_be_bytes());
        chunk
    };
    let mut out = png[..33].to_vec();
    out.extend(chunk(b"eXIf", &exif()));
    out.extend(chunk(b"tEXt", b"Author\0SECRETAUTHOR"));
    out.extend(&png[33..]);
    out
}

#[test]
fn no_text_of_a_capture_becomes_markup_and_nothing_private_gets_into_a_product() {
    let (folder, set) = set();
    let mut text = std::fs::read_to_string(set.join("capture.toml")).expect("reads");
    text = text.replace("name = \"small\"", &format!("name = {}", in_toml(TEXTS[0])));
    for (view, hostile) in TEXTS.iter().enumerate() {
        // A slash ends a name.
        let name = format!("{}.png", hostile.replace('/', "∕"));
        let photo = std::fs::read(set.join(format!("views/00{view}.png"))).expect("reads");
        std::fs::write(set.join("views").join(&name), tagged(&photo)).expect("writes");
        let old = format!("\"views/00{view}.png\"");
        text = text.replace(&old, &in_toml(&format!("views/{name}")));
    }
    std::fs::write(set.join("capture.toml"), text).expect("writes");
    let recipe = std::fs::read_to_string(set.join("recipe.toml")).expect("reads");
    let title = format!(
        "{recipe}\n[report]\ntitle = {}\n",
        in_toml(&TEXTS.join(" "))
    );
    std::fs::write(set.join("recipe.toml"), title).expect("writes");

    let out = folder.path().join("out");
    let recipe = set.join("recipe.toml");
    let output = flatlight(&[
        "run",
        shown(&recipe),
        "--capture",
        shown(&set),
        "--out",
        shown(&out),
    ]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );

    let page = std::fs::read_to_string(out.join("report.html")).expect("reads");
    for live in [
        "<script>alert",
        "<img src=x",
        "<svg onload",
        "<iframe",
        "</script><svg",
        "-->",
    ] {
        assert!(!page.contains(live), "{live} is in the page as it is");
    }
    assert!(page.contains("alert(1)"), "the texts are shown");

    let mut secrets: Vec<String> = [
        "SECRETMAKER",
        "SECRETARTIST",
        "SECRETOWNER",
        "SECRETPLACE",
        "SECRETAUTHOR",
        "GPSLatitude",
    ]
    .map(String::from)
    .to_vec();
    secrets.push(shown(folder.path()).to_string());
    for variable in ["HOME", "USER", "LOGNAME", "HOSTNAME"] {
        // A short name turns up in compressed bytes by chance.
        secrets.extend(std::env::var(variable).ok().filter(|v| v.len() > 4));
    }
    let mut products = 0;
    for entry in std::fs::read_dir(&out).expect("the products") {
        let path = entry.expect("an entry").path();
        let bytes = std::fs::read(&path).expect("reads");
        products += 1;
        for secret in &secrets {
            let found = bytes.windows(secret.len()).any(|w| w == secret.as_bytes());
            assert!(!found, "{secret} is in {}", path.display());
        }
    }
    assert!(products > 8, "{products} products");
}

/// 100 kilobytes that declare 100,000 x 100,000 pixels, in every format: refused by what the header says. The limit on the
/// address space holds the program's own 76 MB (with debug information), its threads' stacks, and none of the 40 GB.
#[test]
#[cfg(target_os = "linux")]
fn declared_sizes_cost_neither_time_nor_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, bytes) in giants() {
        let photo = folder.path().join(name);
        std::fs::write(&photo, bytes).expect("writes");
        let start = Instant::now();
        let error = flatlight::photo::read(&photo, None)
            .expect_err(name)
            .to_string();
        let rows = flatlight::photo::read(&photo, Some(0..100));
        let seconds = start.elapsed().as_secs_f64();
        assert!(error.contains(name), "{error}");
        assert!(rows.is_err(), "{name}");
        assert!(seconds < 0.2, "{name}: {seconds} s for two refusals");

        let set = folder.path().join(format!("set-{name}"));
        std::fs::create_dir(&set).expect("a folder");
        std::fs::rename(&photo, set.join(name)).expect("moves");
        let text = format!(
            "[object]\nshape = \"cylinder\"\nradius = 0.05\n[camera]\nfocal_px = 480\ndistance = 0.6\nimage_size = [100000, 100000]\n\
             [[view]]\norbit_deg = 0\nfile = \"{name}\"\nexposure_s = 1\n"
        );
        std::fs::write(set.join("capture.toml"), text).expect("writes");
        std::fs::write(set.join("recipe.toml"), "recover = \"none\"\n").expect("writes");
        let script = "ulimit -v 400000; exec \"$0\" run \"$1/recipe.toml\" --capture \"$1\" --out \"$1/out\" --threads 1";
        let output = Command::new("sh")
            .args(["-c", script, env!("CARGO_BIN_EXE_flatlight"), shown(&set)])
            .output()
            .expect("starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{name}: {said}");
        assert!(said.contains(name), "{said}");
        let output = flatlight(&["check", shown(&set)]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "check, {name}: {said}");
        assert!(said.contains("bytes can hold"), "check, {name}: {said}");
    }
}

/// Two dozen such photos on all threads cost no more: no thread allocates for what a header declares. Beside the threads' stacks, 2 MB
/// each, the limit on the address space holds the program and 100 MB.
#[test]
#[cfg(target_os = "linux")]
fn many_declared_sizes_cost_no_more() {
    for (name, bytes) in giants() {
        let set = tempfile::tempdir().expect("a folder");
        let mut text = "[object]\nshape = \"cylinder\"\nradius = 0.05\n[camera]\nfocal_px = 480\ndistance = 0.6\nimage_size = [100000, 100000]\n".to_owned();
        for view in 0..24 {
            let file = format!("{view}{name}");
            std::fs::write(set.path().join(&file), &bytes).expect("writes");
            text += &format!(
                "[[view]]\norbit_deg = {}\nfile = \"{file}\"\nexposure_s = 1\n",
                15 * view
            );
        }
        std::fs::write(set.path().join("capture.toml"), text).expect("writes");
        std::fs::write(set.path().join("recipe.toml"), "recover = \"none\"\n").expect("writes");
        let script = "ulimit -v 600000; exec \"$0\" run \"$1/recipe.toml\" --capture \"$1\" --out \"$1/out\" --threads 4";
        let output = Command::new("sh")
            .args([
                "-c",
                script,
                env!("CARGO_BIN_EXE_flatlight"),
                shown(set.path()),
            ])
            .output()
            .expect("starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{name}: {said}");
        assert!(said.contains("bytes can hold"), "{name}: {said}");
        assert!(!set.path().join("out").exists(), "{name}");
    }
}

/// Headers of 100,000 x 100,000 pixels, filled up to 100 kilobytes.
fn giants() -> Vec<(&'static str, Vec<u8>)> {
    let mut exr = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let attribute = |out: &mut Vec<u8>, name: &str, kind: &str, value: &[u8]| {
        out.extend(name.as_bytes());
        out.push(0);
        out.extend(kind.as_bytes());
        out.push(0);
        out.extend((value.len() as u32).to_le_bytes());
        out.extend(value);
    };
    let window: Vec<u8> = [0_i32, 0, 99_999, 99_999]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let mut channels = b"Y\0".to_vec();
    channels.extend([2, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0]);
    attribute(&mut exr, "channels", "chlist", &channels);
    attribute(&mut exr, "compression", "compression", &[0]);
    attribute(&mut exr, "dataWindow", "box2i", &window);
    attribute(&mut exr, "displayWindow", "box2i", &window);
    attribute(&mut exr, "lineOrder", "lineOrder", &[0]);
    attribute(&mut exr, "pixelAspectRatio", "float", &1_f32.to_le_bytes());
    attribute(&mut exr, "screenWindowCenter", "v2f", &[0; 8]);
    attribute(&mut exr, "screenWindowWidth", "float", &1_f32.to_le_bytes());
    exr.push(0);

    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    let entries: [(u16, u16, u32, u32); 9] = [
        (256, 4, 1, 100_000),
        (257, 4, 1, 100_000),
        (258, 3, 1, 8),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (273, 4, 1, 200),
        (277, 3, 1, 1),
        (278, 4, 1, 100_000),
        (279, 4, 1, 99_000),
    ];
    tiff.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        tiff.extend(tag.to_le_bytes());
        tiff.extend(kind.to_le_bytes());
        tiff.extend(count.to_le_bytes());
        tiff.extend(value.to_le_bytes());
    }
    tiff.extend([0; 4]);

    let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n".to_vec();

    let seed = |name: &str| {
        let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds");
        std::fs::read(seeds.join(name)).expect("a seed")
    };
    let mut png = seed("photo_png/rgb8.png");
    png[16..24].copy_from_slice(&[0, 1, 0x86, 0xa0, 0, 1, 0x86, 0xa0]);
    let crc = !png[12..29].iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(crc & 1))
        })
    });
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    // A JPEG cannot declare more than 65,535.
    let mut jpeg = seed("photo_jpeg/rgb.jpg");
    let frame = jpeg
        .windows(2)
        .position(|w| w == [0xff, 0xc0])
        .expect("a frame");
    jpeg[frame + 5..frame + 9].fill(0xff);
    [
        ("a.exr", exr),
        ("a.tif", tiff),
        ("a.hdr", hdr),
        ("a.png", png),
        ("a.jpg", jpeg),
    ]
    .map(|(name, mut bytes)| {
        bytes.resize(100_000, 0);
        (name, bytes)
    })
    .to_vec()
}

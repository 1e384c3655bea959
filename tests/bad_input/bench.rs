//! Sound capture sets to spoil, and the program to run on them.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use tempfile::TempDir;

/// What the sound sets are simulated from: twelve views of a dull cylinder under a sun and a fill, a tenth of a second's work.
const RECIPE: &str = r#"
format = 1
name = "small"
seed = 1
channels = ["R", "G", "B"]
[object]
shape = "cylinder"
radius = 0.05
[camera]
projection = "perspective"
image_size = [96, 16]
focal_px = 480
distance = 0.6
[views]
count = 12
orbit_step_deg = 30.0
[brdf]
model = "phong"
diffuse = [0.30, 0.22, 0.15]
specular = [0.40, 0.40, 0.38]
exponent = 8
[lighting]
sources = [{ theta_deg = 37.3, irradiance = [3.0, 2.9, 2.7] }]
uniform = [0.04, 0.045, 0.055]
[sensor]
"#;

/// Views of a set.
pub(crate) const VIEWS: usize = 12;

/// The file formats of photos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Exr,
    Png,
    Tiff,
    Jpeg,
    Hdr,
}

impl Format {
    pub const ALL: [Self; 5] = [Self::Exr, Self::Png, Self::Tiff, Self::Jpeg, Self::Hdr];

    pub(crate) fn ending(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Png => "png",
            Self::Tiff => "tif",
            Self::Jpeg => "jpg",
            Self::Hdr => "hdr",
        }
    }
}

/// A sound set of each format: EXR and PNG as simulated, the others made of the PNGs' pixels.
static SOUND: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, sensor) in [
        ("exr", "format = \"exr-float\""),
        ("png", "format = \"png\"\nbits = 16"),
    ] {
        let recipe = folder.path().join(format!("{name}.toml"));
        std::fs::write(&recipe, format!("{RECIPE}{sensor}\n")).expect("writes");
        let output = flatlight(&[
            "simulate",
            shown(&recipe),
            "--out",
            shown(&folder.path().join(name)),
        ]);
        assert_eq!(output.code, 0, "{}", output.said);
    }
    for format in [Format::Tiff, Format::Jpeg, Format::Hdr] {
        convert(folder.path(), format);
    }
    folder
});

/// The PNG set in another format; float TIFF and HDR hold values up to 1, JPEG 8 bits.
fn convert(folder: &Path, format: Format) {
    let (from, to) = (folder.join("png"), folder.join(format.ending()));
    std::fs::create_dir_all(to.join("views")).expect("a folder");
    for view in 0..VIEWS {
        let pixels = image::open(from.join(format!("views/{view:03}.png"))).expect("reads");
        let file = to.join(format!("views/{view:03}.{}", format.ending()));
        match format {
            Format::Tiff | Format::Hdr => pixels.into_rgb32f().save(file),
            _ => pixels.into_rgb8().save(file),
        }
        .expect("writes");
    }
    let text = std::fs::read_to_string(from.join("capture.toml")).expect("reads");
    let views = text.find("[[view]]").expect("views");
    let text = text.replace(".png", &format!(".{}", format.ending()));
    let head: String = text[..views]
        .lines()
        .filter(|line| !line.contains("_level"))
        .map(|line| format!("{line}\n"))
        .collect();
    std::fs::write(to.join("capture.toml"), head + &text[views..]).expect("writes");
    std::fs::copy(from.join("recipe.toml"), to.join("recipe.toml")).expect("copies");
}

pub(crate) fn shown(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// What the program did.
pub(crate) struct Output {
    pub(crate) code: i32,
    pub(crate) said: String,
    pub(crate) answered: String,
}

/// Runs the program.
pub(crate) fn flatlight(arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_flatlight"))
        .args(arguments)
        .env("RAYON_NUM_THREADS", "1")
        .output()
        .expect("the program starts");
    Output {
        code: output.status.code().unwrap_or(-1),
        said: String::from_utf8_lossy(&output.stderr).into_owned(),
        answered: String::from_utf8_lossy(&output.stdout).into_owned(),
    }
}

/// A copy of a sound set that may be spoilt; removed with the value.
pub(crate) struct Bench {
    folder: TempDir,
    pub(crate) format: Format,
}

impl Bench {
    pub(crate) fn new(format: Format) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let sound = SOUND.path().join(format.ending());
        let set = folder.path().join("set");
        std::fs::create_dir_all(set.join("views")).expect("a folder");
        for name in ["capture.toml", "recipe.toml"] {
            std::fs::copy(sound.join(name), set.join(name)).expect("copies");
        }
        for view in 0..VIEWS {
            let name = format!("views/{view:03}.{}", format.ending());
            std::fs::copy(sound.join(&name), set.join(&name)).expect("copies");
        }
        Self { folder, format }
    }

    /// The folder of the set.
    pub(crate) fn set(&self) -> PathBuf {
        self.folder.path().join("set")
    }

    /// Where products go; it does not exist yet.
    pub(crate) fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    /// A file of the set.
    pub(crate) fn at(&self, name: &str) -> PathBuf {
        self.set().join(name)
    }

    /// The photo of a view.
    pub(crate) fn photo(&self, view: usize) -> PathBuf {
        self.at(&format!("views/{view:03}.{}", self.format.ending()))
    }

    /// Replaces text in a file of the set, which must hold it.
    pub(crate) fn edit(&self, name: &str, from: &str, to: &str) {
        let text = std::fs::read_to_string(self.at(name)).expect("reads");
        assert!(text.contains(from), "{from:?} is in {name}:\n{text}");
        self.write(name, text.replacen(from, to, 1));
    }

    pub(crate) fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        std::fs::write(self.at(name), text).expect("writes");
    }

    /// Changes the bytes of a file of the set.
    pub(crate) fn spoil(&self, path: &Path, spoil: &dyn Fn(&mut Vec<u8>)) {
        let mut bytes = std::fs::read(path).expect("reads");
        spoil(&mut bytes);
        std::fs::write(path, bytes).expect("writes");
    }

    /// Changes the values of a float TIFF photo: `(value, x, y, channel)` to a value.
    pub(crate) fn repaint(&self, view: usize, paint: &dyn Fn(f32, u32, u32, usize) -> f32) {
        let mut pixels = image::open(self.photo(view)).expect("reads").into_rgb32f();
        for (x, y, pixel) in pixels.enumerate_pixels_mut() {
            for (c, value) in pixel.0.iter_mut().enumerate() {
                *value = paint(*value, x, y, c);
            }
        }
        pixels.save(self.photo(view)).expect("writes");
    }

    pub(crate) fn repaint_all(&self, paint: &dyn Fn(f32, u32, u32, usize) -> f32) {
        (0..VIEWS).for_each(|view| self.repaint(view, paint));
    }

    pub(crate) fn run(&self, more: &[&str]) -> Output {
        let (recipe, set, out) = (self.at("recipe.toml"), self.set(), self.out());
        let mut arguments = vec![
            "run",
            shown(&recipe),
            "--capture",
            shown(&set),
            "--out",
            shown(&out),
        ];
        arguments.extend(more);
        flatlight(&arguments)
    }
}

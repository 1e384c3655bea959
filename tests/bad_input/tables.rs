//! Tables and maps that a recipe or a description names.

use crate::bench::Bench;
use crate::{Case, bench::Format};

fn brdf(
    what: &'static str,
    table: impl Fn() -> String + Send + Sync + 'static,
    words: &[&str],
) -> Case {
    let mut all = vec!["brdf.csv"];
    all.extend(words);
    let spoil = move |b: &Bench| {
        b.write("brdf.csv", table());
        b.write(
            "recipe.toml",
            "recover = \"lighting\"\n[brdf]\ntable = \"brdf.csv\"\n",
        );
    };
    Case::new(format!("brdf.csv: {what}"), spoil, &all)
}

fn lighting(
    what: &'static str,
    table: impl Fn() -> String + Send + Sync + 'static,
    words: &[&str],
) -> Case {
    let mut all = vec!["lighting.csv"];
    all.extend(words);
    let spoil = move |b: &Bench| {
        b.write("lighting.csv", table());
        b.write(
            "recipe.toml",
            "recover = \"brdf\"\n[lighting]\ntable = \"lighting.csv\"\n",
        );
    };
    Case::new(format!("lighting.csv: {what}"), spoil, &all)
}

fn response(what: &'static str, table: &'static str, words: &[&str]) -> Case {
    let mut all = vec!["curve.csv"];
    all.extend(words);
    let spoil = move |b: &Bench| {
        b.write("curve.csv", table);
        let text = std::fs::read_to_string(b.at("capture.toml")).expect("reads");
        let text = text.replace("encoding = \"linear\"", "encoding = \"response:curve.csv\"");
        b.write("capture.toml", text);
    };
    Case::new(format!("response: {what}"), spoil, &all).of(Format::Png)
}

fn map(what: &'static str, name: &'static str, bytes: &'static [u8], words: &[&str]) -> Case {
    let mut all = vec![name];
    all.extend(words);
    let spoil = move |b: &Bench| {
        b.write(name, bytes);
        b.write(
            "recipe.toml",
            format!("recover = \"brdf\"\n[lighting]\nenvironment = \"{name}\"\n"),
        );
    };
    Case::new(format!("environment: {what}"), spoil, &all)
}

/// A table of ρ every 30° with some lines changed.
fn slice(header: &str, line: impl Fn(i32, i32) -> String) -> String {
    let mut text = format!("{header}\n");
    for i in 0..7 {
        for j in 0..7 {
            text += &line(30 * i - 90, 30 * j - 90);
        }
    }
    text
}

fn grey(a: i32, b: i32) -> String {
    format!("{a},{b},0.2\n")
}

/// Light every 30°.
fn circle(line: impl Fn(i32) -> String) -> String {
    (0..12).fold("theta_deg,L_Y\n".to_string(), |text, k| {
        text + &line(30 * k - 180)
    })
}

pub(crate) fn cases() -> Vec<Case> {
    const RHO: &str = "theta_i_deg,theta_o_deg,rho_Y";
    vec![
        brdf(
            "empty",
            String::new,
            &["expected a header line, found an empty file"],
        ),
        brdf(
            "only a header",
            || format!("{RHO}\n"),
            &["theta_i_deg", "equal steps from −90 to 90"],
        ),
        brdf(
            "a hole and its mirror image",
            || {
                slice(RHO, |a, b| {
                    if (a, b) == (30, -60)
                        || (a, b) == (-60, 30)
                        || (a, b) == (-30, 60)
                        || (a, b) == (60, -30)
                    {
                        format!("{a},{b},\n")
                    } else {
                        grey(a, b)
                    }
                })
            },
            &[
                "a value in every cell, or in its mirrored one",
                "4 of 49",
                "θi′ = -60°, θo′ = 30°",
            ],
        ),
        brdf(
            "a column unknown",
            || slice("theta_i_deg,theta_o_deg,reflectance", grey),
            &[":1, rho_Y", "expected a column rho_Y"],
        ),
        brdf(
            "a column twice",
            || {
                slice("theta_i_deg,theta_o_deg,rho_Y,rho_Y", |a, b| {
                    format!("{a},{b},1,1\n")
                })
            },
            &[":1, rho_Y", "twice"],
        ),
        brdf(
            "σ of a channel that is not there",
            || {
                slice("theta_i_deg,theta_o_deg,rho_Y,sigma_R", |a, b| {
                    format!("{a},{b},1,1\n")
                })
            },
            &["sigma"],
        ),
        brdf(
            "a word for a number",
            || {
                slice(RHO, |a, b| {
                    if a == 0 && b == 0 {
                        "0,0,bright\n".into()
                    } else {
                        grey(a, b)
                    }
                })
            },
            &[":26", "finite number", "\"bright\""],
        ),
        brdf(
            "a number that is none",
            || {
                slice(RHO, |a, b| {
                    if a == 0 && b == 0 {
                        "0,0,nan\n".into()
                    } else {
                        grey(a, b)
                    }
                })
            },
            &[":26", "\"nan\""],
        ),
        brdf(
            "a field too few",
            || {
                slice(RHO, |a, b| {
                    if a == 0 && b == 0 {
                        "0,0\n".into()
                    } else {
                        grey(a, b)
                    }
                })
            },
            &[":26", "expected 3 fields, found 2"],
        ),
        brdf(
            "an angle twice",
            || slice(RHO, grey) + "0,0,0.3\n",
            &[":51", "0°, 0° again (first in line 26)"],
        ),
        brdf(
            "angles beyond the horizon",
            || slice(RHO, |a, b| format!("{},{b},1\n", 2 * a)),
            &["angle in −90 to 90", "-180"],
        ),
        brdf(
            "uneven angles",
            || {
                slice(RHO, |a, b| {
                    format!("{},{b},1\n", if a == 30 { 31 } else { a })
                })
            },
            &["theta_i_deg", "equal steps"],
        ),
        brdf(
            "negative reflection",
            || slice(RHO, |a, b| format!("{a},{b},-1\n")),
            &["negative"],
        ),
        brdf(
            "channels that are not the photos'",
            || {
                slice("theta_i_deg,theta_o_deg,rho_X,rho_Z", |a, b| {
                    format!("{a},{b},1,1\n")
                })
            },
            &["rho_R", "X, Z"],
        ),
        brdf(
            "no light reflected",
            || slice(RHO, |a, b| format!("{a},{b},0\n")),
            &["reflects no light"],
        ),
        brdf("bytes", || "\u{0}\u{1}\u{2}".into(), &["theta_i_deg"]),
        lighting("empty", String::new, &["empty file"]),
        lighting(
            "only a header",
            || "theta_deg,L_Y\n".into(),
            &["only the header"],
        ),
        lighting(
            "light that does not wrap",
            || {
                circle(|a| {
                    if a > 90 {
                        String::new()
                    } else {
                        format!("{a},1\n")
                    }
                })
            },
            &["close the circle", "span 300°"],
        ),
        lighting(
            "ends that differ",
            || circle(|a| format!("{a},1\n")) + "180,2\n",
            &["-180° and 180° are the same direction", "wrap"],
        ),
        lighting(
            "uneven angles",
            || circle(|a| format!("{},1\n", if a == 0 { 1 } else { a })),
            &[":8", "regular step of 30°", "found 1"],
        ),
        lighting(
            "falling angles",
            || "theta_deg,L_Y\n0,1\n-90,1\n".into(),
            &[":3", "increasing"],
        ),
        lighting(
            "a word for a number",
            || circle(|a| format!("{a},{}\n", if a == 0 { "sun" } else { "1" })),
            &[":8, L_Y", "finite number", "\"sun\""],
        ),
        lighting(
            "an empty field",
            || circle(|a| format!("{a},{}\n", if a == 0 { "" } else { "1" })),
            &[":8, L_Y", "empty field", "write 0"],
        ),
        lighting(
            "a field too many",
            || circle(|a| format!("{a},1,1\n")),
            &[":2", "2 fields as in the header, found 3"],
        ),
        lighting(
            "a column unknown",
            || "theta_deg,light\n0,1\n".into(),
            &[":1", "\"light\""],
        ),
        lighting(
            "a column twice",
            || "theta_deg,L_Y,L_Y\n0,1,1\n".into(),
            &[":1", "L_Y stands twice"],
        ),
        lighting(
            "negative light",
            || circle(|a| format!("{a},-1\n")),
            &["negative"],
        ),
        lighting(
            "channels that are not the photos'",
            || "theta_deg,L_X,L_Z\n-180,1,1\n0,1,1\n".into(),
            &["R, G, B", "X, Z"],
        ),
        response("empty", "", &["at least two rows"]),
        response("one row", "value,linear\n0,0\n", &["at least two rows"]),
        response(
            "falling",
            "value,linear\n0,0\n100,1\n50,2\n",
            &[":4", "increase from row to row"],
        ),
        response(
            "flat",
            "value,linear\n0,0\n100,1\n200,1\n",
            &[":4", "increase"],
        ),
        response("a word", "value,linear\n0,zero\n", &[":2", "0,zero"]),
        response("infinite", "value,linear\n0,0\n1,inf\n", &[":3", "1,inf"]),
        response(
            "two channels for three",
            "value,linear_R,linear_G\n0,0,0\n65535,1,1\n",
            &["3"],
        ),
        map("empty", "sky.exr", b"", &["empty file"]),
        map("text", "sky.exr", b"blue", &["found none of them"]),
        map(
            "a PNG",
            "sky.png",
            b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
            &["PNG"],
        ),
        map(
            "an HDR without pixels",
            "sky.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n",
            &["truncated"],
        ),
        map(
            "an HDR beyond all sizes",
            "sky.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n",
            &["can hold"],
        ),
    ]
}

//! What `flatlight prefilter` says: the choice, its promise, its cost and time, as tables or as JSON.

use std::fmt::Write as _;
use std::path::Path;

use flatlight::reflect::prefilter::{Prefiltered, Ways};
use serde_json::{Value, json};

/// All that is known besides the table itself.
#[derive(Default)]
pub struct Told {
    /// What of a map the light is.
    pub light: Option<String>,
    /// Time of the prefiltering, seconds.
    pub seconds: f64,
    /// Size (pixels) and time (ms) of a rendered view.
    pub view: Option<([usize; 2], f64)>,
    /// Every way, timed and compared with brute force; the chosen one first.
    pub tried: Vec<Tried>,
    /// Cells that were compared, and the time of the angular integral for the whole table, seconds.
    pub integral: Option<(usize, f64)>,
}

/// A way that was timed and compared with brute force; empty if it cannot keep the tolerance.
pub struct Tried {
    pub ways: Ways,
    pub seconds: Option<f64>,
    /// Largest error, and its root mean square, over the level.
    pub error: Option<f64>,
    pub rms: Option<f64>,
}

impl Tried {
    pub fn refused(ways: Ways) -> Self {
        Self {
            ways,
            seconds: None,
            error: None,
            rms: None,
        }
    }
}

fn name(ways: Ways) -> &'static str {
    match ways {
        Ways::Cheapest => "cheapest per column",
        Ways::Product => "coefficients only",
        Ways::Split => "lobe by an integral",
    }
}

/// Whether the light was taken apart and computed in this way: the cheapest.
fn chosen(made: &Prefiltered, peaks: usize, ways: Ways) -> bool {
    ways == Ways::Cheapest && made.choices.first().map_or(0, |c| c.peaks) == peaks
}

impl Told {
    pub fn words(&self, made: &Prefiltered, tolerance: f64, out: &Path) -> String {
        let mut text = String::new();
        if let Some(light) = &self.light {
            let _ = writeln!(text, "{light}");
        }
        let _ = writeln!(
            text,
            "{} × {} cells, tolerance {tolerance:e} of the level (the mean light field without peaks)\n",
            made.grid.normals, made.grid.locals
        );
        channels(&mut text, made);
        ways(&mut text, made);
        self.compared(&mut text);
        let _ = writeln!(text, "prefiltered in {:.3} s", self.seconds);
        if let Some(([width, height], ms)) = self.view {
            let _ = writeln!(text, "{width} × {height} pixels rendered in {ms:.1} ms");
        }
        let _ = writeln!(text, "wrote {}", out.display());
        text
    }

    fn compared(&self, text: &mut String) {
        let Some((cells, integral)) = self.integral else {
            return;
        };
        let _ = writeln!(
            text,
            "way                    measured/s  error/level  rms/level   ({cells} random cells against brute force)"
        );
        for tried in &self.tried {
            let _ = match (tried.seconds, tried.error, tried.rms) {
                (Some(s), Some(e), Some(rms)) => {
                    writeln!(
                        text,
                        "{:<20} {s:>12.4} {e:>12.1e} {rms:>10.1e}",
                        name(tried.ways)
                    )
                }
                _ => writeln!(text, "{:<20}  cannot keep the tolerance", name(tried.ways)),
            };
        }
        let _ = writeln!(
            text,
            "{:<20} {integral:>12.4}               one term per value of the light, from those cells; {:.0} times the first\n",
            "angular integral",
            integral / self.seconds
        );
    }

    pub fn json(&self, made: &Prefiltered, tolerance: f64, out: &Path) -> Value {
        let channels: Vec<Value> = made
            .choices
            .iter()
            .map(|c| {
                let (least, most) = c.orders();
                json!({
                    "channel": c.channel, "level": c.level, "peaks": c.peaks, "peak_share": c.peak_share,
                    "least_order": least, "largest_order": most, "coefficients": c.coefficients(),
                    "lobe_columns": c.split_columns(), "bound": c.bound,
                })
            })
            .collect();
        let ways: Vec<Value> = made
            .considered
            .iter()
            .map(|w| {
                json!({
                    "peaks": w.peaks, "way": name(w.ways), "chosen": chosen(made, w.peaks, w.ways),
                    "predicted_coefficients": w.prediction.map(|p| p.coefficients),
                    "predicted_s": w.prediction.map(|p| p.cost), "bound": w.prediction.map(|p| p.bound),
                })
            })
            .collect();
        let tried: Vec<Value> = self
            .tried
            .iter()
            .map(|t| json!({ "way": name(t.ways), "measured_s": t.seconds, "error": t.error, "rms": t.rms }))
            .collect();
        json!({
            "level": "result",
            "message": format!("prefiltered in {:.3} s, wrote {}", self.seconds, out.display()),
            "light": self.light,
            "normals": made.grid.normals,
            "locals": made.grid.locals,
            "tolerance": tolerance,
            "channels": channels,
            "ways": ways,
            "measured_s": self.seconds,
            "checked": tried,
            "checked_cells": self.integral.map(|i| i.0),
            "angular_integral_s": self.integral.map(|i| i.1),
            "view_ms": self.view.map(|v| v.1),
        })
    }
}

fn channels(text: &mut String, made: &Prefiltered) {
    let _ = writeln!(
        text,
        "channel        level  peaks  their share  orders     coefficients  lobe columns  bound/level"
    );
    for choice in &made.choices {
        let (least, most) = choice.orders();
        let _ = writeln!(
            text,
            "{:<9} {:>10.4e} {:>6} {:>10.2} %  {:<9} {:>13} {:>13} {:>12.1e}",
            choice.channel,
            choice.level,
            choice.peaks,
            100.0 * choice.peak_share,
            format!("{least}–{most}"),
            choice.coefficients(),
            choice.split_columns(),
            choice.bound,
        );
    }
    text.push('\n');
}

/// The peaks and ways that were weighed against each other.
fn ways(text: &mut String, made: &Prefiltered) {
    text.push_str("peaks  way                   coefficients  predicted/s  bound/level\n");
    for way in &made.considered {
        let _ = write!(text, "{:>5}  {:<20}", way.peaks, name(way.ways));
        let _ = match way.prediction {
            Some(p) => writeln!(
                text,
                "{:>14} {:>12.4} {:>12.1e}{}",
                p.coefficients,
                p.cost,
                p.bound,
                if chosen(made, way.peaks, way.ways) {
                    "  chosen"
                } else {
                    ""
                }
            ),
            None => writeln!(text, "  cannot keep the tolerance"),
        };
    }
    text.push_str("(predicted: one core)\n\n");
}

//! The Fourier coefficients of the measured light field.

use super::{Figure, Panel, image_channels};
use crate::error::Result;
use crate::pipeline::Run;
use crate::report::plot::{
    Axis, ColourMap, HeatMap, Legend, Mark, Plot, Scale, Size, bounds, series_class,
};
use crate::report::table::{Cell, Table};

/// Root mean square over θo′ of |B_p|, with the value that noise alone would give.
pub fn magnitudes(run: &Run) -> Option<Figure> {
    let all = run
        .spectrum
        .iter()
        .flat_map(|s| s.magnitude.iter().chain(&s.noise_floor).copied());
    let last = run.spectrum.iter().map(|s| s.magnitude.len()).max()?;
    if last == 0 {
        return None;
    }
    let y = Scale::log_around(all, 9.0);
    let mut legend: Vec<Legend> = run
        .spectrum
        .iter()
        .enumerate()
        .map(|(c, s)| Legend {
            class: series_class(&s.channel, c).to_owned(),
            mark: Mark::Line,
            label: s.channel.clone(),
        })
        .collect();
    legend.push(Legend {
        class: "floor".to_owned(),
        mark: Mark::Line,
        label: "noise floor".to_owned(),
    });
    let draw = || {
        let mut plot = Plot::new(
            Size::Half,
            300.0,
            Axis::whole("frequency p", 0.0, (last - 1).max(1) as f64, 7),
            Axis::new(format!("rms |B_[p]| / {}", run.radiance_unit), y, 6),
        )
        .with_legend(legend.clone());
        for (c, s) in run.spectrum.iter().enumerate() {
            let class = series_class(&s.channel, c);
            plot.line(&points(&s.noise_floor), &format!("floor {class}"));
            plot.line(&points(&s.magnitude), class);
        }
        plot.finish(
            &format!(
                "Magnitude of the light field's Fourier coefficients against frequency 0 to {}, logarithmic, with the noise floor.",
                last - 1
            ),
            "data-curve=\"p\"",
        )
    };
    let mut columns = vec!["p".to_owned()];
    for s in &run.spectrum {
        columns.push(format!("B_{}", s.channel));
        columns.push(format!("noise_{}", s.channel));
    }
    let rows = (0..last)
        .map(|p| {
            let mut row = vec![Cell::Fixed(p as f64, 0)];
            for s in &run.spectrum {
                row.push(Cell::Number(*s.magnitude.get(p).unwrap_or(&f64::NAN)));
                row.push(Cell::Number(*s.noise_floor.get(p).unwrap_or(&f64::NAN)));
            }
            row
        })
        .collect();
    Some(Figure {
        id: "spectrum",
        title: "Spectrum of the light field",
        caption: "Root mean square over θ_[o]′ of |B_[p](θ_[o]′)|, and (dotted) the value that noise alone would give. \
                  What lies on the floor says nothing about light or material."
            .to_owned(),
        panels: vec![Panel {
            name: String::new(),
            markup: draw(),
        }],
        table: Table {
            columns,
            rows,
            note: String::new(),
        },
        wide: false,
    })
}

fn points(values: &[f64]) -> Vec<(f64, f64)> {
    values
        .iter()
        .enumerate()
        .map(|(p, v)| (p as f64, *v))
        .collect()
}

/// |B_{p,q}| as an image.
///
/// # Errors
/// If an image cannot be encoded.
pub fn coefficient_image(run: &Run) -> Result<Option<Figure>> {
    let mut panels = Vec::new();
    let mut table = Table {
        columns: ["channel", "p", "q", "magnitude"]
            .map(str::to_owned)
            .to_vec(),
        rows: Vec::new(),
        note: "Coefficients above 10⁻³ of the largest.".to_owned(),
    };
    for channel in image_channels(run.spectrum.len()) {
        let s = &run.spectrum[channel];
        let p_count = s.image.len();
        let q_count = s.image.first().map_or(0, Vec::len);
        if p_count == 0 || q_count == 0 || s.image.iter().any(|row| row.len() != q_count) {
            continue;
        }
        let q_max = q_count as f64 / 2.0;
        let half = (q_count / 2) as i64;
        // p along x, q upwards: the top row is the largest q.
        let mut values = Vec::with_capacity(p_count * q_count);
        for q in (0..q_count).rev() {
            values.extend(s.image.iter().map(|row| row[q]));
        }
        let (_, high) = bounds(values.iter().copied());
        let colours = Scale::log(high * 1e-5, high);
        for (p, row) in s.image.iter().enumerate() {
            for (q, value) in row.iter().enumerate().filter(|(_, v)| **v > 1e-3 * high) {
                table.rows.push(vec![
                    Cell::Text(s.channel.clone()),
                    Cell::Fixed(p as f64, 0),
                    Cell::Fixed((q as i64 - half) as f64, 0),
                    Cell::Number(*value),
                ]);
            }
        }
        let map = HeatMap {
            id: format!("image-coefficients-{channel}"),
            x: Axis::whole("p (along α)", -0.5, p_count as f64 - 0.5, 8),
            y: Axis::whole("q (along θ_[o]′)", -q_max, q_max, 6),
            cells: [p_count, q_count],
            values,
            colours,
            map: ColourMap::Viridis,
            label: format!("|B_[pq]| / {}", run.radiance_unit),
            height: 300.0,
            read_out: None,
        };
        let alt = format!(
            "Magnitudes of the coefficients B_pq of channel {}, logarithmic over five decades.",
            s.channel
        );
        panels.push(Panel {
            name: s.channel.clone(),
            markup: map.draw(&[Size::Half], &alt)?,
        });
    }
    Ok((!panels.is_empty()).then(|| Figure {
        id: "coefficients",
        title: "Coefficients B_[pq]",
        caption: "Magnitudes over both frequencies, logarithmic. A glossy lobe about the mirror direction keeps the energy near the line q = −p; \
                  where a column is dark, that frequency of the light is lost."
            .to_owned(),
        panels,
        table,
        wide: false,
    }))
}

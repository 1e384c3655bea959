//! The figures of the report, one function each; the page orders them.
//!
//! A figure is one or more panels (one per channel, switched by buttons that need no script), a
//! caption, and the table of its data.

mod brdf;
mod brdf_cuts;
mod coverage;
mod factorisation;
mod light_field;
pub mod lighting_curve;
mod lighting_polar;
mod lighting_spectrum;
mod photos;
mod regularisation;
mod residual;
mod setup;
mod spectrum;

pub use brdf::{brdf_image, brdf_sigma, brdf_status};
pub use brdf_cuts::brdf_cuts;
pub use coverage::coverage;
pub use factorisation::{eigenvalues, ways_compared};
pub use light_field::{light_field, sigma};
pub use lighting_curve::lighting_curve;
pub use lighting_polar::lighting_polar;
pub use lighting_spectrum::lighting_spectrum;
pub use photos::photos;
pub use regularisation::regularisation;
pub use residual::{residual_histogram, residual_image};
pub use setup::setup;
pub use spectrum::{coefficient_image, magnitudes};

use super::plot::{Axis, Size, escape, html_text};
use super::table::{Cell, Table};
use crate::light_field::LightField;
use crate::pipeline::Run;

/// A figure, ready for the page.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Unique in the page; also the name of its CSV.
    pub id: &'static str,
    /// A few words.
    pub title: &'static str,
    /// What is shown and what to see in it.
    pub caption: String,
    /// What is drawn.
    pub panels: Vec<Panel>,
    /// The data behind it.
    pub table: Table,
    /// Whether it takes the whole width of the page.
    pub wide: bool,
}

impl Figure {
    /// Title and caption as markup.
    pub fn caption_markup(&self) -> String {
        format!(
            "<strong>{}.</strong> {}",
            html_text(self.title),
            html_text(&self.caption)
        )
    }
}

/// One drawing of a figure.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The channel's name, for the switch and the print.
    pub name: String,
    /// Markup.
    pub markup: String,
}

/// Sizes of a figure that takes the whole width.
const FULL: [Size; 2] = [Size::Wide, Size::Narrow];

/// A panel's drawings with a linear and with a logarithmic axis, of which one kind is shown; without scripts and on paper the linear one.
/// `id` is unique in the page.
fn two_scales(id: &str, linear: &str, log: &str) -> String {
    let id = escape(id);
    format!(
        "<fieldset class=\"switch\"><legend>Scale</legend>\
         <label><input type=\"radio\" name=\"{id}-scale\" value=\"linear\" checked><span>linear</span></label>\
         <label><input type=\"radio\" name=\"{id}-scale\" value=\"log\"><span>log</span></label></fieldset>\
         <div class=\"scale-linear\">{linear}</div><div class=\"scale-log\">{log}</div>"
    )
}

/// At most this many channels get their own image; of more, an even choice is shown.
const IMAGE_CHANNELS: usize = 3;

/// The channels shown as images.
fn image_channels(count: usize) -> Vec<usize> {
    if count <= IMAGE_CHANNELS {
        return (0..count).collect();
    }
    (0..IMAGE_CHANNELS)
        .map(|k| k * (count - 1) / (IMAGE_CHANNELS - 1))
        .collect()
}

/// What to add to a caption when not every channel is shown.
fn channel_note(count: usize) -> String {
    if count <= IMAGE_CHANNELS {
        String::new()
    } else {
        format!(" {IMAGE_CHANNELS} of the {count} channels are shown.")
    }
}

/// The unit of L(θ) that belongs to the unit of radiance.
pub fn lighting_unit(run: &Run) -> &'static str {
    if run.radiance_unit.starts_with('W') {
        "W m⁻² rad⁻¹"
    } else {
        "relative unit rad⁻¹"
    }
}

/// The unit of irradiance that belongs to the unit of radiance.
pub fn irradiance_unit(run: &Run) -> &'static str {
    if run.radiance_unit.starts_with('W') {
        "W m⁻²"
    } else {
        "relative unit"
    }
}

/// The axes of every image of the light field.
fn light_field_axes(size_step: f64) -> (Axis, Axis) {
    (
        Axis::degrees("normal direction α / degrees", -180.0, 180.0, size_step),
        Axis::degrees("exitant direction θ_[o]′ / degrees", -90.0, 90.0, 30.0),
    )
}

/// How closely an image follows the cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Detail {
    /// Up to 720 columns, gaps shown as they are.
    Gaps,
    /// Up to 720 columns, gaps closed.
    Fine,
    /// Up to 360 columns, gaps closed.
    Coarse,
}

/// Cells of α that may share a pixel: 12° of the usual grid, the spacing of 30 views.
const MOST_MERGED: usize = 24;

/// A quantity of the light field's cells laid out as an image: θo′ upwards, α to the right.
struct CellImage {
    columns: usize,
    rows: usize,
    /// Row-major, top row first, NaN where nothing was seen.
    values: Vec<f64>,
    /// Cells of α that share a column of the image.
    merged: usize,
}

/// Lays out `value(cell index)` over the plane. Where views are far apart most cells are empty, and an
/// image of them would be thin lines: neighbours in α are then merged (mean over those seen), by the
/// smallest factor that fills nearly all of what lies within the limb cut. There are at most 180 rows, and
/// columns as `detail` says: more than a page shows would only cost bytes.
fn cell_image(
    field: &LightField,
    channel: usize,
    limb_cut: f64,
    detail: Detail,
    value: impl Fn(usize) -> f64,
) -> CellImage {
    let grid = field.grid;
    let weight = field.weight.get(channel).map_or(&[][..], Vec::as_slice);
    let seen = |at: usize| weight.get(at).is_some_and(|w| *w > 0.0);
    let widest = if detail == Detail::Coarse { 360 } else { 720 };
    let least = grid.normals.div_ceil(widest).max(1);
    let most = if detail == Detail::Gaps {
        least
    } else {
        MOST_MERGED.max(least)
    };
    let local_step = grid.locals.div_ceil(180).max(1);
    let visible: Vec<usize> = (0..grid.locals)
        .filter(|&j| grid.local(j).rad().abs() <= limb_cut)
        .collect();
    // Whether merging by `factor` fills at least the share `least_share` of the image.
    let filled = |factor: usize, least_share: f64| {
        let all = visible.len() * grid.normals.div_ceil(factor);
        let mut may_be_empty = ((1.0 - least_share) * all as f64) as usize;
        let mut any = vec![false; grid.locals];
        for rows in weight.chunks((factor * grid.locals).max(1)) {
            any.fill(false);
            for row in rows.chunks(grid.locals.max(1)) {
                for (any, w) in any.iter_mut().zip(row) {
                    *any |= *w > 0.0;
                }
            }
            let empty = visible.iter().filter(|&&j| !any[j]).count();
            if empty > may_be_empty {
                return false;
            }
            may_be_empty -= empty;
        }
        true
    };
    let factors: Vec<usize> = (least..=most)
        .filter(|f| grid.normals.is_multiple_of(*f))
        .collect();
    // Few holes if the views are even, some if a part of the circle was left out, else none closed.
    let merged = [0.99, 0.9, 0.6]
        .into_iter()
        .find_map(|share| factors.iter().copied().find(|&f| filled(f, share)))
        .or(factors.first().copied())
        .unwrap_or(1);
    let columns = grid.normals.div_ceil(merged);
    let rows = grid.locals.div_ceil(local_step);
    let mut values = vec![f64::NAN; columns * rows];
    let mut sums = vec![(0.0, 0usize); rows];
    for column in 0..columns {
        sums.fill((0.0, 0));
        for i in column * merged..((column + 1) * merged).min(grid.normals) {
            for j in 0..grid.locals {
                let at = grid.index(i, j);
                if seen(at) {
                    let v = value(at);
                    if v.is_finite() {
                        let (sum, count) = &mut sums[j / local_step];
                        *sum += v;
                        *count += 1;
                    }
                }
            }
        }
        for (row, (sum, count)) in sums.iter().enumerate() {
            if *count > 0 {
                values[(rows - 1 - row) * columns + column] = sum / *count as f64;
            }
        }
    }
    CellImage {
        columns,
        rows,
        values,
        merged,
    }
}

/// How the merging is told to the reader.
fn merge_note(image: &CellImage, field: &LightField) -> String {
    if image.merged > 1 {
        format!(
            " For the eye {} neighbouring cells in α share one pixel ({}°); the numbers use every sample where it was measured.",
            image.merged,
            super::number::trimmed(360.0 / field.grid.normals as f64 * image.merged as f64, 2)
        )
    } else {
        String::new()
    }
}

/// A table of cell images on a coarse grid: α, θo′ and one column per image, by name.
fn cell_table(images: &[(String, &CellImage)], note: &str) -> Table {
    let Some((_, first)) = images.first() else {
        return Table::default();
    };
    let step_x = first.columns.div_ceil(72).max(1);
    let step_y = first.rows.div_ceil(36).max(1);
    let mut columns = vec!["alpha_deg".to_owned(), "theta_o_deg".to_owned()];
    columns.extend(images.iter().map(|(name, _)| name.clone()));
    let mut rows = Vec::new();
    for row in (step_y / 2..first.rows).step_by(step_y) {
        for column in (step_x / 2..first.columns).step_by(step_x) {
            let alpha = -180.0 + (column as f64 + 0.5) * 360.0 / first.columns as f64;
            let local = 90.0 - (row as f64 + 0.5) * 180.0 / first.rows as f64;
            let mut cells = vec![Cell::Fixed(alpha, 2), Cell::Fixed(local, 2)];
            cells.extend(images.iter().map(|(_, image)| {
                let value = image.values.get(row * first.columns + column).copied();
                Cell::Number(value.unwrap_or(f64::NAN))
            }));
            rows.push(cells);
        }
    }
    Table {
        columns,
        rows,
        note: note.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;

    /// A field seen at every `every`-th diagonal, with the value α + 1000·θo′ in degrees.
    fn diagonals(every: usize) -> LightField {
        let grid = Grid {
            normals: 360,
            locals: 180,
        };
        let mut field = LightField::empty(grid, vec!["Y".to_owned()]);
        for i in 0..grid.normals {
            for j in 0..grid.locals {
                if (i + j) % every == 0 {
                    let k = grid.index(i, j);
                    field.mean[0][k] = (grid.normal(i).deg() + 1000.0 * grid.local(j).deg()) as f32;
                    field.weight[0][k] = 1.0;
                }
            }
        }
        field
    }

    #[test]
    fn an_image_has_theta_upwards_alpha_to_the_right_and_no_lines_of_holes() {
        for every in [1, 5, 12] {
            let field = diagonals(every);
            let image = cell_image(&field, 0, 1.4, Detail::Fine, |k| {
                f64::from(field.mean[0][k])
            });
            assert_eq!(image.merged, every);
            assert_eq!([image.columns, image.rows], [360 / every, 180]);
            assert!(image.values.iter().all(|v| v.is_finite()));
            let table = cell_table(&[("B".to_owned(), &image)], "");
            for row in &table.rows {
                let [
                    Cell::Fixed(alpha, _),
                    Cell::Fixed(local, _),
                    Cell::Number(value),
                ] = row[..]
                else {
                    panic!("{row:?}")
                };
                // Exactly one seen cell of the merged ones, at most half their width away in α.
                let off = value - (alpha + 1000.0 * local);
                assert!(off.abs() <= every as f64 / 2.0, "{alpha} {local} {value}");
            }
        }
    }

    #[test]
    fn many_channels_are_shown_by_an_even_choice() {
        assert_eq!(image_channels(3), [0, 1, 2]);
        assert_eq!(image_channels(31), [0, 15, 30]);
        assert!(channel_note(31).contains("31"));
    }
}

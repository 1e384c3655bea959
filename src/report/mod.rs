//! The report: one function per figure, and the page that orders them.
//!
//! [`page`] makes one self-contained HTML page of a [`Run`]: the answer first, then
//! the evidence, the methods, the settings and the provenance. It is complete without scripts and on
//! paper; a small script adds the values under the pointer.

mod batch;
mod comparison;
mod equation;
mod figure;
mod methods;
pub mod number;
pub mod paper;
pub mod plot;
mod results;
mod settings;
mod sheet;
mod table;
#[cfg(test)]
mod tests;
mod validation;

use askama::Template;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::pipeline::Run;
pub use batch::batch;
pub use comparison::comparison;
use figure::Figure;
use methods::Passage;
use results::ResultTable;
pub use validation::validation;

/// Values under the pointer, larger parts of plots, sorted tables.
const SCRIPT: &str = concat!(
    include_str!("template/zoom.js"),
    include_str!("template/script.js")
);

/// The page as the template takes it.
#[derive(Template)]
#[template(path = "page.html", config = "src/report/template/askama.toml")]
struct Page<'a> {
    title: &'a str,
    kind: &'static str,
    capture: &'a str,
    version: &'a str,
    style: &'static str,
    script: &'static str,
    gradients: String,
    warnings: &'a [String],
    findings: &'a [String],
    results: Vec<ResultTable>,
    sections: Vec<Section>,
    methods: Vec<Passage>,
    recipe: &'a str,
    capture_toml: &'a str,
    stages: Vec<(&'a str, String)>,
    hashes: Vec<(&'a str, &'a str)>,
}

/// Figures under one heading; sections without figures are left out.
struct Section {
    id: &'static str,
    title: &'static str,
    /// Markup.
    figures: Vec<String>,
}

/// A figure with its table, as markup.
#[derive(Template)]
#[template(path = "figure.html", config = "src/report/template/askama.toml")]
struct FigureMarkup<'a> {
    figure: &'a Figure,
}

/// Room for what stands beside the figures, bytes.
const BESIDE_FIGURES: usize = 1 << 18;

/// The report of a run as one HTML page without any reference to the network.
///
/// # Errors
/// If an image cannot be encoded or the data disagree with their own sizes.
pub fn page(run: &Run) -> Result<String> {
    check(run)?;
    let (figures, (results, methods)) = rayon::join(
        || figures(run),
        || rayon::join(|| results::tables(run), || methods::methods(run)),
    );
    let [lighting, brdf, object, light_field, fit] = figures?;
    let sections = [
        ("lighting-section", "Lighting", lighting),
        ("brdf-section", "BRDF", brdf),
        ("object-section", "Object and photographs", object),
        ("light-field-section", "Light field", light_field),
        ("fit-section", "Quality of the fit", fit),
    ]
    .into_iter()
    .filter(|(_, _, figures)| !figures.is_empty())
    .map(|(id, title, figures)| Section { id, title, figures })
    .collect();
    let page = Page {
        title: &run.title,
        kind: match run.recover.as_str() {
            "lighting" => "Lighting recovered from photographs",
            "brdf" => "BRDF recovered from photographs",
            "both" => "Lighting and BRDF recovered from photographs",
            _ => "Light field measured from photographs",
        },
        capture: &run.capture_name,
        version: &run.version,
        style: include_str!("template/style.css"),
        script: SCRIPT,
        gradients: plot::ColourMap::gradients(),
        warnings: &run.warnings,
        findings: &run.findings,
        results,
        sections,
        methods: methods?,
        recipe: &run.recipe_toml,
        capture_toml: &run.capture_toml,
        stages: run
            .stage_seconds
            .iter()
            .map(|(stage, seconds)| (stage.as_str(), number::fixed(*seconds, 3)))
            .collect(),
        hashes: run
            .input_hashes
            .iter()
            .map(|(file, hash)| (file.as_str(), hash.as_str()))
            .collect(),
    };
    let figures = page.sections.iter().flat_map(|section| &section.figures);
    // Figures are nearly all of it: it is not to be copied every time that it has grown to twice its size.
    let mut markup =
        String::with_capacity(figures.map(String::len).sum::<usize>() + BESIDE_FIGURES);
    page.render_into(&mut markup)
        .map_err(|e| Error::failed(format!("cannot write the report: {e}")))?;
    Ok(markup)
}

/// Markup of the figures on lighting, BRDF, object, light field and fit, drawn and written side by side.
fn figures(run: &Run) -> Result<[Vec<String>; 5]> {
    type Draw = fn(&Run) -> Result<Vec<Figure>>;
    fn one(figure: Option<Figure>) -> Result<Vec<Figure>> {
        Ok(figure.into_iter().collect())
    }
    let draw: [(usize, Draw); 18] = [
        (0, |run| one(figure::lighting_curve(run))),
        (0, |run| one(figure::lighting_polar(run))),
        (0, |run| one(figure::lighting_spectrum(run))),
        (0, |run| one(figure::ways_compared(run))),
        (0, |run| one(figure::eigenvalues(run))),
        (1, |run| one(figure::brdf_cuts(run))),
        (1, |run| one(figure::brdf_image(run)?)),
        (1, |run| one(figure::brdf_sigma(run)?)),
        (1, |run| one(figure::brdf_status(run))),
        (2, |run| Ok(vec![figure::setup(run)])),
        (2, |run| Ok(figure::photos(run)?.into_iter().collect())),
        (3, |run| Ok(vec![figure::light_field(run)?])),
        (3, |run| Ok(vec![figure::coverage(run)?])),
        (3, |run| Ok(vec![figure::sigma(run)?])),
        (3, |run| one(figure::magnitudes(run))),
        (3, |run| one(figure::coefficient_image(run)?)),
        (4, |run| one(figure::residual_image(run)?)),
        (4, |run| {
            let both = [figure::residual_histogram(run), figure::regularisation(run)];
            Ok(both.into_iter().flatten().collect())
        }),
    ];
    let markup = |figure: &Figure| -> Result<String> {
        let markup = FigureMarkup { figure }.render();
        markup.map_err(|e| Error::failed(format!("cannot write the report: {e}")))
    };
    let drawn: Vec<Vec<String>> = draw
        .par_iter()
        .map(|(_, draw)| draw(run)?.par_iter().map(markup).collect())
        .collect::<Result<_>>()?;
    let mut sections: [Vec<String>; 5] = Default::default();
    for ((section, _), figures) in draw.iter().zip(drawn) {
        sections[*section].extend(figures);
    }
    Ok(sections)
}

/// Whether the arrays have the sizes that their grid and channels promise; the figures rely on it.
fn check(run: &Run) -> Result<()> {
    for (name, field) in [
        ("light field", Some(&run.light_field)),
        ("residual", run.residual.as_ref()),
    ] {
        let Some(field) = field else { continue };
        let channels = field.channels.len();
        for (layer, values) in [
            ("mean", &field.mean),
            ("sigma", &field.sigma),
            ("weight", &field.weight),
        ] {
            if values.len() != channels || values.iter().any(|v| v.len() != field.grid.len()) {
                return Err(Error::failed(format!(
                    "the {name}'s layer `{layer}` does not have {channels} channels of {} × {} cells",
                    field.grid.normals, field.grid.locals
                )));
            }
        }
        if field.grid.is_empty() || channels == 0 {
            return Err(Error::failed(format!(
                "the {name} has no cell to report on"
            )));
        }
    }
    Ok(())
}

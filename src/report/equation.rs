//! Equations as MathML.

use pulldown_latex::config::{DisplayMode, RenderConfig};
use pulldown_latex::{Parser, Storage, push_mathml};

use crate::error::{Error, Result};

/// A displayed equation from LaTeX.
///
/// # Errors
/// If the LaTeX cannot be read. The renderer itself would print the message into the page, and it
/// prints a control space as the letters `&nbsp;`, so both are refused here.
pub fn display(latex: &str) -> Result<String> {
    render(latex, DisplayMode::Block)
}

/// An equation in a line of text from LaTeX; errors as [`display`].
///
/// # Errors
/// As [`display`].
pub fn inline(latex: &str) -> Result<String> {
    render(latex, DisplayMode::Inline)
}

fn render(latex: &str, display_mode: DisplayMode) -> Result<String> {
    let wrong = |why: String| Error::failed(format!("the equation {latex:?} cannot be set: {why}"));
    let storage = Storage::new();
    for event in Parser::new(latex, &storage) {
        event.map_err(|e| wrong(e.to_string()))?;
    }
    let mut out = String::new();
    let config = RenderConfig {
        display_mode,
        ..RenderConfig::default()
    };
    push_mathml(&mut out, Parser::new(latex, &storage), config)
        .map_err(|e| wrong(e.to_string()))?;
    if out.contains("<merror") || out.contains('\\') || out.contains("&amp;nbsp;") {
        return Err(wrong(
            "it leaves LaTeX or an error message in the page".to_owned(),
        ));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn good_equations_become_mathml() -> Result<()> {
        let mathml = display(r"B(\alpha, \theta_o') = \int L \,\mathrm{d}\theta")?;
        assert!(mathml.starts_with("<math") && mathml.trim_end().ends_with("</math>"));
        assert!(mathml.contains('α') && mathml.contains('∫'));
        Ok(())
    }

    #[test]
    fn errors_are_reported_and_never_printed_into_the_page() {
        for bad in [
            r"\frac{1}",
            r"\nosuchcommand x",
            r"{x",
            r"x \right)",
            r"a\ b",
        ] {
            assert!(
                display(bad).is_err(),
                "{bad}: {}",
                display(bad).unwrap_or_default()
            );
            assert!(inline(bad).is_err(), "{bad}");
        }
    }
}

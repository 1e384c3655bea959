//! The methods in words, with the equations.

use super::equation::{display, inline};
use super::number::trimmed;
use super::settings::{switch_at, text_at};
use crate::error::Result;
use crate::pipeline::Run;

/// A paragraph or an equation of the methods section.
#[derive(Clone, Debug)]
pub struct Passage {
    /// Markup made here from fixed words and numbers only.
    pub markup: String,
}

fn words(markup: impl Into<String>) -> Passage {
    Passage {
        markup: format!("<p>{}</p>", markup.into()),
    }
}

fn equation(latex: &str) -> Result<Passage> {
    Ok(Passage {
        markup: format!("<div class=\"equation\">{}</div>", display(latex)?),
    })
}

/// The methods of this run.
///
/// # Errors
/// If an equation cannot be set.
pub fn methods(run: &Run) -> Result<Vec<Passage>> {
    let mut out = vec![
        words(format!(
            "Every usable pixel on the object's cross-section is one sample of the reflected light field \
             {}: {} is the direction of the outward surface normal, {} the direction to the camera relative to that normal, \
             both signed and counter-clockwise. They follow from the outline found in each photograph and the camera's exact perspective; \
             samples beyond {} of the normal were left out. For a homogeneous convex surface under distant light in the plane, \
             reflection is the integral",
            inline(r"B(\alpha, \theta_o')")?,
            inline(r"\alpha")?,
            inline(r"\theta_o' = \theta_o - \alpha")?,
            format_args!("±{}°", trimmed(run.limb_cut.to_degrees(), 3)),
        )),
        equation(
            r"B(\alpha, \theta_o') = \int_{-\pi/2}^{\pi/2} L(\alpha + \theta_i') \, \hat\rho(\theta_i', \theta_o') \, \mathrm{d}\theta_i' , \qquad \hat\rho = \rho \cos\theta_i'",
        )?,
        words(format!(
            "with the incident light {} per radian of direction and the BRDF {} in the plane of incidence [RH01, eq. 4]. \
             In Fourier series over {} this is a product of each frequency of the light with a known factor [RH01, eq. 11, 14]:",
            inline(r"L(\theta_i)")?,
            inline(r"\rho")?,
            inline(r"\alpha")?
        )),
        equation(
            r"B(\alpha, \theta_o') = \sum_{p} L_p \, H_p(\theta_o') \, e^{i p \alpha} , \qquad H_p(\theta_o') = \int_{-\pi/2}^{\pi/2} \hat\rho(\theta_i', \theta_o') \, e^{i p \theta_i'} \, \mathrm{d}\theta_i'",
        )?,
    ];
    if let Some(lighting) = &run.lighting
        && run.recover == "lighting"
    {
        out.push(words(format!(
            "The lighting is the weighted least-squares solution over all samples {} that exist, at their own positions, with weights from their variances; \
             no gap is filled and nothing is interpolated first:",
            inline(r"b_k")?
        )));
        out.push(equation(
            r"\min_{L} \; \sum_k \frac{1}{\sigma_k^2} \left| b_k - \sum_p L_p H_p(\theta_{o,k}') e^{i p \alpha_k} \right|^2 + \lambda \, R(L)",
        )?);
        let criterion = lighting
            .channels
            .first()
            .map_or("none", |c| c.regularisation.criterion.as_str());
        let how = match criterion {
            "gcv" => {
                "its strength was chosen by generalised cross-validation, that is, by the error expected on samples that were left out"
            }
            "evidence" => "its strength was chosen by the marginal likelihood of the data",
            "truncate" => "it is a cut at the highest frequency that the data support",
            "none" => "it was switched off",
            _ => "its strength was set by hand",
        };
        let sign = if switch_at(&run.recipe_toml, &["recovery", "non_negative"]).unwrap_or(true) {
            " Light is not negative, and the estimate is held to that."
        } else {
            ""
        };
        out.push(words(format!(
            "{} is the regularisation; {how}.{sign} Directional sources are fitted beside the smooth light, with their directions.",
            inline(r"R")?
        )));
        out.push(words(
            "The standard deviations are those of the fit's covariance with the samples' variances carried through. The Cramér–Rao bound is \
             the same for the problem without regularisation,",
        ));
        out.push(equation(
            r"\operatorname{Cov}(L) \succeq \left( \sum_k \frac{1}{\sigma_k^2} \, \overline{h_k} \, h_k^{\mathsf{T}} \right)^{-1} , \qquad (h_k)_p = H_p(\theta_{o,k}') e^{i p \alpha_k}",
        )?);
        out.push(words(
            "A frequency that the surface does not reflect, or that too few views sampled, has no finite bound: it is called indeterminate, \
             and no number is made up for it.",
        ));
    }
    if run.recover == "brdf" {
        out.extend(brdf_methods(
            "The light was given. With it the BRDF is fitted to all samples that exist:",
        )?);
    }
    if run.recover == "both" {
        out.extend(joint_methods()?);
        out.extend(brdf_methods(
            "The BRDF slice is then fitted under the light's determined frequencies, to the part of the light field that they caused:",
        )?);
    }
    if let Some(model) = text_at(&run.recipe_toml, &["brdf", "model"]) {
        out.push(words(format!(
            "The BRDF was given: model <em>{}</em>, with the parameters in the recipe below.",
            super::plot::escape(&model)
        )));
    }
    out.push(words(
        "[RH01] R. Ramamoorthi and P. Hanrahan, “Analysis of planar light fields from homogeneous convex curved surfaces under distant \
         illumination”, Proc. SPIE 4299 (2001).",
    ));
    Ok(out)
}

/// How a slice is fitted.
fn brdf_methods(first: &str) -> Result<Vec<Passage>> {
    Ok(vec![
        words(first),
        equation(
            r"b_k = \frac{1}{\cos\theta_{o,k}'} \int_{-\pi/2}^{\pi/2} L(\alpha_k + \theta_i') \, \tilde\rho(\theta_i', \theta_{o,k}') \, \mathrm{d}\theta_i' + \text{noise}, \qquad \tilde\rho = \rho \cos\theta_i' \cos\theta_o'",
        )?,
        words(format!(
            "{} is a product spline over the two half circles, zero beyond them, symmetric (reciprocity) and not negative; nothing else is assumed of the shape of a lobe. \
             The posterior under a prior of smoothness across and along the mirror direction gives the values and their standard deviations; the prior's weights maximise the marginal likelihood of the samples. \
             A value is determined if the samples alone, without the prior, fix it to within half of what could be expected of it; weak if only samples and smoothness together do; else indeterminate.",
            inline(r"\tilde\rho")?
        )),
        words(
            "Analytic models are fitted to the slice at the spacing of the spline's knots, by weighted least squares; they are ordered by the Bayesian information criterion.",
        ),
    ])
}

/// How light and material are told apart.
fn joint_methods() -> Result<Vec<Passage>> {
    Ok(vec![
        words(
            "Neither light nor material was given. What tells them apart is reciprocity: with the light field's coefficients over both angles [RH01, eq. 15],",
        ),
        equation(
            r"\tilde B_{p,q} = 2\pi L_p \tilde\rho_{-p,q} , \quad \tilde\rho_{p,q} = \tilde\rho_{q,p} \quad\Rightarrow\quad \tilde B_{p,q} \overline{L_q} = \overline{\tilde B_{q,p}} L_p \quad\text{for all } p, q .",
        )?,
        words(
            "These equations are linear in the light. Their total least-squares solution is the eigenvector of the smallest eigenvalue; from there the light is refined on the samples with the support of the \
             half circles, by the part of the data that no reciprocal BRDF can explain, so that no prior on the BRDF pulls at the light. The covariance is the inverse of the information that this part holds.",
        ),
        words(
            "A common factor stays free, light times it and material divided by it; an outside fact sets it, or the convention that the light's mean is one. [RH01, eq. 29] uses one row of the equations and is shown for comparison.",
        ),
    ])
}

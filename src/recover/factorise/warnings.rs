//! What a reader must know about a channel, in plain sentences.

use super::Channel;
use crate::lighting::Status;

/// Mean square of the reciprocity residuals in units of the noise above which a warning is given: thousands of coefficients scatter by less
/// than 0.05 about 1, and a noise model is good to a tenth of the variance.
pub const MISFIT: f64 = 1.2;

/// What a reader must know about a channel.
pub(super) fn warnings(channel: &Channel) -> Vec<String> {
    let name = &channel.name;
    let mut said = Vec::new();
    if channel.visible_band == 0 {
        said.push(format!(
            "Channel {name}: the light field does not change with the normal. The light is uniform, or the surface passes nothing but \
             its mean: no other frequency of the light, and of the BRDF nothing but its mean over incidence, is determined."
        ));
    }
    let listed = |status: Status| -> Vec<String> {
        (0..=channel.band)
            .filter(|&p| channel.status[p] == status)
            .map(|p| p.to_string())
            .collect()
    };
    let indeterminate = listed(Status::Indeterminate);
    if !indeterminate.is_empty() {
        said.push(format!(
            "Channel {name}: the lighting's frequencies {} are not determined by this light field and are left at 0.",
            indeterminate.join(", ")
        ));
    }
    let weak = listed(Status::Weak);
    if !weak.is_empty() {
        said.push(format!(
            "Channel {name}: the lighting's frequencies {} are only weakly determined.",
            weak.join(", ")
        ));
    }
    if channel.components.len() > 1 {
        let others: Vec<String> = channel.components[1..]
            .iter()
            .map(|c| {
                let names: Vec<String> = c.iter().map(ToString::to_string).collect();
                format!("{{{}}}", names.join(", "))
            })
            .collect();
        said.push(format!(
            "Channel {name}: reciprocity does not tie the frequencies {} to the mean light; each such group has a factor of its own.",
            others.join(" and ")
        ));
    }
    if channel.misfit > MISFIT {
        said.push(format!(
            "Channel {name}: the light field breaks reciprocity by {:.1} times its stated noise; the error bars were widened by \
             that. Light from out of the plane, a texture, or too small a noise estimate would do this.",
            channel.misfit.sqrt()
        ));
    }
    if channel.band < channel.visible_band {
        said.push(format!(
            "Channel {name}: frequencies above {} show in the light field (up to {}), too weakly to be recovered.",
            channel.band, channel.visible_band
        ));
    }
    if !channel.converged {
        said.push(format!(
            "Channel {name}: the refinement did not settle; the weakly determined frequencies may be worse than their error bars."
        ));
    }
    said
}

//! What if the photographs were not linear, or the lamps were near? A recovery that does not explain them is tried again on samples that are
//! changed as either would have it: what explains much more of them then is the likeliest cause.

use crate::angle::wrap;
use crate::error::Result;
use crate::light_field::Samples;
use crate::lighting::{Lighting, Source};
use crate::recover::factorise;

/// Exponents to which photographs are taken: those of a gamma of 2.2 left in or taken out once too often, and of curves a little bent.
const EXPONENTS: [f64; 6] = [2.2, 1.0 / 2.2, 1.5, 0.67, 1.25, 0.8];
/// Shoulders that are straightened: the part by which the largest value fell short of a straight line.
const SHOULDERS: [f64; 2] = [0.2, 0.4];
/// Distances of lamps in radii of the object.
const DISTANCES: [f64; 4] = [5.0, 10.0, 20.0, 40.0];
/// Cells a side and knot intervals of the slices that are recovered for it: as fine as lobes of a few degrees need, and soon done.
pub const SIZE: usize = 60;
/// As [`SIZE`].
pub const INTERVALS: usize = 24;
/// Part of the residual that may be left for a cause to be named.
pub const EXPLAINED: f64 = 0.5;

/// Largest resolved frequency up to which views may be too few, and part of the light field in the highest quarter of the resolved frequencies
/// from which they are.
const FEW: usize = 24;
/// As [`FEW`].
const FOLDS: f64 = 0.03;

/// A lamp at a direction, radians, and how bright it is.
pub type Lamp = (f64, f64);

/// The share that a recovery from samples leaves unexplained.
type Unexplained<'a> = &'a dyn Fn(&Samples) -> Result<f64>;

/// What would explain more of the photographs than the recovery did, in words, if anything does. The recovery left `as_they_are` of
/// the samples as they are.
pub fn better(
    samples: &Samples,
    lamps: &[Lamp],
    as_they_are: f64,
    unexplained: Unexplained,
) -> Option<String> {
    let mut best = Best::than(as_they_are);
    for exponent in &EXPONENTS {
        best.consider(
            unexplained(&bent(samples, |share| share.powf(*exponent))),
            format!(
                "the photographs are not linear: they fit far better if their values are taken to the power {exponent:.2}"
            ),
        );
    }
    best.consider_shoulders(samples, unexplained);
    for distance in &DISTANCES {
        if lamps.is_empty() {
            break;
        }
        best.consider(
            unexplained(&from_afar(samples, lamps, *distance)),
            format!(
                "the light is near: they fit far better with lamps about {distance:.0} radii away from the object's centre"
            ),
        );
    }
    best.found()
}

/// The same for shoulders alone, where light and BRDF are both unknown: what a power does to a lobe is a lobe again.
///
/// # Errors
/// As `unexplained` of the samples as they are.
pub fn straighter(samples: &Samples, unexplained: Unexplained) -> Result<Option<String>> {
    let mut best = Best::than(unexplained(samples)?);
    best.consider_shoulders(samples, unexplained);
    Ok(best.found())
}

/// What explains the samples best of all that was tried.
struct Best {
    as_they_are: f64,
    least: Option<(f64, String)>,
}

impl Best {
    fn than(as_they_are: f64) -> Self {
        Self {
            as_they_are,
            least: None,
        }
    }

    fn consider(&mut self, left: Result<f64>, what: String) {
        // A recovery that fails explains nothing.
        let Ok(left) = left else { return };
        if left < EXPLAINED * self.as_they_are
            && self.least.as_ref().is_none_or(|(least, _)| left < *least)
        {
            let note = format!("{what} (then {:.1} % are left unexplained)", 100.0 * left);
            self.least = Some((left, note));
        }
    }

    fn consider_shoulders(&mut self, samples: &Samples, unexplained: Unexplained) {
        for shoulder in &SHOULDERS {
            self.consider(
                unexplained(&bent(samples, |share| {
                    share * (1.0 - shoulder) / (1.0 - shoulder * share)
                })),
                format!(
                    "the photographs are not linear: they fit far better if the largest values are raised by {:.0} % against the others",
                    100.0 * shoulder / (1.0 - shoulder)
                ),
            );
        }
    }

    fn found(self) -> Option<String> {
        self.least.map(|(_, what)| what)
    }
}

/// Says that the views are too few for the detail of the light field, if it is so: where its highest frequencies that they resolve are still strong,
/// those above them are there too and pass for others.
pub fn few_views(samples: &Samples) -> Option<String> {
    let (mut highest, mut all, mut resolved) = (0.0, 0.0, 0);
    for c in 0..samples.channels.len() {
        for series in factorise::spectra(samples, c).into_iter().flatten() {
            let order = series.order();
            resolved = resolved.max(order);
            for p in 0..=order {
                let power = series.get(p as i64).norm_sqr() * if p == 0 { 1.0 } else { 2.0 };
                all += power;
                if 4 * p > 3 * order {
                    highest += power;
                }
            }
        }
    }
    let share = (highest / f64::max(all, f64::MIN_POSITIVE)).sqrt();
    (resolved <= FEW && share > FOLDS).then(|| {
        format!(
            "the views are too few: they resolve frequencies up to p = {resolved}, and {:.0} % of the light field is in the highest quarter of these, so that there is more beyond which passes for others",
            100.0 * share
        )
    })
}

/// The samples on another curve, of parts of the largest value of each channel, which stays. Their variances stay too: what a curve does to
/// noise is small against what it does to the values.
fn bent(samples: &Samples, curve: impl Fn(f64) -> f64) -> Samples {
    let mut changed = samples.clone();
    for c in 0..samples.channels.len() {
        let values = samples.columns.iter().flat_map(|column| {
            let both = column.value[c].iter().zip(&column.variance[c]);
            both.filter(|(_, v)| v.is_finite()).map(|(b, _)| *b)
        });
        let largest = values.fold(f64::MIN_POSITIVE, f64::max);
        for column in &mut changed.columns {
            for value in &mut column.value[c] {
                *value = largest * curve((*value / largest).clamp(0.0, 1.0));
            }
        }
    }
    changed
}

/// The samples as the same lamps would give them from far away, if they are `distance` radii from the object's centre.
///
/// A place sees a near lamp in another direction and at another distance than the centre does. Its direction against the normal is what
/// a distant lamp has at another normal. Where several lamps shine, the place is taken for the one that is strongest there.
fn from_afar(samples: &Samples, lamps: &[Lamp], distance: f64) -> Samples {
    let mut changed = samples.clone();
    for column in &mut changed.columns {
        for i in 0..column.alpha.len() {
            let alpha = column.alpha[i];
            let strength = |lamp: &&Lamp| lamp.1 * (lamp.0 - alpha).cos();
            let strongest = lamps
                .iter()
                .max_by(|a, b| strength(a).total_cmp(&strength(b)));
            let Some(&(theta, _)) = strongest.filter(|lamp| (lamp.0 - alpha).cos() > 0.0) else {
                continue;
            };
            let x = distance * theta.cos() - alpha.cos();
            let y = distance * theta.sin() - alpha.sin();
            column.alpha[i] = wrap(alpha - wrap(y.atan2(x) - theta));
            let factor = (x * x + y * y) / (distance * distance);
            for c in 0..column.value.len() {
                column.value[c][i] *= factor;
                column.variance[c][i] *= factor * factor;
            }
        }
    }
    changed
}

/// One channel of samples.
pub fn one_channel(samples: &Samples, channel: usize) -> Samples {
    let mut one = samples.clone();
    let only = |rows: &mut Vec<Vec<f64>>| {
        if channel < rows.len() {
            rows.swap(0, channel);
        }
        rows.truncate(1);
    };
    one.channels = samples.channels.get(channel).cloned().into_iter().collect();
    for column in &mut one.columns {
        only(&mut column.value);
        only(&mut column.variance);
    }
    one
}

/// The light of one channel.
pub fn light_of_channel(light: &Lighting, channel: usize) -> Lighting {
    let one = |rows: &[Vec<f64>]| rows.get(channel).cloned().into_iter().collect();
    Lighting {
        channels: light.channels.get(channel).cloned().into_iter().collect(),
        sources: light
            .sources
            .iter()
            .map(|source| Source {
                theta: source.theta,
                irradiance: vec![source.in_channel(channel)],
            })
            .collect(),
        table: one(&light.table),
        smooth: light.smooth.get(channel).cloned().into_iter().collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;
    use crate::light_field::Column;

    /// Lambertian under lamps, near or far: B = Σ E cos(direction − α) (d/r)².
    fn lit(lamps: &[Lamp], distance: Option<f64>, curve: f64) -> Samples {
        let place = |alpha: f64| -> f64 {
            let of = |&(theta, e): &Lamp| match distance {
                None => e * (theta - alpha).cos().max(0.0),
                Some(d) => {
                    let (x, y) = (d * theta.cos() - alpha.cos(), d * theta.sin() - alpha.sin());
                    let r = x.hypot(y);
                    e * ((x * alpha.cos() + y * alpha.sin()) / r).max(0.0) * (d / r).powi(2)
                }
            };
            lamps.iter().map(of).sum()
        };
        let alpha: Vec<f64> = (0..360).map(|k| f64::from(k - 180).to_radians()).collect();
        let value: Vec<f64> = alpha.iter().map(|a| place(*a).powf(curve)).collect();
        Samples {
            channels: vec!["Y".into()],
            columns: vec![Column {
                local: LocalAngle::radians(0.0),
                view: (0..360).collect(),
                variance: vec![vec![1e-8; value.len()]],
                value: vec![value],
                alpha,
            }],
        }
    }

    /// What of the samples is no distant light of this direction and strength on a Lambertian surface.
    fn left(lamp: Lamp) -> impl Fn(&Samples) -> Result<f64> {
        move |samples| {
            let column = &samples.columns[0];
            let (mut square, mut power) = (0.0, 0.0);
            for (alpha, b) in column.alpha.iter().zip(&column.value[0]) {
                square += (b - lamp.1 * (lamp.0 - alpha).cos().max(0.0)).powi(2);
                power += b * b;
            }
            Ok((square / power).sqrt())
        }
    }

    #[test]
    fn a_planted_curve_is_named_and_a_planted_near_lamp_is_too() {
        let lamp = (0.6, 1.0);
        let test = left(lamp);
        for (curve, expected) in [(1.0 / 2.2, "power 2.20"), (1.5, "power 0.67")] {
            let samples = lit(&[lamp], None, curve);
            let found = better(&samples, &[lamp], test(&samples).unwrap(), &test);
            assert!(
                found.as_ref().is_some_and(|f| f.contains(expected)),
                "{found:?}"
            );
        }
        for distance in [5.0, 10.0, 20.0] {
            let samples = lit(&[lamp], Some(distance), 1.0);
            let found = better(&samples, &[lamp], test(&samples).unwrap(), &test);
            let expected = format!("about {distance:.0} radii");
            assert!(
                found.as_ref().is_some_and(|f| f.contains(&expected)),
                "{found:?}"
            );
        }
        // A second lamp that is not known is neither.
        let samples = lit(&[lamp, (2.0, 0.5)], None, 1.0);
        assert_eq!(
            better(&samples, &[lamp], test(&samples).unwrap(), &test),
            None
        );
    }

    #[test]
    fn a_planted_shoulder_is_named_and_a_power_is_not() {
        let lamp = (0.6, 1.0);
        let test = left(lamp);
        let straight = lit(&[lamp], None, 1.0);
        let shoulder = bent(&straight, |share| share / (1.0 - 0.2 + 0.2 * share));
        let found = straighter(&shoulder, &test).unwrap();
        assert!(
            found.as_ref().is_some_and(|f| f.contains("raised by 25 %")),
            "{found:?}"
        );
        assert_eq!(straighter(&straight, &test).unwrap(), None);
        // A gamma leaves a shoulder of its own, which is straightened by no more than half.
        assert_eq!(straighter(&lit(&[lamp], None, 2.2), &test).unwrap(), None);
    }

    #[test]
    fn views_that_are_too_few_for_a_sharp_light_field_are_said_to_be() {
        let every = |step: usize, samples: &Samples| {
            let mut few = samples.clone();
            for column in &mut few.columns {
                let keep = |values: &mut Vec<f64>| {
                    *values = values.iter().copied().step_by(step).collect()
                };
                keep(&mut column.alpha);
                keep(&mut column.value[0]);
                keep(&mut column.variance[0]);
                column.view = (0..column.alpha.len() as u32).collect();
            }
            few
        };
        // exp(−9/16) of the mean is at the last of 3 frequencies, and of a half cosine 1/195 at the 14th of 17.
        let sharp = lit(&[(0.6, 1.0)], None, 8.0);
        let smooth = lit(&[(0.6, 1.0)], None, 1.0);
        assert!(few_views(&every(45, &sharp)).is_some());
        assert_eq!(few_views(&every(10, &smooth)), None);
        assert_eq!(few_views(&sharp), None);
    }

    #[test]
    fn a_near_lamp_is_moved_away_exactly() {
        let lamp = (0.6, 1.0);
        let far = from_afar(&lit(&[lamp], Some(5.0), 1.0), &[lamp], 5.0);
        // Exact but where the near lamp does not reach what a distant one does.
        assert!(left(lamp)(&far).unwrap() < 1e-3);
    }
}

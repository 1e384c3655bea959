//! The three kinds of in-plane angle, as types: α + θ′ = θ compiles, α + α does not.
//!
//! All hold radians. The conventions (sign, range, reference) are in the [crate documentation](crate).

use std::f64::consts::{PI, TAU};
use std::ops::{Add, Neg, Sub};

use serde::{Deserialize, Serialize};

/// An angle brought into [−π, π).
pub fn wrap(radians: f64) -> f64 {
    let shifted = radians + PI;
    // Most angles are in the range or one turn off it: the same without a division.
    let turned = if (0.0..TAU).contains(&shifted) {
        shifted
    } else if (-TAU..0.0).contains(&shifted) {
        shifted + TAU
    } else if (TAU..2.0 * TAU).contains(&shifted) {
        shifted - TAU
    } else {
        shifted.rem_euclid(TAU)
    } - PI;
    // `rem_euclid` may round up to a full turn for tiny negative arguments.
    if turned >= PI { -PI } else { turned }
}

macro_rules! angle {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(f64);

        impl $name {
            /// From radians, kept as given (not wrapped).
            pub const fn radians(value: f64) -> Self {
                Self(value)
            }

            /// From degrees, kept as given (not wrapped).
            pub fn degrees(value: f64) -> Self {
                Self(value.to_radians())
            }

            /// The value in radians.
            pub const fn rad(self) -> f64 {
                self.0
            }

            /// The value in degrees.
            pub fn deg(self) -> f64 {
                self.0.to_degrees()
            }

            /// The same direction in [−π, π).
            pub fn wrapped(self) -> Self {
                Self(wrap(self.0))
            }
        }
    };
}

angle! {
    /// α: direction of the outward surface normal, global.
    NormalAngle
}
angle! {
    /// θi or θo: a direction in the plane, global.
    WorldAngle
}
angle! {
    /// θi′ or θo′: a direction relative to the surface normal, signed; visible within [−π/2, π/2].
    LocalAngle
}

impl LocalAngle {
    /// cos θ′ where the direction is above the surface, else 0.
    pub fn visible_cosine(self) -> f64 {
        if self.is_visible() {
            self.0.cos().max(0.0)
        } else {
            0.0
        }
    }

    /// Whether the direction lies in the half circle above the surface.
    pub fn is_visible(self) -> bool {
        self.0.abs() <= PI / 2.0
    }
}

impl Neg for LocalAngle {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

/// θ = α + θ′ (eq. 1).
impl Add<LocalAngle> for NormalAngle {
    type Output = WorldAngle;
    fn add(self, local: LocalAngle) -> WorldAngle {
        WorldAngle(self.0 + local.0)
    }
}

/// θ′ = θ − α (eq. 1), in [−π, π).
impl Sub<NormalAngle> for WorldAngle {
    type Output = LocalAngle;
    fn sub(self, normal: NormalAngle) -> LocalAngle {
        LocalAngle(wrap(self.0 - normal.0))
    }
}

/// α = θ − θ′ (eq. 1), in [−π, π).
impl Sub<LocalAngle> for WorldAngle {
    type Output = NormalAngle;
    fn sub(self, local: LocalAngle) -> NormalAngle {
        NormalAngle(wrap(self.0 - local.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_the_direction_and_the_range() {
        for turns in -3..=3 {
            for k in 0..360 {
                let a = f64::from(k).to_radians() - PI;
                let w = wrap(a + f64::from(turns) * TAU);
                assert!((-PI..PI).contains(&w));
                // Three turns lose about 3·2π·2⁻⁵² of absolute precision; −π and π are one direction.
                let difference = (w - a).abs();
                assert!(difference < 1e-14 || (difference - TAU).abs() < 1e-14);
            }
        }
        assert_eq!(wrap(PI), -PI);
        assert_eq!(wrap(-1e-18), 0.0);
    }

    #[test]
    fn local_angles_follow_equation_1() {
        let normal = NormalAngle::degrees(170.0);
        let exitant = WorldAngle::degrees(-150.0);
        let local = exitant - normal;
        assert!((local.deg() - 40.0).abs() < 1e-12);
        assert!(((normal + local).wrapped().deg() - -150.0).abs() < 1e-12);
    }
}

//! What a capture says about a quantity.

use serde::{Deserialize, Serialize};

/// How well the data determine a recovered quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// The data alone fix it, well above the noise.
    Determined,
    /// The data say something about it, and the prior a good part of the rest.
    Weak,
    /// The data say nothing about it: its value is the prior's, or 0.
    Indeterminate,
}

impl Status {
    /// The word in the files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Determined => "determined",
            Self::Weak => "weak",
            Self::Indeterminate => "indeterminate",
        }
    }
}

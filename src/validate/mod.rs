//! Truth against estimate: Monte-Carlo studies and the paper's own results.

pub mod paper;
pub mod study;

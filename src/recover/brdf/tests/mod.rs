//! Planted BRDFs come back within their error bars.

mod captures;
mod coverage;
mod gaps;
mod invariance;
mod planted;

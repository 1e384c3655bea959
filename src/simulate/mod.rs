//! Synthetic capture sets: the exact forward model through a camera's faults.

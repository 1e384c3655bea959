//! Recipes, the order of the stages, products and provenance.

//! The published evaluator's values.

mod published;
mod reference_builds;

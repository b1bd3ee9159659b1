//! Texts for people: suggestions for misspelt names, and counts with their nouns.

pub use plumbline_engine::text::{agreeing, counted, did_you_mean, nearest, reworded};

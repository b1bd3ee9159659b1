//! Accuracy: material, shape and size.

pub mod material;
pub mod shape;
pub mod size;

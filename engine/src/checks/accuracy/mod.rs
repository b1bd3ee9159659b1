//! Accuracy: material, shape and size.

pub mod blocks;
pub mod material;
pub mod shape;
pub mod size;

//! Planning: efficiency and dependency.

pub mod dependency;
pub mod efficiency;
pub mod layers;

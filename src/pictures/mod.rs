//! Pictures of builds.

pub mod colours;
pub mod isometric;
pub mod raster;

//! Middleware around every route.

pub mod layers;
pub mod observe;
pub mod queries;
pub mod rates;

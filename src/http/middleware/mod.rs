//! Middleware around the router.

pub mod front;
mod near;
pub mod observe;
pub mod queries;
pub mod rates;
mod route;
mod unrewarded;

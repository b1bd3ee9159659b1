//! All limits of the service: enforced where named, and served at `/v1/limits`.

mod defaults;
mod members;

pub use defaults::LIMITS;
pub use members::Limits;

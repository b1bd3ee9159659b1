//! The service itself: limits, health, metrics and the OpenAPI document.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod agent_guide;
pub mod blocks;
pub mod documents;
pub mod health;
pub mod limits;
pub mod profiles;

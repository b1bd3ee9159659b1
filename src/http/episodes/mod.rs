//! Episodes: attempts at a task turn by turn, in a world that the service keeps.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod resource;
pub mod steps;
pub mod views;

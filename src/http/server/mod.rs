//! The server: accepting connections, and closing those that take nothing.

pub mod accept;
pub mod impatient;

//! The server: accepts connections, and closes those whose clients stop reading.

pub mod accept;
pub mod impatient;

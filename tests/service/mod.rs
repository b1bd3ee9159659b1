//! The service as operators and generators of clients see it.

mod clients;
mod observing;
mod openapi;

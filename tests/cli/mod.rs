//! Commands.

mod demo;
mod operators;
mod tasks;

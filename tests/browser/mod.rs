//! Pages in a real browser.

mod accessibility;
mod driver;
mod journeys;
mod pages;

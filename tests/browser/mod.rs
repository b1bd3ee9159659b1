//! Pages in a real browser.

mod journeys;
mod pages;

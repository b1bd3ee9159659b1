//! Pages in a real browser.

mod accessibility;
mod driver;
mod following;
mod journeys;
mod pages;

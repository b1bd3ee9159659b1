//! Progress bars for long work: on a terminal only, on standard error.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar over `total` steps. Draws nothing where standard error is not a terminal.
#[must_use]
pub fn bar(total: usize, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(total as u64).with_message(what);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}") {
        bar.set_style(style);
    }
    bar
}

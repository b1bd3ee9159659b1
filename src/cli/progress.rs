//! Progress bars for long operations, shown on standard error if it is a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// Creates a bar of `total` steps, which draws nothing if standard error is not a terminal.
#[must_use]
pub fn bar(total: usize, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(total as u64).with_message(what);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}") {
        bar.set_style(style);
    }
    bar
}

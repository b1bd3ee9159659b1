//! Code that all pages share: responses and the formatting of numbers.

use std::fmt::Write as _;

use askama::Template;
use axum::response::{IntoResponse, Response};

use crate::app::error::AppError;
use crate::http::error_page::{page_headers, page_of};
use crate::http::extract::origin::Origin;
use crate::http::problem::Problem;
use plumbline_engine::grading::statistics::interval::Interval;
use plumbline_engine::grading::statistics::ranks::RankRange;
use plumbline_engine::hidden::gauge::Gauge;

pub use plumbline_engine::text::counted;

/// What messengers and feeds show of a page.
pub struct Preview {
    /// Origin of the service.
    pub origin: Origin,
    /// Path of the page.
    pub path: String,
    /// Title.
    pub title: String,
    /// Path of a picture.
    pub image: Option<String>,
}

/// Result of a page handler.
pub type PageResult = Result<Response, PageError>;

/// An error that is rendered as a page.
#[derive(Debug)]
pub struct PageError(AppError);

impl<E: Into<AppError>> From<E> for PageError {
    fn from(error: E) -> Self {
        Self(error.into())
    }
}

impl IntoResponse for PageError {
    fn into_response(self) -> Response {
        page_of(&Problem::from(self.0.clone())).unwrap_or_else(|| self.0.into_response())
    }
}

/// Renders a page as a response.
pub fn page(template: &impl Template) -> PageResult {
    let text = template.render().map_err(|error| AppError::internal(&error))?;
    Ok((page_headers(), text).into_response())
}

/// Parameters that other sites add to links, so that they know who followed them.
const TRACKERS: [&str; 14] = [
    "fbclid",
    "gclid",
    "gbraid",
    "wbraid",
    "dclid",
    "msclkid",
    "twclid",
    "ttclid",
    "li_fat_id",
    "igshid",
    "yclid",
    "mc_cid",
    "mc_eid",
    "ref",
];

/// Returns a query without its empty fields and without what other sites add to links: an empty field of a form is not set.
#[must_use]
pub fn set_fields(raw: Option<&str>) -> String {
    let is_set = |name: &str, value: &str| !value.is_empty() && !name.starts_with("utm_") && !TRACKERS.contains(&name);
    let fields = form_urlencoded::parse(raw.unwrap_or_default().as_bytes()).filter(|(name, value)| is_set(name, value));
    form_urlencoded::Serializer::new(String::new()).extend_pairs(fields).finish()
}

/// Escapes text for markup, and for XML, in which two of the characters that names may have cannot stand.
#[must_use]
pub fn escaped(text: &str) -> String {
    let text = text.replace(['\u{fffe}', '\u{ffff}'], "");
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Formats a share as a percentage; `n/a` for `None`.
#[must_use]
pub fn percent(rate: Option<f64>) -> String {
    rate.map_or_else(|| "n/a".to_owned(), |rate| format!("{:.1} %", rate * 100.0))
}

/// Writes a name of the API as words.
#[must_use]
pub fn words(name: &str) -> String {
    name.replace('_', " ")
}

/// Formats a probability to four digits.
#[must_use]
pub fn probability(p: f64) -> String {
    const LEAST: f64 = 1e-4;
    if p < LEAST { format!("< {LEAST:.4}") } else { format!("{p:.4}") }
}

/// Formats a duration with its units, such as `1 day 1 hour`.
#[must_use]
pub fn duration(seconds: i64) -> String {
    let units = [
        (seconds / 86_400, "day"),
        (seconds / 3_600 % 24, "hour"),
        (seconds / 60 % 60, "minute"),
        (seconds % 60, "second"),
    ];
    let told = units.iter().filter(|(count, _)| *count > 0).map(|(count, unit)| counted(*count, unit));
    let told: Vec<String> = told.collect();
    if told.is_empty() { counted(0, "second") } else { told.join(" ") }
}

/// Formats the bounds of an interval as percentages; empty for `None`.
#[must_use]
pub fn bounds(interval: Option<Interval>) -> String {
    interval.map_or_else(String::new, |i| format!("{:.1} to {:.1}", i.low * 100.0, i.high * 100.0))
}

/// Formats how much better an agent solves public siblings than hidden instances, in points with their interval; a dash
/// for `None`.
#[must_use]
pub fn gap(gauge: Option<Gauge>) -> String {
    let points = |share: f64| format!("{:+.0}", share * 100.0).replace('-', "−");
    gauge.map_or_else(
        || "–".to_owned(),
        |own| format!("{} ({} to {})", points(own.gap), points(own.interval.low), points(own.interval.high)),
    )
}

/// Formats a rank or a range of ranks; a dash for `None`, which stands for a run that is not compared.
#[must_use]
pub fn places(range: Option<RankRange>) -> String {
    let Some(range) = range else { return "–".to_owned() };
    if range.first == range.last { range.first.to_string() } else { format!("{}–{}", range.first, range.last) }
}

/// Returns the colour level of a share, from 0 to 4; empty for `None`.
#[must_use]
pub fn heat(rate: Option<f64>) -> String {
    rate.map_or_else(String::new, |rate| ((rate * 5.0) as u8).min(4).to_string())
}

/// Draws a share and its interval as a bar, in SVG.
#[must_use]
pub fn bar(rate: Option<f64>, interval: Option<Interval>) -> String {
    let mut svg = String::from(
        "<svg class=\"bar\" viewBox=\"0 0 100 10\" preserveAspectRatio=\"none\" aria-hidden=\"true\"><rect class=\"track\" width=\"100\" height=\"10\"/>",
    );
    // Writing to a string cannot fail.
    if let Some(Interval { low, high }) = interval {
        let (x, width) = (low * 100.0, (high - low) * 100.0);
        let _ = write!(svg, "<rect class=\"range\" x=\"{x:.2}\" width=\"{width:.2}\" height=\"10\"/>");
    }
    if let Some(rate) = rate {
        let x = (rate * 100.0 - 0.75).clamp(0.0, 98.5);
        let _ = write!(svg, "<rect class=\"point\" x=\"{x:.2}\" width=\"1.5\" height=\"10\"/>");
    }
    svg + "</svg>"
}

/// Serializes JSON with `<`, `>` and `&` escaped, so that nothing in it can end the element that contains it.
#[must_use]
pub fn json_in_markup(value: &serde_json::Value) -> String {
    value.to_string().replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_probabilities_and_long_times_are_told_for_people() {
        assert_eq!([probability(0.0), probability(0.000_09), probability(0.0312)], ["< 0.0001", "< 0.0001", "0.0312"]);
        assert_eq!([duration(86_400), duration(90_060), duration(0)], ["1 day", "1 day 1 hour 1 minute", "0 seconds"]);
    }
}

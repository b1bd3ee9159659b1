//! Formats of a board page: JSON, CSV, NDJSON and Markdown.

use std::borrow::Cow;

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use super::body::{BoardBody, BoardRow};
use crate::app::error::{AppError, AppResult};
use crate::http::extract::conditional::Document;

/// Format of a board page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// One JSON document.
    #[default]
    Json,
    /// Comma-separated values with a header line.
    Csv,
    /// One JSON object per row and line.
    Ndjson,
    /// A table in Markdown.
    Markdown,
}

/// Columns of the CSV table: the members of [`Line`].
const COLUMNS: [&str; 27] = [
    "rank",
    "first_place",
    "last_place",
    "run",
    "agent",
    "overall",
    "overall_low",
    "overall_high",
    "accuracy",
    "material",
    "shape",
    "size",
    "physical_plausibility",
    "dependency",
    "structural_stability_mean",
    "structural_stability_mean_accurate",
    "efficiency_mean",
    "efficiency_mean_accurate",
    "coverage",
    "skipped",
    "attempts",
    "provenance",
    "profile",
    "track",
    "similar_to",
    "finished_at",
    "anonymous_until",
];

/// A row of the CSV table.
#[derive(Serialize)]
struct Line<'a> {
    rank: Option<usize>,
    first_place: Option<usize>,
    last_place: Option<usize>,
    run: &'a str,
    agent: Cow<'a, str>,
    overall: Option<f64>,
    overall_low: Option<f64>,
    overall_high: Option<f64>,
    accuracy: Option<f64>,
    material: Option<f64>,
    shape: Option<f64>,
    size: Option<f64>,
    physical_plausibility: Option<f64>,
    dependency: Option<f64>,
    structural_stability_mean: Option<f64>,
    structural_stability_mean_accurate: Option<f64>,
    efficiency_mean: Option<f64>,
    efficiency_mean_accurate: Option<f64>,
    coverage: Option<f64>,
    skipped: usize,
    attempts: usize,
    provenance: &'a str,
    profile: &'a str,
    track: &'static str,
    similar_to: String,
    finished_at: &'a str,
    anonymous_until: Option<&'a str>,
}

impl<'a> From<&'a BoardRow> for Line<'a> {
    fn from(row: &'a BoardRow) -> Self {
        Self {
            rank: row.rank,
            first_place: row.places.map(|places| places.first),
            last_place: row.places.map(|places| places.last),
            run: &row.run,
            agent: as_text(&row.agent),
            overall: row.overall.rate,
            overall_low: row.interval.map(|interval| interval.low),
            overall_high: row.interval.map(|interval| interval.high),
            accuracy: row.accuracy.rate,
            material: row.problems.material.rate,
            shape: row.problems.shape.rate,
            size: row.problems.size.rate,
            physical_plausibility: row.problems.physical_plausibility.rate,
            dependency: row.problems.dependency.rate,
            structural_stability_mean: row.graded.stress.mean,
            structural_stability_mean_accurate: row.graded.stress_accurate.mean,
            efficiency_mean: row.graded.efficiency.mean,
            efficiency_mean_accurate: row.graded.efficiency_accurate.mean,
            coverage: row.coverage.rate,
            skipped: row.skipped,
            attempts: row.attempts,
            provenance: &row.provenance,
            profile: &row.profile,
            track: row.track.name(),
            similar_to: row.similar_to.join(" "),
            finished_at: &row.finished_at,
            anonymous_until: row.anonymous_until.as_deref(),
        }
    }
}

/// Escapes a text for spreadsheets: prepends an apostrophe to a text that they would evaluate as a formula.
pub fn as_text(text: &str) -> Cow<'_, str> {
    if text.starts_with(['=', '+', '-', '@', '\t', '\r', '\n']) { format!("'{text}").into() } else { text.into() }
}

/// Writes a page of a board in the given format.
///
/// # Errors
/// Returns an error (500) if the page cannot be serialized.
pub fn render(body: &BoardBody, format: Format) -> AppResult<Document> {
    match format {
        Format::Json => Document::json(body),
        Format::Csv => {
            // The writer takes the header from the first row; without rows it has none.
            let mut table = csv::WriterBuilder::new().has_headers(!body.rows.is_empty()).from_writer(Vec::new());
            if body.rows.is_empty() {
                table.write_record(COLUMNS).map_err(|error| AppError::internal(&error))?;
            }
            for row in &body.rows {
                table.serialize(Line::from(row)).map_err(|error| AppError::internal(&error))?;
            }
            let bytes = table.into_inner().map_err(|error| AppError::internal(&error))?;
            Ok(Document { kind: "text/csv; charset=utf-8", bytes: bytes.into() })
        }
        Format::Ndjson => {
            let mut lines = Vec::new();
            for row in &body.rows {
                serde_json::to_writer(&mut lines, row).map_err(|error| AppError::internal(&error))?;
                lines.push(b'\n');
            }
            Ok(Document { kind: "application/x-ndjson", bytes: Bytes::from(lines) })
        }
        Format::Markdown => Ok(Document { kind: "text/markdown; charset=utf-8", bytes: markdown(body).into() }),
    }
}

/// Writes a page of a board as a table for READMEs and papers: what most readers compare.
fn markdown(body: &BoardBody) -> String {
    let mut table = format!(
        "| Rank | Agent | {} | 95 % interval | Material | Shape | Size | Plausibility | Dependency | Finished |\n\
         | ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |\n",
        in_cell(&body.suite)
    );
    let percent = |rate: Option<f64>| rate.map_or_else(|| "n/a".to_owned(), |rate| format!("{:.1}", rate * 100.0));
    for row in &body.rows {
        let places = row.places.map_or_else(String::new, |places| match (places.first, places.last) {
            (first, last) if first == last => first.to_string(),
            (first, last) => format!("{first}–{last}"),
        });
        let interval = row
            .interval
            .map_or_else(String::new, |it| format!("{} to {}", percent(Some(it.low)), percent(Some(it.high))));
        let per = &row.problems;
        let rates = [per.material, per.shape, per.size, per.physical_plausibility, per.dependency];
        let rates = rates.map(|rate| percent(rate.rate)).join(" | ");
        let (agent, overall, day) = (in_cell(&row.agent), percent(row.overall.rate), &row.finished_at[..10]);
        table.extend([format!("| {places} | {agent} | {overall} | {interval} | {rates} | {day} |\n")]);
    }
    table
}

/// Escapes a text for a cell of a Markdown table.
fn in_cell(text: &str) -> String {
    let escaped = |c: char| match c {
        // On code hosts these call people, begin formulas and pictures, or make links.
        '@' | '$' | ':' | '/' => format!("&#{};", u32::from(c)),
        c if c.is_control() => " ".to_owned(),
        c if "\\`*_{}[]<>()#+-.!|&~".contains(c) => format!("\\{c}"),
        c => c.to_string(),
    };
    text.chars().map(escaped).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_a_markdown_table() {
        assert_eq!(in_cell("a|b"), "a\\|b");
        assert_eq!(in_cell("<img>\n[x](y)"), "\\<img\\> \\[x\\]\\(y\\)");
        assert_eq!(in_cell("агент 1"), "агент 1");
        assert_eq!(in_cell("@ada https://x"), "&#64;ada https&#58;&#47;&#47;x");
    }

    #[test]
    fn names_are_no_formulas() {
        for name in ["=HYPERLINK(\"http://x\")", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"] {
            assert_eq!(as_text(name), format!("'{name}"));
        }
        assert_eq!(as_text("agent-1 = good"), "agent-1 = good");
    }
}

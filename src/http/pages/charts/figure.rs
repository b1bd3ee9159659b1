//! A chart with its numbers as a table.

use crate::app::error::{AppError, AppResult};
use crate::http::boards::formats::as_text;

/// A chart with its numbers.
pub struct Figure {
    /// What it shows.
    pub title: &'static str,
    /// What can be read from it, in a sentence.
    pub about: String,
    /// The chart as an SVG file.
    pub svg: String,
    /// Size of the chart, in pixels.
    pub size: [f64; 2],
    /// Names of the columns.
    pub head: Vec<String>,
    /// Columns of the CSV, if it has others than the table.
    pub columns: Option<Vec<String>>,
    /// Rows of the table.
    pub rows: Vec<FigureRow>,
}

/// Writes a share for programs; empty if there is none.
#[must_use]
pub fn share(value: Option<f64>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}

/// A row of the table of a chart.
pub struct FigureRow {
    /// Agent of the row, or what else it is about.
    pub name: String,
    /// Run of the row, if it is about one.
    pub run: Option<String>,
    /// Values under the columns after the first.
    pub cells: Vec<String>,
    /// The same values for programs: shares from 0 to 1, times in RFC 3339.
    pub values: Vec<String>,
}

impl Figure {
    /// Returns the numbers as CSV, with the run of each row if rows have runs.
    ///
    /// # Errors
    /// Returns an error if the table cannot be written.
    pub fn csv(&self) -> AppResult<String> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let has_runs = self.rows.iter().any(|row| row.run.is_some());
        let run = |run: &str| has_runs.then(|| run.to_owned());
        let head = self.columns.as_ref().unwrap_or(&self.head).iter().cloned().chain(run("run"));
        writer.write_record(head).map_err(|error| AppError::internal(&error))?;
        for row in &self.rows {
            let cells = [as_text(&row.name).into_owned()].into_iter().chain(row.values.iter().cloned());
            let cells = cells.chain(run(row.run.as_deref().unwrap_or_default()));
            writer.write_record(cells).map_err(|error| AppError::internal(&error))?;
        }
        let bytes = writer.into_inner().map_err(|error| AppError::internal(&error))?;
        String::from_utf8(bytes).map_err(|error| AppError::internal(&error))
    }
}

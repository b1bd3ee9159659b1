//! Results that others have reported for these suites, shown beside boards for comparison. They were not graded here.

use serde::{Deserialize, Serialize};

use super::embedded::{FULL, LITE_SUFFIX};

/// Results reported for one agent. Means and spreads are in percent, per criterion in the paper's order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReportedRow {
    /// Name of the model, or of the group of people, that built.
    pub agent: String,
    /// Number of problems solved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solved: Option<usize>,
    /// Number of problems that `solved` is out of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<usize>,
    /// Problems solved, in percent, if the source gives no counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overall: Option<f64>,
    /// Mean score per criterion, in percent.
    pub means: Vec<f64>,
    /// Half the range of each mean over seeds or people, in percentage points; empty if not reported.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spreads: Vec<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    full: Vec<ReportedRow>,
    lite: Vec<ReportedRow>,
}

/// Returns the results reported for the suite of this name, whatever its version.
///
/// # Errors
/// Returns an error if the embedded file is faulty; a test shows that it is not.
pub fn on(suite_name: &str) -> Result<Vec<ReportedRow>, toml::de::Error> {
    let file: File = toml::from_str(include_str!("../../../tasks/reported.toml"))?;
    Ok(match suite_name.strip_prefix(FULL) {
        Some("") => file.full,
        Some(LITE_SUFFIX) => file.lite,
        _ => Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use crate::tasks::reported::on;

    #[test]
    fn the_papers_rows_are_there() {
        let full = on("mineceraft").unwrap();
        assert_eq!(full.iter().map(|row| row.solved.unwrap()).collect::<Vec<_>>(), [286, 277, 192, 3]);
        let lite = on("mineceraft-lite").unwrap();
        assert_eq!(lite.len(), 16, "fifteen models, and people");
        assert!(lite.iter().chain(&full).all(|row| row.means.len() == 7));
        assert!(lite.iter().all(|row| row.spreads.len() == 7));
        assert!(on("another").unwrap().is_empty());
    }
}

//! Results that others report on these suites, to read a board by. They were not graded here.

use serde::{Deserialize, Serialize};

use super::embedded::{FULL, LITE_SUFFIX};

/// A reported row. Means and spreads are in percent, per criterion in the paper's order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReportedRow {
    /// Who built.
    pub agent: String,
    /// Problems solved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solved: Option<usize>,
    /// Of how many.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<usize>,
    /// Problems solved, in percent, where that is all that is told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overall: Option<f64>,
    /// Mean score per criterion.
    pub means: Vec<f64>,
    /// Half the range over seeds or people.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spreads: Vec<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    full: Vec<ReportedRow>,
    lite: Vec<ReportedRow>,
}

/// What is reported on the suite of this name, whatever its version.
///
/// # Errors
/// A fault of the file in the binary; a test shows that there is none.
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

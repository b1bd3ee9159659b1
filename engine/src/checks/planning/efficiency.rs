//! Efficiency: how little the builder moves between blocks (`docs/rules.md#efficiency`; paper, algorithm "Path
//! Efficiency").

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;

/// Ratio of the shortest possible path to the path taken, both in L1 distances between consecutive blocks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct L1Distance {}

impl Rule for L1Distance {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let cells = subject.structure.cells();
        let steps = || cells.iter().zip(cells.iter().skip(1));
        let shortest = cells.len().saturating_sub(1);
        let required = subject.tell(|| json!({ "path": shortest }));
        let length: i64 = steps().map(|(a, b)| a.l1_distance(*b)).sum();
        if cells.len() <= 1 || length <= 0 {
            return Finding::graded(1.0, length, required, "there is no path to measure").vacuous_if(true);
        }
        let summary =
            subject.tell(|| format!("path of {}; the shortest possible is {shortest}", counted(length, "cell")));
        let mut finding = Finding::graded(shortest as f64 / length as f64, length, required, summary);
        for (a, b) in steps() {
            if a.l1_distance(*b) > 1 {
                finding.add_witness(*b, "reached by a jump");
            }
        }
        finding
    }
}

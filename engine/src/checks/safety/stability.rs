//! Structural stability: greatest von Mises stress against a reference (`docs/rules.md#structural-stability`,
//! `docs/rules.md#stress`; paper, section 4.2).
//!
//! The published method determines the score. Because it has artefacts, the finding also reports the well-posed method.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::figures::{FemFigures, SphFigures, StressFigures};
use crate::checks::{Amount, Finding, Subject};
use crate::elasticity::{Stopped, fem, sph};

/// Ratio of the reference to the greatest stress, at most 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StressScore {
    /// Greatest von Mises stress of an ideal build, in Pa.
    #[serde(rename = "von_mises_stress")]
    pub reference_pa: Amount,
}

impl StressScore {
    /// Scores the structure.
    ///
    /// # Errors
    /// Returns an error if the subject's control stops the computation before it is complete.
    pub fn evaluate(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        let required = json!({ "<=": self.reference_pa });
        if subject.structure.is_empty() {
            return Ok(Finding::nothing_stands(false, required));
        }
        let cells = subject.structure.cells();
        let outcome = sph::simulate(cells, subject.control)?;
        let equilibrium = fem::solve_equilibrium(cells, subject.control)?;
        let stress_pa = outcome.max_von_mises_pa;
        let is_usable = stress_pa.is_finite() && stress_pa > 0.0;
        let has_result = is_usable || stress_pa == 0.0 && !outcome.diagnostics.order_sensitive;
        let score = if is_usable { self.reference_pa.0 / stress_pa } else { 0.0 };
        let beside = equilibrium.max_von_mises_pa.map_or_else(|| "none".to_owned(), |pa| format!("{pa:.2} Pa"));
        let greatest = match (is_usable, has_result) {
            (true, _) => format!("greatest von Mises stress {stress_pa:.2} Pa"),
            (false, true) => "the published simulation finds no stress, which scores 0".to_owned(),
            (false, false) => "the published simulation has no defined result, which scores 0".to_owned(),
        };
        let summary = format!("{greatest} (in equilibrium, by fem: {beside}); reference {} Pa", self.reference_pa);
        let measured = if has_result { json!(stress_pa) } else { Value::Null };
        let mut finding = Finding::graded(score, measured, required, summary);
        if let Some(most) = outcome.most_stressed {
            finding.add_witness(cells[most], "greatest stress");
        }
        finding.cautions = outcome.diagnostics.cautions();
        let figures = StressFigures { sph: SphFigures::of(cells, &outcome), fem: FemFigures::of(cells, &equilibrium) };
        finding.stress = Some(Box::new(figures));
        Ok(finding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::{Cell, Structure};

    #[test]
    fn a_build_without_a_stress_says_why_it_scores_0() {
        let rule = StressScore { reference_pa: Amount(1e6) };
        let found = |cells: &[[i32; 3]]| {
            let structure = Structure::from_named(cells.iter().map(|[x, y, z]| (Cell::new(*x, *y, *z), "stone")));
            rule.evaluate(&Subject::unhurried(&structure)).unwrap()
        };
        let one = found(&[[0, 0, 0]]);
        assert_eq!((one.score, one.measured), (0.0, json!(0.0)));
        assert!(
            one.summary.starts_with("the published simulation finds no stress, which scores 0 (in"),
            "{}",
            one.summary
        );
        let two = found(&[[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 0, 1], [0, 1, 1], [1, 0, 1], [1, 1, 1]]);
        assert!(two.summary.starts_with("greatest von Mises stress ") && two.score > 0.0, "{}", two.summary);
    }
}

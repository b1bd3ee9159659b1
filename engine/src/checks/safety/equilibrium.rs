//! Strict rule for stability: stress in equilibrium, which is also defined for parts one block thick
//! (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::checks::{Amount, Finding, Subject};
use crate::elasticity::{Stopped, fem};
use crate::text::agreeing;

/// Ratio of the reference to the greatest von Mises stress in equilibrium, at most 1. A structure with unsupported
/// blocks has no equilibrium and scores 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EquilibriumScore {
    /// Greatest von Mises stress of the reference build by the same method, Pa.
    pub reference_pa: Amount,
}

/// Relative tolerance within which a stress above the reference still scores 1. It covers the solver's tolerance and
/// the order of the blocks.
const TOLERANCE: f64 = 1e-3;

impl EquilibriumScore {
    /// Scores the structure.
    ///
    /// # Errors
    /// Returns an error if the subject's control stops the computation before the equations are solved.
    pub fn evaluate(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        let required = json!({ "<=": self.reference_pa });
        if subject.structure.is_empty() {
            return Ok(Finding::nothing_stands(false, required));
        }
        let cells = subject.structure.cells();
        let outcome = fem::solve_equilibrium(cells, subject.control)?;
        let unsupported = || outcome.unsupported.iter().map(|&entry| cells[entry as usize]);
        let Some(stress_pa) = outcome.max_von_mises_pa.filter(|_| outcome.unsupported.is_empty()) else {
            let summary = format!(
                "{} not supported: there is no equilibrium",
                agreeing(outcome.unsupported.len(), "block is", "blocks are")
            );
            return Ok(
                Finding::binary(false, Value::Null, required, summary).with_witnesses(unsupported(), "unsupported")
            );
        };
        let ratio = self.reference_pa.0 / stress_pa;
        let score = if ratio >= 1.0 - TOLERANCE { 1.0 } else { ratio };
        let summary =
            format!("greatest von Mises stress {stress_pa:.2} Pa in equilibrium; reference {} Pa", self.reference_pa);
        let most = outcome.most_stressed.map(|entry| cells[entry]);
        Ok(Finding::graded(score, stress_pa, required, summary).with_witnesses(most, "greatest stress"))
    }
}

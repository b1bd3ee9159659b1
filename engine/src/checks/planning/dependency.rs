//! Dependency: materials appear in a required order (`docs/rules.md#dependency`; paper, algorithm "Material Sequence
//! Order").

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::of_all;

/// Check that the blocks, in building order, contain the named materials one after another.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialSequenceOrder {
    /// Names of the materials in the required order.
    pub material_sequence: Vec<String>,
    /// Whether a block matches if its name merely contains the wanted one.
    #[serde(default = "yes")]
    pub use_substring_match: bool,
}

const fn yes() -> bool {
    true
}

impl Rule for MaterialSequenceOrder {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let wanted = &self.material_sequence;
        let required = subject.tell(|| json!({ "sequence": wanted }));
        if wanted.is_empty() {
            return Finding::binary(true, 0, required, "no order is required").vacuous_if(true);
        }
        if subject.structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let matches = |name: &str, wanted: &str| {
            !name.is_empty()
                && !wanted.is_empty()
                && if self.use_substring_match { name.contains(wanted) } else { name == wanted }
        };
        let palette = subject.structure.palette();
        let mut met = Vec::new();
        let mut next = wanted.iter();
        let mut mask = next.next().map(|name| palette.mask(|n| matches(n, name)));
        for (cell, id) in subject.structure.entries() {
            let Some(current) = &mask else { break };
            if current[id as usize] {
                met.push(cell);
                mask = next.next().map(|name| palette.mask(|n| matches(n, name)));
            }
        }
        let holds = met.len() == wanted.len();
        let summary = match wanted.get(met.len()) {
            None if wanted.len() == 1 => "the only material of the sequence appears".to_owned(),
            None => format!("all {} materials appear in order", wanted.len()),
            Some(missing) if met.is_empty() => format!("no {missing:?} to begin with"),
            Some(missing) => {
                let appear = of_all(met.len(), wanted.len(), "material", "appears", "appear");
                format!("{appear} in order; no {missing:?} follows")
            }
        };
        let mut finding = Finding::binary(holds, met.len(), required, summary);
        for (cell, name) in met.into_iter().zip(wanted) {
            finding.add_witness(cell, &format!("next {name} in the sequence"));
        }
        finding
    }
}

//! Strict rule for dependency: layers follow one another without overlap (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::blocks::BlockSet;

/// Check that every layer has enough blocks, and that no block of a later layer precedes the last one of an earlier
/// layer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayersFollow {
    /// Blocks that make up each layer, in building order.
    pub layers: Vec<BlockSet>,
    /// Least number of blocks in each layer.
    #[serde(default = "one")]
    pub min_blocks: u32,
}

const fn one() -> u32 {
    1
}

impl Rule for LayersFollow {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let structure = subject.structure;
        let required = subject.tell(|| json!({ "sequence": self.layers, "overlap": false }));
        if structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let mut last_end = None;
        for (i, layer) in self.layers.iter().enumerate() {
            let own = structure.palette().mask(|name| layer.has(name));
            let mut count = 0;
            let (mut first, mut last) = (None, None);
            let ids = structure.material_ids().iter();
            for (at, _) in ids.enumerate().filter(|(_, id)| own[**id as usize]) {
                count += 1;
                first = first.or(Some(at));
                last = Some(at);
            }
            if count < self.min_blocks as usize {
                let summary = subject.tell(|| {
                    format!("{} of {layer}, where at least {} must be", counted(count, "block"), self.min_blocks)
                });
                return Finding::binary(false, i, required, summary);
            }
            if let (Some(first), Some(end)) = (first, last_end)
                && first < end
            {
                let summary = subject.tell(|| format!("{layer} begins before {} is complete", self.layers[i - 1]));
                let earlier = structure.palette().mask(|name| self.layers[i - 1].has(name));
                let late =
                    structure.entries().skip(first).filter(|(_, id)| earlier[*id as usize]).map(|(cell, _)| cell);
                return Finding::binary(false, i, required, summary)
                    .with_witnesses(late, "comes too late")
                    .with_witnesses([structure.cells()[first]], "begins too early");
            }
            last_end = last.or(last_end);
        }
        let summary = match self.layers.len() {
            _ if last_end.is_none() => "no block of any layer stands, and none is required".to_owned(),
            1 => "the only layer is complete".to_owned(),
            all => format!("{all} layers follow one another"),
        };
        Finding::binary(true, self.layers.len(), required, summary).vacuous_if(last_end.is_none())
    }
}

//! Mirror symmetry about the centre of the bounding box (`docs/rules.md#shape`). Materials do not matter.

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::voxel::{Cell, Structure};

/// Check that the build is its own mirror image along x, y or z.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasAxisSymmetry {}

/// Check that the build is not its own mirror image along any axis.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasNoAxisSymmetry {}

/// Function that returns the mirror image of a cell.
type Mirror = Box<dyn Fn(Cell) -> Cell>;

/// Returns the axes along which the build is symmetric, and for each other axis a cell whose mirror image is missing.
/// Skips axes along which the build is one block thick.
fn symmetries(structure: &Structure) -> (Vec<&'static str>, Vec<Cell>) {
    let Some(bounds) = structure.bounds() else { return (Vec::new(), Vec::new()) };
    let (low, high) = (bounds.min, bounds.max);
    let axes: [(&str, i64, Mirror); 3] = [
        ("x", bounds.extent()[0], Box::new(move |c| Cell::new(low.x + high.x - c.x, c.y, c.z))),
        ("y", bounds.extent()[1], Box::new(move |c| Cell::new(c.x, low.y + high.y - c.y, c.z))),
        ("z", bounds.extent()[2], Box::new(move |c| Cell::new(c.x, c.y, low.z + high.z - c.z))),
    ];
    let mut symmetric = Vec::new();
    let mut unmatched = Vec::new();
    for (name, extent, mirror) in &axes {
        if *extent == 0 {
            continue;
        }
        match structure.cells().iter().find(|cell| !structure.contains(mirror(**cell))) {
            None => symmetric.push(*name),
            Some(&cell) => unmatched.push(cell),
        }
    }
    (symmetric, unmatched)
}

fn symmetry_finding(subject: &Subject<'_>, wanted: bool) -> Finding {
    let required = subject.tell(|| json!({ "symmetric": wanted }));
    if subject.structure.is_empty() {
        return Finding::nothing_stands(wanted, required);
    }
    let (axes, unmatched) = symmetries(subject.structure);
    let summary = if axes.is_empty() {
        "no mirror symmetry along x, y or z".to_owned()
    } else {
        format!("mirror symmetry along {}", axes.join(", "))
    };
    let holds = axes.is_empty() != wanted;
    let finding = Finding::binary(holds, json!(axes), required, summary);
    if wanted && !holds { finding.with_witnesses(unmatched, "no mirror image") } else { finding }
}

impl Rule for HasAxisSymmetry {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        symmetry_finding(subject, true)
    }
}

impl Rule for HasNoAxisSymmetry {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        symmetry_finding(subject, false)
    }
}

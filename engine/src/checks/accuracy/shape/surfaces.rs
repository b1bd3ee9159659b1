//! Surface concavity: some slice of the top or bottom surface bulges (`docs/rules.md#surfaces`; paper, algorithm
//! "Surface Concavity").
//!
//! The published rule requires every point of the slice to lie above (below) every chord, with heights interpolated by
//! index. Heights are integers, so this is equivalent to a second difference of the right sign at every interior point:
//! a point below a chord lies below it by at least one divided by the slice's length, far more than the rule's 1e-9,
//! and then some point lies below the chord of its two neighbours.

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::voxel::Cell;
use crate::voxel::surface::{Side, Slice, slices};

/// Degree to which a slice must bulge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(from = "StrictArgument", into = "StrictArgument")]
pub enum Strictness {
    /// Straight and flat parts are allowed; a slice of one column passes.
    #[default]
    Lenient,
    /// Straight parts are allowed, but not a flat slice; needs at least two columns.
    NonFlat,
    /// Every interior point lies beyond every chord, and no two neighbours are level; needs at least two columns.
    Strict,
}

#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "expected true, false or \"non-flat\"")]
enum StrictArgument {
    Flag(bool),
    Word(StrictWord),
}

#[derive(Serialize, Deserialize)]
enum StrictWord {
    #[serde(rename = "non-flat")]
    NonFlat,
}

impl From<StrictArgument> for Strictness {
    fn from(argument: StrictArgument) -> Self {
        match argument {
            StrictArgument::Flag(false) => Self::Lenient,
            StrictArgument::Flag(true) => Self::Strict,
            StrictArgument::Word(StrictWord::NonFlat) => Self::NonFlat,
        }
    }
}

impl From<Strictness> for StrictArgument {
    fn from(strictness: Strictness) -> Self {
        match strictness {
            Strictness::Lenient => Self::Flag(false),
            Strictness::Strict => Self::Flag(true),
            Strictness::NonFlat => Self::Word(StrictWord::NonFlat),
        }
    }
}

/// Check that some slice of the upper surface bulges up.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TopSurfaceConcave {
    /// Degree to which the slice must bulge.
    #[serde(default)]
    pub strict: Strictness,
}

/// Check that some slice of the lower surface bulges down: the published rule, which rejects the underside of a true
/// arch.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BottomSurfaceConcave {
    /// Degree to which the slice must bulge.
    #[serde(default)]
    pub strict: Strictness,
}

/// Returns the first column at which the slice breaks the rule, or `None` if the rule holds.
fn first_break(slice: &Slice, sign: i32, strictness: Strictness) -> Option<usize> {
    let heights = &slice.heights;
    if strictness != Strictness::Lenient && heights.len() < 2 {
        return Some(0);
    }
    if strictness == Strictness::NonFlat && heights.iter().all(|y| *y == heights[0]) {
        return Some(0);
    }
    if strictness == Strictness::Strict
        && let Some(level) = heights.windows(2).position(|pair| pair[0] == pair[1])
    {
        return Some(level);
    }
    let bulge = |w: &[i32]| sign * (2 * w[1] - w[0] - w[2]);
    let least = i32::from(strictness == Strictness::Strict);
    heights.windows(3).position(|w| bulge(w) < least).map(|i| i + 1)
}

fn surface_finding(subject: &Subject<'_>, side: Side, strictness: Strictness) -> Finding {
    let (name, direction, sign) = match side {
        Side::Top => ("upper", "up", 1),
        Side::Bottom => ("lower", "down", -1),
    };
    let required = subject.tell(|| json!({ "bulges": direction, "strict": strictness }));
    if subject.structure.is_empty() {
        return Finding::nothing_stands(true, required);
    }
    let slices = slices(subject.structure, side);
    let raise = |slice: &Slice, i: usize| {
        let (x, z) = slice.columns[i];
        Cell::new(x, slice.heights[i], z)
    };
    let mut closest: Option<(&Slice, usize)> = None;
    for slice in &slices {
        let Some(at) = first_break(slice, sign, strictness) else {
            let (first, last) = (raise(slice, 0), raise(slice, slice.columns.len() - 1));
            let summary = subject.tell(|| {
                format!(
                    "the {name} surface bulges {direction} from {:?} to {:?}",
                    <[i32; 3]>::from(first),
                    <[i32; 3]>::from(last)
                )
            });
            let measured = subject.tell(|| json!({ "slice": [first, last], "heights": slice.heights.len() }));
            return Finding::binary(true, measured, required, summary).vacuous_if(slice.columns.len() < 3);
        };
        if closest.is_none_or(|(best, _)| slice.columns.len() > best.columns.len()) {
            closest = Some((slice, at));
        }
    }
    let summary = subject.tell(|| format!("none of {} slices of the {name} surface bulges {direction}", slices.len()));
    let finding = Finding::binary(false, json!({ "slices": slices.len() }), required, summary);
    finding.with_witnesses(closest.map(|(slice, at)| raise(slice, at)), "the longest slice breaks here")
}

impl Rule for TopSurfaceConcave {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        surface_finding(subject, Side::Top, self.strict)
    }
}

impl Rule for BottomSurfaceConcave {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        surface_finding(subject, Side::Bottom, self.strict)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The rule as written in `docs/rules.md#surfaces`: every point against every chord, in floating point.
    fn holds_by_chords(heights: &[i32], sign: f64, strictness: Strictness) -> bool {
        if heights.len() == 1 {
            return strictness == Strictness::Lenient;
        }
        let flat = heights.iter().all(|y| *y == heights[0]);
        if strictness == Strictness::NonFlat && flat {
            return false;
        }
        if strictness == Strictness::Strict && heights.windows(2).any(|w| w[0] == w[1]) {
            return false;
        }
        for i in 0..heights.len() {
            for j in i + 1..heights.len() {
                for k in i..=j {
                    let t = (k - i) as f64 / (j - i) as f64;
                    let chord = f64::from(heights[i]) * (1.0 - t) + f64::from(heights[j]) * t;
                    let bulge = sign * (f64::from(heights[k]) - chord);
                    if bulge < -1e-9 || (strictness == Strictness::Strict && i < k && k < j && bulge <= 1e-12) {
                        return false;
                    }
                }
            }
        }
        true
    }

    proptest! {
        #[test]
        fn second_differences_agree_with_all_chords(
            heights in prop::collection::vec(-3..4i32, 1..9),
            strictness in prop::sample::select(vec![Strictness::Lenient, Strictness::NonFlat, Strictness::Strict]),
            sign in prop::sample::select(vec![1, -1]),
        ) {
            let slice = Slice { columns: (0..heights.len() as i32).map(|x| (x, 0)).collect(), heights: heights.clone() };
            let holds = first_break(&slice, sign, strictness).is_none();
            prop_assert_eq!(holds, holds_by_chords(&heights, f64::from(sign), strictness));
        }
    }
}

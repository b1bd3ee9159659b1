//! Checks the order of the steps of an epoch, and the information that it released.

use std::collections::BTreeMap;

use super::Verified;
use super::stated::Stated;
use crate::hidden::commitment::{Commitment, Rules};
use crate::hidden::feedback::released_bits;
use crate::hidden::reveal::Reveal;

/// Tolerance in the order of two times, because clocks are sometimes adjusted.
pub(super) const SLACK_MS: i64 = 60_000;

/// Checks that each step comes after the steps that it requires and before the end of the epoch.
pub(super) fn check(stated: &Stated<'_>, found: &mut Verified) {
    let closed = stated.closed.first().map_or(i64::MAX, |(_, closed)| closed.closed_at_ms);
    let mut follows = |place: String, steps: &[(&str, i64)]| {
        for pair in steps.windows(2) {
            let [(before, earlier), (after, later)] = pair else { continue };
            if later.saturating_add(SLACK_MS) < *earlier {
                found.breach(place.clone(), format!("it {after} before it {before}"));
            }
        }
    };
    let mut drawn: BTreeMap<&str, i64> = BTreeMap::new();
    for ((entry, run), draw) in &stated.draws {
        let registered = stated.entries.get(entry).map_or(i64::MIN, |fact| fact.registered_at_ms);
        let steps = [("was registered", registered), ("was drawn", draw.drawn_at_ms), ("ended with the epoch", closed)];
        follows(format!("entry {entry}, run {run}"), &steps);
        drawn.extend(draw.instances.iter().map(|id| (id.as_str(), draw.drawn_at_ms)));
    }
    for (id, answer) in &stated.answers {
        let finalized = stated.completed.get(&answer.entry).map_or(i64::MAX, |fact| fact.finalized_at_ms);
        let drawn = drawn.get(id.as_str()).copied().unwrap_or(i64::MIN);
        let steps = [
            ("was drawn", drawn),
            ("was answered", answer.answered_at_ms),
            ("ended with its entry or the epoch", finalized.min(closed)),
        ];
        follows(format!("instance {id}"), &steps);
        for grade in stated.grades.get(id.as_str()).into_iter().flatten() {
            let graded = grade["graded_at_ms"].as_i64().unwrap_or(i64::MIN);
            follows(format!("instance {id}"), &[("was answered", answer.answered_at_ms), ("was graded", graded)]);
        }
    }
    for (entry, fact) in &stated.completed {
        let steps = [("was finalized", fact.finalized_at_ms), ("was completed", fact.completed_at_ms)];
        follows(format!("entry {entry}"), &steps);
    }
}

/// Checks that the epoch closed when its information budget was spent.
pub(super) fn budget(
    reveal: &Reveal,
    commitment: &Commitment,
    rules: &Rules,
    stated: &Stated<'_>,
    found: &mut Verified,
) {
    let closed = stated.closed.first().map_or(i64::MAX, |(_, closed)| closed.closed_at_ms);
    let told_before = reveal.entries.iter().filter(|entry| entry.completed_at_ms.is_some_and(|at| at < closed));
    let bits: f64 = told_before
        .map(|entry| {
            let own = reveal.instances.iter().filter(|own| own.entry == entry.id && own.log_sha256.is_some());
            released_bits(entry.tier.feedback(commitment.dev_feedback), own.count())
        })
        .sum();
    if bits >= f64::from(rules.budget_bits) {
        let detail = format!("{bits:.1} bits were released before the end; the budget is {}", rules.budget_bits);
        found.breach("budget", detail);
    }
}

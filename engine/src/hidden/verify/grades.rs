//! Checks the grades of a reveal: this program finds the same for each log.

use std::collections::BTreeMap;

use sha2::{Digest as _, Sha256};

use super::Verified;
use super::issued::Issued;
use crate::checks::Criterion;
use crate::elasticity::Control;
use crate::grading::grade_log;
use crate::hidden::reveal::{Reveal, RevealedInstance};
use crate::tasks::hex;
use crate::voxel::BlockLog;

/// Greatest difference between equal scores. Those of stress depend on how sums are rounded, which processors without a
/// fused multiply-add do differently, and those of equilibrium on the way to the solution.
const ROUNDING: f64 = 1e-6;

/// Checks that every grade is the one that this program computes for the log.
pub(super) fn check(reveal: &Reveal, logs: &BTreeMap<String, BlockLog>, issued: &Issued<'_>, found: &mut Verified) {
    let answered = |id: &String| reveal.instances.iter().any(|own| own.id == *id && own.log_sha256.is_some());
    for id in logs.keys().filter(|id| !answered(id)) {
        found.breach(format!("instance {id}"), "has a log among the answers but no answer in the reveal");
    }
    let is_graded = |own: &RevealedInstance| own.overall.is_some() || own.scores.is_some();
    let graded = reveal.instances.iter().filter(|own| own.log_sha256.is_some() && is_graded(own));
    let missing: Vec<&str> = graded.map(|own| own.id.as_str()).filter(|id| !logs.contains_key(*id)).collect();
    if let [first, ..] = missing.as_slice() {
        let lack = match missing.len() {
            1 => format!("lack the log of instance {first}, which the reveal has a grade of"),
            many => format!("lack {many} logs that the reveal has grades of, the first that of instance {first}"),
        };
        let then =
            "the download may have been cut off, so fetch them again; what they still lack, the service withholds";
        found.breach("answers", format!("{lack}: {then}"));
    }
    for instance in &reveal.instances {
        let place = format!("instance {}", instance.id);
        if instance.log_sha256.is_none() {
            if is_graded(instance) {
                found.breach(place, "has a grade but no answer");
            }
            continue;
        }
        // An answer that the service failed to grade has no grade and counts as failed.
        if !is_graded(instance) {
            found.ungraded += 1;
            continue;
        }
        let Some(log) = logs.get(&instance.id) else { continue };
        let Some(specification) = issued.specification(instance.leaf) else {
            found.breach(place, "its specification is missing from the reveal");
            continue;
        };
        let hash = hex(&Sha256::digest(log.canonical_json()));
        if Some(&hash) != instance.log_sha256.as_ref() {
            found.breach(place, format!("the log has the hash {hash}, which is not the one in the reveal"));
            continue;
        }
        let report = match grade_log(&specification.task, log, &Control::unhurried()) {
            Ok(report) => report,
            // Without a deadline nothing stops a grading.
            Err(error) => {
                found.unchecked.push(format!("{place}: this program cannot grade its log: {error}"));
                continue;
            }
        };
        let is_same = Some(report.overall) == instance.overall
            && instance.scores.as_ref().is_some_and(|scores| are_same(&report.scores().rows, scores));
        if is_same {
            found.grades += 1;
        } else {
            let detail = format!(
                "its verdict ({}) or a score differs from what this program finds ({})",
                instance.overall.map_or("none", |passes| if passes { "passes" } else { "fails" }),
                if report.overall { "passes" } else { "fails" }
            );
            found.breach(place, detail);
        }
    }
}

/// Returns whether scores are the same but for rounding.
fn are_same(found: &[(Criterion, f64)], published: &[(Criterion, f64)]) -> bool {
    found.len() == published.len()
        && found.iter().zip(published).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() <= ROUNDING)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_may_differ_by_rounding_alone() {
        let scores = |score| [(Criterion::Shape, 1.0), (Criterion::StructuralStability, score)];
        assert!(are_same(&scores(0.5), &scores(0.500_000_1)));
        assert!(!are_same(&scores(0.5), &scores(0.500_01)));
        assert!(!are_same(&scores(0.5), &scores(f64::NAN)));
        assert!(!are_same(&scores(0.5), &scores(0.5)[..1]));
        assert!(!are_same(&scores(0.5), &[(Criterion::Size, 1.0), (Criterion::StructuralStability, 0.5)]));
    }
}

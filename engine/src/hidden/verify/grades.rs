//! Checks the grades of a reveal: this program finds the same for each log.

use std::collections::BTreeMap;

use sha2::{Digest as _, Sha256};

use super::Verified;
use super::issued::Issued;
use crate::elasticity::Control;
use crate::grading::grade_log;
use crate::hidden::reveal::Reveal;
use crate::tasks::hex;
use crate::voxel::BlockLog;

/// Checks that every grade is the one that this program computes for the log.
pub(super) fn check(reveal: &Reveal, logs: &BTreeMap<String, BlockLog>, issued: &Issued<'_>, found: &mut Verified) {
    let answered = |id: &String| reveal.instances.iter().any(|own| own.id == *id && own.log_sha256.is_some());
    for id in logs.keys().filter(|id| !answered(id)) {
        found.breach(format!("instance {id}"), "has a log among the answers but no answer in the reveal");
    }
    for instance in &reveal.instances {
        let place = format!("instance {}", instance.id);
        let is_graded = instance.overall.is_some() || instance.scores.is_some();
        if instance.log_sha256.is_none() {
            if is_graded {
                found.breach(place, "has a grade but no answer");
            }
            continue;
        }
        // An answer that the service failed to grade has no grade and counts as failed.
        if !is_graded {
            found.ungraded += 1;
            continue;
        }
        let (Some(log), Some(specification)) = (logs.get(&instance.id), issued.specification(instance.leaf)) else {
            found.breach(place, "its log is missing from the answers, or its specification from the reveal");
            continue;
        };
        let hash = hex(&Sha256::digest(log.canonical_json()));
        if Some(&hash) != instance.log_sha256.as_ref() {
            found.breach(place, format!("the log has the hash {hash}, which is not the one in the reveal"));
            continue;
        }
        let Ok(report) = grade_log(&specification.task, log, &Control::unhurried()) else { continue };
        let is_same = Some(report.overall) == instance.overall && Some(report.scores().rows) == instance.scores;
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

//! Builders: for each family of the suite, from a task's parameters to the block log of a good build.
//!
//! Parameters are read from the task's checks, so a builder serves every instance of its family. The builds pass every
//! check but one: the published rule for the lower surface of an arch rejects a true arch (SPEC 3), and a true arch is
//! what these builders make.

pub mod civil;
pub mod demands;
pub mod houses;
pub mod saboteurs;
pub mod site;
pub mod structural;

use crate::tasks::Task;
use crate::voxel::BlockLog;
use demands::Demands;
use site::Site;

/// A builder: adds what the demands of one turn ask for to the site.
type Builder = fn(&mut Site, &Demands);

/// The builder of each family, by the family's name in the published files.
const BUILDERS: &[(&str, Builder)] = &[
    ("1-se-1.1-foundations", structural::foundation),
    ("1-se-1.2-foundations_deep", structural::deep_foundation),
    ("1-se-2-walls", structural::wall),
    ("1-se-3.1-roofs_cols", structural::roof_on_columns),
    ("1-se-3.2-roofs_cols-one_layer-stress", structural::roof_under_stress),
    ("1-se-3.2-roofs_cols-two_layer-stress", structural::roof_under_stress),
    ("1-se-4-frames", structural::frame),
    ("2-bt-1-basic-fine_grained", houses::basic),
    ("2-bt-2-multi_rooms", houses::house),
    ("2-bt-3-multi_beds", houses::house),
    ("2-bt-4-multi-story", structural::second_floor),
    ("3-ae-5.1-accessibility_house", houses::accessible),
    ("3-ae-5.2-accessibility_theater", houses::theatre),
    ("3-ae-6.1-creative_sym", houses::house),
    ("3-ae-6.2-creative_3ceiling", houses::house),
    ("4-cm-7-resource-optimization", houses::cabin),
    ("4-cm-8.1-single_turn-planning-single_story", houses::planned),
    ("4-cm-8.2-single_turn-planning-two_story", houses::planned),
    ("4-cm-9-multi-2-turn-revision", houses::house),
    ("4-cm-9-multi-5-turn-revision", houses::house),
    ("5-ce-1-basic_bridges", civil::bridge),
    ("5-ce-2-arched_bridges-stress", civil::arch_under_stress),
    ("5-ce-2-arched_bridges", civil::arch_bridge),
    ("5-ce-3.1-dome", civil::dome),
    ("5-ce-3.2-dome-igloo", civil::igloo),
];

/// The log of a good build, or `None` for a family without a builder.
#[must_use]
pub fn build(task: &Task) -> Option<BlockLog> {
    let (_, builder) = BUILDERS.iter().find(|(family, _)| *family == task.family())?;
    let mut site = Site::default();
    for turn in &task.turns {
        site.begin_turn();
        builder(&mut site, &Demands::of(&turn.checks));
    }
    Some(site.into_log())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elasticity::Control;
    use crate::grading::grade_log;
    use crate::tasks::embedded;

    /// Families whose published lower-surface rule contradicts a true arch.
    const ARCHES: [&str; 2] = ["5-ce-2-arched_bridges", "5-ce-2-arched_bridges-stress"];
    const LOWER_SURFACE: &str = "shape.is_bottom_surface_concave";

    #[test]
    fn every_task_is_solved_but_for_the_lower_surface_of_arches() {
        let mut failures = Vec::new();
        for task in &embedded::full().unwrap().tasks {
            // The stress of a family is the same for all wordings; one shows it.
            if task.family().ends_with("-stress") && !task.id.ends_with("-w1") {
                continue;
            }
            let report = grade_log(task, &build(task).unwrap(), &Control::unhurried()).unwrap();
            let is_arch = ARCHES.contains(&task.family());
            for check in report.turns.iter().flat_map(|turn| &turn.checks) {
                let is_excused = is_arch && check.name == LOWER_SURFACE;
                if check.finding.score < 1.0 && !is_excused {
                    failures.push(format!("{} {}: {}", task.id, check.name, check.finding.summary));
                }
            }
        }
        failures.truncate(20);
        assert!(failures.is_empty(), "{failures:#?}");
    }
}

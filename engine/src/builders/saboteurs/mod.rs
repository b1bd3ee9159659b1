//! Saboteurs, each of which spoils a good build in one named way, to show that checks fail where they should.

mod spoils;

use crate::voxel::BlockLog;

/// One way to spoil a build.
#[derive(Debug, Clone, Copy)]
pub struct Saboteur {
    /// Name of the saboteur on the command line.
    pub name: &'static str,
    /// Description of what it does.
    pub what: &'static str,
    spoil: fn(&mut BlockLog),
}

impl Saboteur {
    /// Returns the log after spoiling it.
    #[must_use]
    pub fn spoil(&self, mut log: BlockLog) -> BlockLog {
        (self.spoil)(&mut log);
        log
    }
}

const fn saboteur(name: &'static str, what: &'static str, spoil: fn(&mut BlockLog)) -> Saboteur {
    Saboteur { name, what, spoil }
}

/// All saboteurs.
pub const SABOTEURS: &[Saboteur] = &[
    saboteur("float-block", "adds one block that hangs in the air", spoils::float_block),
    saboteur("add-block", "adds one block on top of the first", spoils::add_block),
    saboteur("drop-corner", "leaves out the column at one corner", spoils::drop_corner),
    saboteur("drop-top", "leaves out the highest level", spoils::drop_top),
    saboteur("drop-bottom", "leaves out the lowest level", spoils::drop_bottom),
    saboteur("drop-half", "stops halfway in each turn", spoils::drop_half),
    saboteur("breach-wall", "leaves out the whole side at the least x", spoils::breach_wall),
    saboteur(
        "drop-fittings",
        "leaves out all but the most common material, such as doors and beds",
        spoils::drop_fittings,
    ),
    saboteur("add-fitting", "adds one block of the least common material, such as a door, on top", spoils::add_fitting),
    saboteur("drop-common", "leaves out the most common material", spoils::drop_common),
    saboteur("wrong-material", "uses sponge for everything", spoils::wrong_material),
    saboteur("misname", "uses names that contain the right ones but are not blocks of the game", spoils::misname),
    saboteur("raise", "builds everything two blocks higher", spoils::raise),
    saboteur("sink", "builds everything ten blocks lower", spoils::sink),
    saboteur("capsize", "turns everything upside down, with its lowest level where it was", spoils::capsize),
    saboteur("stilt", "builds everything twenty blocks higher, on one pole", spoils::stilt),
    saboteur("widen", "adds rows of blocks beyond the greatest x and the greatest z", spoils::widen),
    saboteur("sprawl", "adds a row of thirty blocks beyond the greatest x", spoils::sprawl),
    saboteur("midway-pillar", "adds a pillar in the middle, where a span should be clear", spoils::midway_pillar),
    saboteur(
        "touch-corner",
        "adds a pillar that touches the corner at the least x and z by an edge",
        spoils::touch_corner,
    ),
    saboteur("fill", "fills the bounding box of the build", spoils::fill),
    saboteur("hollow", "leaves out blocks that have blocks on all six sides", spoils::hollow),
    saboteur("mirror", "adds the mirror images of everything about the middle", spoils::mirror),
    saboteur("overload", "piles eight blocks on top of each of the highest", spoils::overload),
    saboteur("kindle", "sets fire on top of the highest block", spoils::kindle),
    saboteur("reverse", "places everything in reverse order", spoils::reverse),
    saboteur("to-and-fro", "places blocks alternately from the beginning and from the end", spoils::to_and_fro),
];

/// Finds a saboteur by its name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Saboteur> {
    SABOTEURS.iter().find(|saboteur| saboteur.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builders::build;
    use crate::elasticity::Control;
    use crate::grading::grade_log;
    use crate::tasks::embedded;

    /// Each check that holds on the good build of a family is failed by some saboteur, and no saboteur spoils nothing.
    #[test]
    fn every_check_of_every_family_is_failed_by_some_saboteur() {
        let mut missed = Vec::new();
        let mut is_idle = vec![true; SABOTEURS.len()];
        let suite = embedded::latest().unwrap();
        for family in suite.families() {
            let task = &family[0];
            let grade = |log: &BlockLog| grade_log(task, log, &Control::unhurried()).unwrap();
            let scores = |log: &BlockLog| -> Vec<f64> {
                grade(log).turns.iter().flat_map(|turn| &turn.checks).map(|check| check.finding.score).collect()
            };
            let good = build(task).unwrap();
            let before = scores(&good);
            let spoiled: Vec<Vec<f64>> =
                SABOTEURS.iter().map(|saboteur| scores(&saboteur.spoil(good.clone()))).collect();
            for (i, check) in task.checks().enumerate() {
                for (is_idle, after) in is_idle.iter_mut().zip(&spoiled) {
                    *is_idle &= after[i] >= before[i];
                }
                let is_failed = spoiled.iter().any(|after| after[i] < before[i]);
                if before[i] >= 1.0 && !is_failed {
                    missed.push(format!("{}: {check:?}", task.id));
                }
            }
        }
        assert!(missed.is_empty(), "no saboteur fails {missed:#?}");
        let idle: Vec<&str> = SABOTEURS.iter().zip(is_idle).filter(|(_, idle)| *idle).map(|(s, _)| s.name).collect();
        assert!(idle.is_empty(), "{idle:?} spoil nothing");
    }

    /// Lists exactly which checks each saboteur makes a stone wall of 5 by 5 fail.
    #[test]
    fn a_wall_fails_where_it_was_spoiled() {
        let suite = embedded::latest().unwrap();
        let task = suite.tasks.iter().find(|task| task.id == "walls/5x1x5-raise").unwrap();
        let good = build(task).unwrap();
        let failed = |name: &str| -> Vec<String> {
            let report = grade_log(task, &find(name).unwrap().spoil(good.clone()), &Control::unhurried()).unwrap();
            let checks = report.turns.into_iter().flat_map(|turn| turn.checks);
            let mut failed: Vec<String> =
                checks.filter(|check| check.finding.score < 1.0).map(|check| check.name.into_owned()).collect();
            // The courses are checked one by one.
            failed.dedup();
            failed
        };
        let [known, ground, count, stone, size, bottom, course, movement] = [
            "material.are_blocks_known",
            "physical_plausibility.is_ground_connected",
            "material.count_is_within",
            "material.is_made_of",
            "size.is_equal",
            "size.min_y_is_equal",
            "shape.level_has",
            "efficiency.l1_dist",
        ];
        for (name, expected) in [
            ("float-block", &[ground, count, size, movement][..]),
            ("add-block", &[count, size, movement]),
            ("drop-corner", &[count, size, course]),
            ("drop-top", &[count, size, course]),
            ("drop-bottom", &[ground, count, size, bottom, course]),
            ("drop-half", &[count, size, course]),
            // The whole wall is at the least x.
            ("breach-wall", &[known, count, stone, size, bottom, course]),
            ("drop-common", &[known, count, stone, size, bottom, course]),
            ("wrong-material", &[stone]),
            ("misname", &[known, stone]),
            ("raise", &[ground, bottom, course]),
            ("capsize", &[]),
            ("stilt", &[count, size, course, movement]),
            ("widen", &[count, size, course, movement]),
            ("overload", &[count, size, movement]),
            ("kindle", &[count, stone, size]),
            ("to-and-fro", &[movement]),
            // A wall has no fittings, no gaps and no inside, is its own mirror image, and may be built from the top.
            ("drop-fittings", &[]),
            ("fill", &[]),
            ("hollow", &[]),
            ("mirror", &[]),
            ("sink", &[bottom, course]),
            ("reverse", &[]),
        ] {
            assert_eq!(failed(name), expected, "{name}");
        }
    }
}

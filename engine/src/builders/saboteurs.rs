//! Saboteurs, each of which spoils a good build in one named way, to show that checks fail where they should.

use crate::voxel::{BlockLog, Bounds, Cell, CellSet, Event, Palette};

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
    saboteur("float-block", "adds one block that hangs in the air", float_block),
    saboteur("add-block", "adds one block on top of the first", add_block),
    saboteur("drop-corner", "leaves out the column at one corner", drop_corner),
    saboteur("drop-top", "leaves out the highest level", drop_top),
    saboteur("drop-bottom", "leaves out the lowest level", drop_bottom),
    saboteur("drop-half", "stops halfway in each turn", drop_half),
    saboteur("breach-wall", "leaves out the whole side at the least x", breach_wall),
    saboteur("drop-fittings", "leaves out all but the most common material, such as doors and beds", drop_fittings),
    saboteur("add-fitting", "adds one block of the least common material, such as a door, on top", add_fitting),
    saboteur("drop-common", "leaves out the most common material", drop_common),
    saboteur("wrong-material", "uses sponge for everything", wrong_material),
    saboteur("misname", "uses names that contain the right ones but are not blocks of the game", misname),
    saboteur("raise", "builds everything two blocks higher", raise),
    saboteur("sink", "builds everything ten blocks lower", sink),
    saboteur("widen", "adds rows of blocks beyond the greatest x and the greatest z", widen),
    saboteur("sprawl", "adds a row of thirty blocks beyond the greatest x", sprawl),
    saboteur("midway-pillar", "adds a pillar in the middle, where a span should be clear", midway_pillar),
    saboteur("touch-corner", "adds a pillar that touches the corner at the least x and z by an edge", touch_corner),
    saboteur("fill", "fills the bounding box of the build", fill),
    saboteur("hollow", "leaves out blocks that have blocks on all six sides", hollow),
    saboteur("mirror", "adds the mirror images of everything about the middle", mirror),
    saboteur("overload", "piles eight blocks on top of each of the highest", overload),
    saboteur("reverse", "places everything in reverse order", reverse),
    saboteur("to-and-fro", "places blocks alternately from the beginning and from the end", to_and_fro),
];

/// Finds a saboteur by its name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Saboteur> {
    SABOTEURS.iter().find(|saboteur| saboteur.name == name)
}

/// Returns the cells at which blocks are placed, over all turns.
fn placed(log: &BlockLog) -> Vec<Cell> {
    let place = |event: &Event| match *event {
        Event::Place { cell, .. } => Some(cell),
        Event::Remove { .. } => None,
    };
    log.turns.iter().flatten().filter_map(place).collect()
}

fn bounds(log: &BlockLog) -> Bounds {
    Bounds::of(placed(log)).unwrap_or(Bounds { min: Cell::new(0, 0, 0), max: Cell::new(0, 0, 0) })
}

/// Returns how often each material is placed, by its id.
fn counts(log: &BlockLog) -> Vec<u32> {
    let mut counts = vec![0_u32; log.palette.len()];
    for event in log.turns.iter().flatten() {
        if let Event::Place { material, .. } = *event {
            counts[material as usize] += 1;
        }
    }
    counts
}

/// Returns the material that is placed most often.
fn common_material(log: &BlockLog) -> Option<u32> {
    (0..).zip(counts(log)).max_by_key(|(_, count)| *count).map(|(material, _)| material)
}

/// Keeps the placements for which `is_kept` holds, and all removals.
fn keep(log: &mut BlockLog, is_kept: impl Fn(Cell, u32) -> bool) {
    for turn in &mut log.turns {
        turn.retain(|event| match *event {
            Event::Place { cell, material } => is_kept(cell, material),
            Event::Remove { .. } => true,
        });
    }
}

/// Places more blocks of the common material at the end of each turn.
fn add(log: &mut BlockLog, cells: &[Cell]) {
    let Some(material) = common_material(log) else { return };
    for turn in &mut log.turns {
        turn.extend(cells.iter().map(|&cell| Event::Place { cell, material }));
    }
}

fn shift(log: &mut BlockLog, dy: i32) {
    for event in log.turns.iter_mut().flatten() {
        match event {
            Event::Place { cell, .. } | Event::Remove { cell } => *cell = cell.offset(0, dy, 0),
        }
    }
}

fn float_block(log: &mut BlockLog) {
    let cell = bounds(log).max.offset(3, 3, 3);
    add(log, &[cell]);
}

fn add_block(log: &mut BlockLog) {
    let taken: CellSet = placed(log).into_iter().collect();
    let Some(&first) = placed(log).first() else { return };
    let mut cell = first;
    while taken.contains(&cell) {
        cell = cell.offset(0, 1, 0);
    }
    add(log, &[cell]);
}

fn drop_corner(log: &mut BlockLog) {
    let corner = bounds(log).min;
    keep(log, |cell, _| (cell.x, cell.z) != (corner.x, corner.z));
}

fn drop_top(log: &mut BlockLog) {
    let top = bounds(log).max.y;
    keep(log, |cell, _| cell.y < top);
}

fn drop_bottom(log: &mut BlockLog) {
    let bottom = bounds(log).min.y;
    keep(log, |cell, _| cell.y > bottom);
}

fn drop_half(log: &mut BlockLog) {
    for turn in &mut log.turns {
        turn.truncate(turn.len() / 2);
    }
}

fn breach_wall(log: &mut BlockLog) {
    let side = bounds(log).min.x;
    keep(log, |cell, _| cell.x > side);
}

fn drop_fittings(log: &mut BlockLog) {
    let common = common_material(log);
    keep(log, |_, material| Some(material) == common);
}

fn add_fitting(log: &mut BlockLog) {
    let rarest = (0..).zip(counts(log)).filter(|(_, count)| *count > 0).min_by_key(|(_, count)| *count);
    let Some((material, _)) = rarest else { return };
    let Some(top) = placed(log).into_iter().max_by_key(|cell| cell.y) else { return };
    for turn in &mut log.turns {
        turn.push(Event::Place { cell: top.offset(0, 1, 0), material });
    }
}

fn drop_common(log: &mut BlockLog) {
    let common = common_material(log);
    keep(log, |_, material| Some(material) != common);
}

fn wrong_material(log: &mut BlockLog) {
    let sponge = log.palette.intern("sponge");
    for event in log.turns.iter_mut().flatten() {
        if let Event::Place { material, .. } = event {
            *material = sponge;
        }
    }
}

fn misname(log: &mut BlockLog) {
    let mut palette = Palette::new();
    for name in log.palette.names() {
        palette.intern(&format!("my_{name}s"));
    }
    log.palette = palette;
}

fn raise(log: &mut BlockLog) {
    shift(log, 2);
}

fn sink(log: &mut BlockLog) {
    shift(log, -10);
}

fn widen(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let row = (min.x..=max.x + 1).map(|x| Cell::new(x, min.y, max.z + 1));
    let cells: Vec<Cell> = row.chain((min.z..=max.z).map(|z| Cell::new(max.x + 1, min.y, z))).collect();
    add(log, &cells);
}

fn sprawl(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let row: Vec<Cell> = (1..=30).map(|dx| Cell::new(max.x + dx, min.y, max.z)).collect();
    add(log, &row);
}

fn midway_pillar(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let taken: CellSet = placed(log).into_iter().collect();
    let pillar = (min.y..=max.y).map(|y| Cell::new(i32::midpoint(min.x, max.x), y, i32::midpoint(min.z, max.z)));
    let free: Vec<Cell> = pillar.filter(|cell| !taken.contains(cell)).collect();
    add(log, &free);
}

fn touch_corner(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let pillar: Vec<Cell> = (min.y..=max.y).map(|y| Cell::new(min.x - 1, y, min.z - 1)).collect();
    add(log, &pillar);
}

fn fill(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let taken: CellSet = placed(log).into_iter().collect();
    let levels = (min.y..=max.y).flat_map(|y| (min.x..=max.x).map(move |x| (x, y)));
    let cells = levels.flat_map(|(x, y)| (min.z..=max.z).map(move |z| Cell::new(x, y, z)));
    let free: Vec<Cell> = cells.filter(|cell| !taken.contains(cell)).collect();
    add(log, &free);
}

fn hollow(log: &mut BlockLog) {
    let taken: CellSet = placed(log).into_iter().collect();
    keep(log, |cell, _| cell.face_neighbours().iter().any(|next| !taken.contains(next)));
}

fn mirror(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    for turn in &mut log.turns {
        for plane in [0, 1] {
            let image = |event: &Event| match *event {
                Event::Place { cell, material } => {
                    let (x, z) =
                        if plane == 0 { (min.x + max.x - cell.x, cell.z) } else { (cell.x, min.z + max.z - cell.z) };
                    Some(Event::Place { cell: Cell::new(x, cell.y, z), material })
                }
                Event::Remove { .. } => None,
            };
            let taken: CellSet = turn.iter().map(Event::cell).collect();
            let images: Vec<Event> =
                turn.iter().filter_map(image).filter(|event| !taken.contains(&event.cell())).collect();
            turn.extend(images);
        }
    }
}

fn overload(log: &mut BlockLog) {
    let top = bounds(log).max.y;
    let roof: Vec<Cell> = placed(log).into_iter().filter(|cell| cell.y == top).collect();
    let heap: Vec<Cell> = (1..9).flat_map(|dy| roof.iter().map(move |cell| cell.offset(0, dy, 0))).collect();
    add(log, &heap);
}

fn reverse(log: &mut BlockLog) {
    for turn in &mut log.turns {
        turn.reverse();
    }
}

fn to_and_fro(log: &mut BlockLog) {
    for turn in &mut log.turns {
        let (first, second) = turn.split_at(turn.len() / 2);
        let backwards = second.iter().rev();
        let mut mixed: Vec<Event> = first.iter().zip(backwards).flat_map(|(a, b)| [*a, *b]).collect();
        mixed.extend(second.first().filter(|_| turn.len() % 2 == 1));
        *turn = mixed;
    }
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
            ("widen", &[count, size, course, movement]),
            ("overload", &[count, size, movement]),
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

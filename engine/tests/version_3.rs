//! What the third version of the suite mends: honest builds that version 2 fails and cheap ones that it passes. Each
//! does the opposite now.

use plumbline_engine::builders::build;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::advisory::AdvisoryCode;
use plumbline_engine::grading::grade_log;
use plumbline_engine::voxel::{BlockLog, Cell, Event, Profile, Turn};

use crate::verdicts::{Fill, built, task, verdict};

/// Verdicts of versions 2 and 3, with the first check that each fails.
fn verdicts(id: &str, log: &BlockLog) -> [Option<String>; 2] {
    [2, 3].map(|version| verdict(version, id, log))
}

/// An honest build, which only version 3 passes.
fn is_right_now(id: &str, log: &BlockLog) {
    let [before, now] = verdicts(id, log);
    assert!(before.is_some(), "{id}: version 2 passes it as well");
    assert_eq!(now, None, "{id}");
}

/// A cheap build, which only version 2 passes.
fn is_caught_now(id: &str, log: &BlockLog) {
    let [before, now] = verdicts(id, log);
    assert_eq!(before, None, "{id}: version 2 fails it as well");
    assert!(now.is_some(), "{id}: version 3 passes it");
}

fn good(id: &str) -> BlockLog {
    build(&task(3, id)).unwrap()
}

#[test]
fn a_lantern_beside_the_upper_half_of_a_door_lights_it() {
    let mut log = good("theatres/s30-build");
    let lantern = log.palette.get("sea_lantern").unwrap();
    let concrete = log.palette.get("gray_concrete").unwrap();
    let at = |log: &BlockLog, wanted| -> Vec<Cell> {
        let is_it = |event: &&Event| matches!(event, Event::Place { material, .. } if *material == wanted);
        log.turns[0].iter().filter(is_it).map(Event::cell).collect()
    };
    // Each lantern changes places with the block above it.
    for low in at(&log, lantern) {
        for event in &mut log.turns[0] {
            if let Event::Place { cell, material } = event {
                if *cell == low {
                    *material = concrete;
                } else if *cell == low.offset(0, 1, 0) {
                    *material = lantern;
                }
            }
        }
    }
    is_right_now("theatres/s30-build", &log);
}

#[test]
fn an_arch_may_rise_over_its_supports() {
    // Upper side 1, 2, 3, 4, 4, 4, 4, 4, 3, 2, 1; the clear span is five.
    let mut fills: Vec<Fill<'_>> = Vec::new();
    for (x, top) in (0..11).zip([1, 2, 3, 4, 4, 4, 4, 4, 3, 2, 1]) {
        let low = [0, 0, 0, 2, 3, 3, 3, 2, 0, 0, 0][x as usize];
        fills.push(("stone", [x, low, 0], [x, top, 1]));
    }
    is_right_now("stressed-arches/2-wide-2-leg-build", &built(&[&fills]));
}

#[test]
fn a_wardrobe_in_the_middle_is_no_obstacle() {
    let id = "accessible-houses/r1-b1-wheelchair";
    let mut log = good(id);
    log.turns.truncate(1);
    for y in 0..2 {
        log.place(Cell::new(3, y, 4), "bookshelf");
        log.place(Cell::new(2, y, 4), "bookshelf");
    }
    let [_, now] = verdicts(id, &log);
    assert_eq!(now, None);
    // A full beam over the middle of the plan, from floor to ceiling, shuts the box that version 2 moves.
    log.place(Cell::new(2, 2, 3), "oak_log");
    log.place(Cell::new(2, 2, 2), "oak_log");
    let [before, now] = verdicts(id, &log);
    assert_eq!(now, None);
    assert!(before.is_some(), "version 2 starts in the middle of the bounding box");
}

#[test]
fn names_may_have_their_namespace_and_doors_and_beds_both_halves() {
    let id = "bedrooms/r2-build";
    let mut log = good(id);
    log.profile = Profile::Mindcraft;
    let mut whole = BlockLog { profile: Profile::Mindcraft, ..BlockLog::default() };
    for event in &log.turns[0] {
        let Event::Place { cell, material } = *event else { continue };
        let name = log.palette.name(material);
        whole.place(cell, &format!("minecraft:{name}"));
        if name.ends_with("_door") {
            whole.place(cell.offset(0, 1, 0), &format!("minecraft:{name}[half=upper]"));
        } else if name.ends_with("_bed") {
            whole.place(cell.offset(0, 0, -1), &format!("minecraft:{name}"));
        }
    }
    is_right_now(id, &whole);
}

#[test]
fn cheap_cabins_are_caught() {
    let size = 4;
    let last = size - 1;
    let hull: &[Fill<'_>] = &[
        ("dirt", [0, 0, 0], [last, 0, last]),
        ("dirt", [0, 1, 0], [0, last, last]),
        ("dirt", [last, 1, 0], [last, last, last]),
        ("dirt", [1, 1, 0], [2, last, 0]),
        ("dirt", [1, 1, last], [2, last, last]),
        ("dirt", [1, last, 1], [2, last, 2]),
    ];
    is_caught_now("cabins/n56-stock", &built(&[hull]));
    // A ring of three by three at y = 2 on a post, with arms that reach as far as is asked.
    let ring: &[Fill<'_>] = &[
        ("oak_planks", [0, 0, 0], [0, 3, 0]),
        ("oak_planks", [0, 2, 1], [0, 2, 3]),
        ("oak_planks", [1, 2, 0], [3, 2, 0]),
        ("oak_planks", [2, 2, 1], [2, 2, 2]),
        ("oak_planks", [1, 2, 2], [1, 2, 2]),
    ];
    is_caught_now("cabins/n56-stock", &built(&[ring]));
}

#[test]
fn cheap_structures_are_caught() {
    // One iron block and one of concrete among andesite.
    let columns = [[0, 0], [0, 8], [8, 8], [8, 0], [4, 4]];
    let mut fills: Vec<Fill<'_>> = columns.map(|[x, z]| ("white_concrete", [x, 0, z], [x + 1, 1, z + 1])).to_vec();
    fills.extend([
        ("iron_block", [0, 2, 0], [0, 2, 0]),
        ("andesite", [0, 2, 1], [9, 4, 9]),
        ("gray_concrete", [0, 3, 0], [0, 3, 0]),
    ]);
    is_caught_now("two-layer-roofs/c5-span", &built(&[&fills]));
    // Posts, and planks stacked on one of them.
    let stacked: &[Fill<'_>] =
        &[("stone", [0, 0, 0], [0, 2, 0]), ("stone", [4, 0, 0], [4, 2, 0]), ("oak_planks", [0, 3, 0], [0, 20, 0])];
    is_caught_now("roofs/3x5-h3-c2-shelter", &built(&[stacked]));
    // Two blocks in opposite corners, joined by a strip.
    let strip: &[Fill<'_>] = &[("stone", [0, -1, 0], [6, -1, 0]), ("stone", [6, -1, 1], [6, -1, 6])];
    is_caught_now("foundations/7x7-d1-lay", &built(&[strip]));
    // A staircase and a pole.
    let mut fills: Vec<Fill<'_>> = (0..5).map(|y| ("white_concrete", [y, 0, 0], [y, y, 0])).collect();
    fills.extend([("white_concrete", [0, 0, 3], [0, 8, 3]), ("white_concrete", [0, 0, 4], [4, 4, 4])]);
    is_caught_now("frames/s2-frame-build", &built(&[&fills]));
    // Four posts, and two posts.
    let posts: Vec<Fill<'_>> = [[0, 0], [8, 0], [8, 8], [0, 8]].map(|[x, z]| ("stone", [x, 0, z], [x, 4, z])).to_vec();
    is_caught_now("second-floors/frame", &built(&[&posts]));
    let posts: &[Fill<'_>] = &[("stone", [0, 0, 0], [0, 4, 0]), ("stone", [10, 0, 0], [10, 4, 0])];
    is_caught_now("bridges/w10-b3-build", &built(&[posts]));
    // A strip and a post.
    let dome: &[Fill<'_>] = &[("white_concrete", [0, 0, 0], [6, 0, 0]), ("white_concrete", [3, 0, 1], [3, 3, 1])];
    is_caught_now("domes/d5-h3-build", &built(&[dome]));
}

#[test]
fn cheap_houses_are_caught() {
    // A plate with two holes, on a post.
    let plate: &[Fill<'_>] = &[
        ("stone", [0, 0, 0], [0, 1, 0]),
        ("stone", [0, 2, 0], [4, 2, 0]),
        ("stone", [0, 2, 1], [0, 2, 2]),
        ("stone", [2, 2, 1], [2, 2, 1]),
        ("stone", [4, 2, 1], [4, 2, 1]),
        ("stone", [1, 2, 2], [4, 2, 2]),
    ];
    is_caught_now("rooms/r2-build", &built(&[plate]));
    is_caught_now("asymmetric-buildings/building-build", &built(&[plate]));
    // A flat ceiling with a chimney.
    let id = "high-ceilings/building-build";
    let mut flat = build(&task(3, "rooms/r1-build")).unwrap();
    for y in 4..6 {
        flat.place(Cell::new(0, y, 0), "bricks");
    }
    is_caught_now(id, &flat);
    // The roof first, and one plank of it last.
    let id = "one-story-plans/fpwr";
    let mut log = good(id);
    let planks = log.palette.get("oak_planks").unwrap();
    let (mut roof, mut rest): (Turn, Turn) =
        log.turns[0].iter().partition(|event| matches!(event, Event::Place { material, .. } if *material == planks));
    rest.extend(roof.pop());
    roof.extend(rest);
    log.turns[0] = roof;
    is_caught_now(id, &log);
}

#[test]
fn turns_without_work_are_caught() {
    // The first turn's house has more rooms than the second asks for, so nothing is done.
    let id = "revisions/r3-r1";
    let mut log = good(id);
    log.turns[1].clear();
    is_caught_now(id, &log);
    // Five rooms at once, in the first of five turns.
    let id = "growing-houses/family";
    let mut log = build(&task(3, "rooms/r5-build")).unwrap();
    log.turns.resize(5, Turn::new());
    is_caught_now(id, &log);
}

#[test]
fn a_removal_that_does_nothing_is_told() {
    let id = "walls/5x1x5-raise";
    let mut log = good(id);
    let codes = |log: &BlockLog| -> Vec<AdvisoryCode> {
        let report = grade_log(&task(2, id), log, &Control::unhurried()).unwrap();
        report.advisories.iter().map(|advisory| advisory.code).collect()
    };
    assert_eq!(codes(&log), []);
    log.place(Cell::new(9, 0, 9), "stone");
    log.remove(Cell::new(9, 0, 9));
    assert_eq!(codes(&log), [AdvisoryCode::RemovalWithoutEffect]);
    log.profile = Profile::Mindcraft;
    assert_eq!(codes(&log), [AdvisoryCode::DiffersFromPublished], "events count in their order, and it is told");
}

/// Rooms that wait behind sealed walls count from the first turn on, and removing doors makes no house smaller.
#[test]
fn sealed_rooms_count_where_the_number_is_exact() {
    let id = "growing-houses/family";
    let mut log = build(&task(3, "rooms/r5-build")).unwrap();
    let doors = log.palette.get("oak_door").unwrap();
    let bricks = log.palette.get("stone_bricks").unwrap();
    let mut later: Vec<Cell> = Vec::new();
    for event in &mut log.turns[0] {
        if let Event::Place { cell, material } = event
            && *material == doors
            && cell.x > 5
        {
            later.push(*cell);
            *material = bricks;
        }
    }
    let upper: Vec<Event> =
        later.iter().map(|cell| Event::Place { cell: cell.offset(0, 1, 0), material: bricks }).collect();
    log.turns[0].extend(upper);
    log.turns.extend(later.iter().map(|cell| {
        let open = [*cell, cell.offset(0, 1, 0)].map(|cell| Event::Remove { cell });
        open.into_iter().chain([Event::Place { cell: *cell, material: doors }]).collect::<Turn>()
    }));
    log.profile = Profile::Mindcraft;
    is_caught_now(id, &log);
}

#[test]
fn the_order_is_that_of_the_blocks_that_stand() {
    let id = "one-story-plans/fpwr";
    let passes = |log: &BlockLog| grade_log(&task(3, id), log, &Control::unhurried()).unwrap().overall;
    let plan = good(id);
    // Everything of glass in the right order, then replaced from the roof down.
    let mut cheat = BlockLog { profile: Profile::Mindcraft, ..BlockLog::default() };
    let blocks: Vec<(Cell, &str)> = plan.turns[0]
        .iter()
        .filter_map(|event| match *event {
            Event::Place { cell, material } => Some((cell, plan.palette.name(material))),
            Event::Remove { .. } => None,
        })
        .collect();
    for (cell, _) in &blocks {
        cheat.place(*cell, "glass");
    }
    for (cell, name) in blocks.iter().rev() {
        cheat.place(*cell, name);
    }
    assert!(!passes(&cheat));
    // One course of dirt too high, over which the roof is laid last.
    let mut honest = BlockLog { profile: Profile::Mindcraft, ..BlockLog::default() };
    honest.place(Cell::new(1, 3, 0), "glass");
    for (cell, name) in &blocks {
        honest.place(*cell, name);
    }
    assert!(passes(&plan) && passes(&honest));
}

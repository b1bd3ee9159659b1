//! What the fourth version of the suite mends: cheap builds that version 3 passes, of the kind that somebody finds who
//! searches for them, and honest ones that both must pass.

use plumbline_engine::builders::build;
use plumbline_engine::voxel::{BlockLog, Cell, Event, Profile};

use crate::verdicts::{Fill, built, task, verdict};

fn good(id: &str) -> BlockLog {
    build(&task(4, id)).unwrap()
}

/// A cheap build, which only version 3 passes; `check` is what version 4 says first.
fn is_caught_now(id: &str, log: &BlockLog, check: &str) {
    assert_eq!(verdict(3, id, log), None, "{id}: version 3 fails it as well");
    let told = verdict(4, id, log).unwrap_or_default();
    assert!(told.starts_with(check), "{id}: {told:?}");
}

/// An honest build, which both versions pass.
fn is_right(id: &str, log: &BlockLog) {
    assert_eq!([verdict(3, id, log), verdict(4, id, log)], [None, None], "{id}");
}

/// Changes the cells of a good build.
fn moved(id: &str, to: impl Fn(Cell, &str) -> Cell) -> BlockLog {
    let mut log = good(id);
    let palette = log.palette.clone();
    for event in log.turns.iter_mut().flatten() {
        if let Event::Place { cell, material } = event {
            *cell = to(*cell, palette.name(*material));
        }
    }
    log
}

#[test]
fn a_roof_upside_down_is_caught() {
    let turned = |cell: Cell, name: &str| if name == "oak_planks" { Cell::new(cell.x, -1, cell.z) } else { cell };
    is_caught_now("roofs/3x5-h3-c2-shelter", &moved("roofs/3x5-h3-c2-shelter", turned), "shape.level_has");
    is_caught_now("one-layer-roofs/c5-span", &moved("one-layer-roofs/c5-span", turned), "shape.level_has");
    let two = moved("two-layer-roofs/c4-span", |cell, name| match name {
        "iron_block" => Cell::new(cell.x, -2, cell.z),
        "gray_concrete" => Cell::new(cell.x, -1, cell.z),
        _ => cell,
    });
    is_caught_now("two-layer-roofs/c4-span", &two, "shape.level_has");
}

#[test]
fn columns_that_hang_or_carry_nothing_are_caught() {
    // One column stands; the other is a foot on the ground and a stub below the roof, elsewhere.
    let stub: &[Fill<'_>] = &[
        ("stone", [0, 0, 0], [0, 2, 0]),
        ("stone", [2, 0, 4], [2, 0, 4]),
        ("stone", [0, 1, 4], [0, 2, 4]),
        ("oak_planks", [0, 3, 0], [2, 3, 4]),
    ];
    is_caught_now("roofs/3x5-h3-c2-shelter", &built(&[stub]), "shape.has_columns");
    // Piles of loose blocks, elsewhere on each level; one shaft leads down.
    let id = "deep-foundations/7x7-t1-p4-piles";
    let mut levels: Vec<Fill<'_>> = vec![("stone", [0, 0, 0], [6, 0, 6]), ("stone", [0, -5, 0], [0, -1, 0])];
    for (y, [a, b, c]) in (-5..0).zip([[[6, 0], [6, 6], [0, 6]], [[4, 2], [4, 4], [2, 4]]].into_iter().cycle()) {
        levels.extend([a, b, c].map(|[x, z]| ("stone", [x, y, z], [x, y, z])));
    }
    is_caught_now(id, &built(&[&levels]), "shape.has_columns");
    // Four columns, one of which alone carries the slab beside it.
    let beside: &[Fill<'_>] = &[
        ("stone", [0, 0, 0], [0, 4, 0]),
        ("stone", [-2, 0, 0], [-2, 4, 0]),
        ("stone", [-4, 0, 0], [-4, 4, 0]),
        ("stone", [-6, 0, 0], [-6, 4, 0]),
        ("stone", [0, 5, 0], [5, 5, 5]),
    ];
    is_caught_now("second-floors/frame", &built(&[beside]), "shape.has_columns");
}

#[test]
fn a_deck_that_touches_one_support_alone_is_caught() {
    let stub: &[Fill<'_>] =
        &[("stone", [0, 0, 0], [0, 20, 2]), ("stone", [1, 20, 0], [10, 20, 2]), ("stone", [11, 0, 0], [11, 2, 0])];
    is_caught_now("bridges/w10-b3-build", &built(&[stub]), "shape.has_clear_span");
    // The deck of a good bridge may overhang a narrow pier.
    let narrow: &[Fill<'_>] = &[
        ("stone", [0, 0, 1], [0, 2, 1]),
        ("stone", [11, 0, 1], [11, 2, 1]),
        ("stone", [0, 3, 0], [11, 3, 2]),
        ("stone", [0, 4, 0], [0, 4, 0]),
        ("lantern", [11, 4, 0], [11, 4, 0]),
        ("water", [4, 0, 0], [6, 0, 2]),
    ];
    let [before, now] = [3, 4].map(|version| verdict(version, "bridges/w10-b3-build", &built(&[narrow])));
    assert!(before.is_some_and(|told| told.contains("3 separate supports")), "water is a support to version 3");
    assert_eq!(now, None);
}

#[test]
fn what_one_walks_through_is_no_structure() {
    for id in ["bridges/w10-b3-build", "domes/d7-h4-build", "second-floors/frame", "arch-bridges/w10-b3-build"] {
        let mut log = good(id);
        let mut light = BlockLog::default();
        light.turns.push(log.turns[0].iter().map(|event| Event::Place { cell: event.cell(), material: 0 }).collect());
        light.palette.intern("light");
        is_caught_now(id, &light, "shape.");
        log.place(Cell::new(60, 0, 60), "torch");
        assert_eq!(verdict(4, id, &log), None, "a torch is no fault: {id}");
    }
}

#[test]
fn an_umbrella_on_a_pole_is_caught() {
    let id = "domes/d7-h4-build";
    // The shell hangs on a pole beside its middle, over two sides of a base.
    let mut log = good(id);
    log.turns[0].retain(|event| event.cell().y > 0);
    let base = (0..7).map(|z| [0, z]).chain((1..7).map(|x| [x, 0])).chain([[1, 3], [2, 3], [1, 6]]);
    let pole = (1..4).map(|y| Cell::new(2, y, 3));
    for cell in base.map(|[x, z]| Cell::new(x, 0, z)).chain(pole) {
        log.place(cell, "white_concrete");
    }
    is_caught_now(id, &log, "shape.is_vault: too little of its edge reaches down to the ground");
    // An entrance two blocks wide is no fault, and a base in the form of a disc neither.
    let mut open = good("domes/d10-h5-build");
    open.turns[0].retain(|event| !(event.cell().x == 0 && (4..6).contains(&event.cell().z) && event.cell().y < 2));
    assert_eq!(verdict(4, "domes/d10-h5-build", &open), None);
    for (x, z) in (2..8).flat_map(|x| (2..8).map(move |z| (x, z))) {
        open.place(Cell::new(x, 0, z), "stone");
    }
    assert_eq!(verdict(4, "domes/d10-h5-build", &open), None);
}

#[test]
fn floors_and_foundations_elsewhere_are_caught() {
    let id = "cabins/n56-stock";
    let mut bare = good(id);
    // The floor becomes natural ground, and a post keeps the height.
    bare.turns[0].retain(|event| event.cell().y != -1);
    bare.place(Cell::new(0, -1, 0), "oak_planks");
    is_caught_now(id, &bare, "material.is_made_of");
    let id = "one-story-plans/fpwr";
    let scattered = |cell: Cell, name: &str| {
        if name == "gray_concrete" { Cell::new(40 + 2 * cell.x, -1, 2 * cell.z) } else { cell }
    };
    is_caught_now(id, &moved(id, scattered), "shape.level_has");
    let apart = |cell: Cell, name: &str| {
        if name == "gray_concrete" { Cell::new(40 + cell.x, -1, cell.z) } else { cell }
    };
    is_caught_now(id, &moved(id, apart), "material.is_made_of");
}

/// A house in the sky: a pole carries it, and a ledge lies before its door.
#[test]
fn rooms_that_nobody_can_reach_are_caught() {
    for id in [
        "rooms/r2-build",
        "asymmetric-buildings/r2-build",
        "high-ceilings/r2-build",
        "accessible-houses/r2-b1-step-free",
    ] {
        let mut sky = moved(id, |cell, _| cell.offset(0, 20, 0));
        let bounds: Vec<Cell> = sky.turns[0].iter().map(Event::cell).collect();
        let (x0, x1) = (bounds.iter().map(|c| c.x).min().unwrap(), bounds.iter().map(|c| c.x).max().unwrap());
        let z1 = bounds.iter().map(|c| c.z).max().unwrap();
        for (x, z) in (x0..=x1).flat_map(|x| (-2..=z1).map(move |z| (x, z))) {
            if !bounds.contains(&Cell::new(x, 19, z)) {
                sky.place(Cell::new(x, 19, z), "stone");
            }
        }
        for y in 0..19 {
            sky.place(Cell::new(x0, y, -2), "stone");
        }
        if id.starts_with("accessible") {
            // Beds would find no way out; one room stays on the ground with them.
            assert!(verdict(4, id, &sky).is_some());
            continue;
        }
        is_caught_now(id, &sky, "shape.");
        // With rungs on the pole one can climb up to it.
        for y in 0..20 {
            sky.place(Cell::new(x0 - 1, y, -2), "ladder");
        }
        is_right(id, &sky);
    }
}

#[test]
fn stairs_elsewhere_are_caught() {
    let id = "frames/s2-frame-build";
    let mut log = good(id);
    let is_stair = |cell: Cell| (2..=6).contains(&cell.x) && (2..=6).contains(&cell.z);
    log.turns[0].retain(|event| !is_stair(event.cell()));
    for y in 0..5 {
        for below in 0..=y {
            log.place(Cell::new(60 + y, below, 0), "white_concrete");
        }
    }
    is_caught_now(id, &log, "shape.climbs_to");
}

#[test]
fn a_house_on_a_plinth_is_reached_by_a_step() {
    let id = "rooms/r1-build";
    let mut log = moved(id, |cell, _| cell.offset(0, 1, 0));
    log.profile = Profile::Mindcraft;
    for (x, z) in (0..6).flat_map(|x| (-1..6).map(move |z| (x, z))) {
        log.place(Cell::new(x, 0, z), "oak_planks");
    }
    is_right(id, &log);
}

/// What a walker passes through holds nothing up, but the simulation of stress would count it.
#[test]
fn props_of_light_are_caught() {
    let mut log = good("one-layer-roofs/c5-span");
    for (x, z) in [(4, 0), (5, 0)] {
        log.place(Cell::new(x, 0, z), "light");
        log.place(Cell::new(x, 1, z), "light");
    }
    let told = verdict(4, "one-layer-roofs/c5-span", &log).unwrap_or_default();
    assert!(told.starts_with("shape.has_columns") && told.contains("1 column of another size"), "{told}");
    let id = "stressed-arches/2-wide-2-leg-build";
    let mut log = good(id);
    log.place(Cell::new(0, 0, 0), "water");
    assert!(verdict(4, id, &log).is_some());
}

#[test]
fn a_slab_with_a_chimney_is_no_dome() {
    let id = "domes/d10-h5-build";
    let is_middle = |x: i32, z: i32| (x, z) == (4, 4);
    let mut log = BlockLog::default();
    for (x, z) in (0..10).flat_map(|x| (0..10).map(move |z| (x, z))).filter(|(x, z)| !is_middle(*x, *z)) {
        log.place(Cell::new(x, 0, z), "stone");
    }
    for [x, y, z] in [[3, 1, 4], [5, 1, 4], [4, 1, 3], [4, 1, 5], [4, 2, 4], [4, 3, 4], [4, 4, 4], [4, 5, 4], [5, 2, 4]]
    {
        log.place(Cell::new(x, y, z), "stone");
    }
    is_caught_now(id, &log, "shape.is_vault: too little of it is hollow");
}

#[test]
fn a_pancake_with_two_fins_is_no_dome() {
    let levels: [&[[i32; 2]]; 4] = [
        &[[0, 2], [0, 3], [1, 1], [1, 4], [2, 0], [2, 4], [3, 0], [3, 3], [4, 1], [4, 2], [4, 3]],
        &[[1, 1], [1, 2], [1, 3], [2, 1], [2, 3], [3, 1], [3, 2]],
        &[[1, 2], [2, 1], [2, 2], [2, 3], [3, 2]],
        &[[2, 2]],
    ];
    let mut log = BlockLog::default();
    for (y, cells) in (0..).zip(levels) {
        for [x, z] in cells {
            log.place(Cell::new(*x, y, *z), "stone");
        }
    }
    let told = verdict(4, "domes/d5-h3-build", &log).unwrap_or_default();
    assert!(told.starts_with("shape.is_vault"), "{told}");
}

#[test]
fn a_support_of_one_block_is_caught() {
    let id = "stressed-arches/2-wide-2-leg-build";
    let mut log = good(id);
    let first = log.turns[0].iter().map(Event::cell).map(|cell| cell.x).min().unwrap();
    log.turns[0].retain(|event| event.cell().y > 0 || event.cell().x > first + 1);
    let last = log.turns[0].iter().map(Event::cell).map(|cell| cell.x).max().unwrap();
    log.place(Cell::new(first + 1, 0, 0), "stone");
    for (x, z) in [(last + 1, 0), (last + 1, 1), (last + 2, 0)] {
        log.place(Cell::new(x, 0, z), "stone");
    }
    let told = verdict(4, id, &log).unwrap_or_default();
    assert!(told.starts_with("shape.level_has") && told.contains("each part: at least 4"), "{told}");
}

#[test]
fn a_hut_with_a_mast_is_no_large_cabin() {
    let size = 6;
    let hut: &[Fill<'_>] = &[
        ("oak_planks", [1, -1, 1], [4, -1, 4]),
        ("oak_planks", [0, 0, 0], [0, 1, 5]),
        ("oak_planks", [5, 0, 0], [5, 1, 5]),
        ("oak_planks", [1, 0, 5], [4, 1, 5]),
        ("oak_planks", [1, 0, 0], [1, 1, 0]),
        ("oak_planks", [3, 0, 0], [4, 1, 0]),
        ("oak_door", [2, 0, 0], [2, 0, 0]),
        ("oak_planks", [1, 2, 1], [4, 2, 4]),
        ("oak_planks", [0, 2, 1], [0, size - 2, 1]),
    ];
    is_caught_now("cabins/n152-stock", &built(&[hut]), "shape.has_ceilings");
}

#[test]
fn a_plank_on_corbels_is_no_arch() {
    let plank: &[Fill<'_>] = &[
        ("stone", [0, 0, 0], [0, 3, 0]),
        ("stone", [11, 0, 0], [11, 3, 0]),
        ("stone", [1, 3, 0], [1, 3, 0]),
        ("stone", [10, 3, 0], [10, 3, 0]),
        ("stone", [1, 4, 0], [10, 4, 2]),
    ];
    is_caught_now("arch-bridges/w10-b3-build", &built(&[plank]), "shape.is_true_arch: the underside rises by 1 block");
}

#[test]
fn one_room_on_a_ladder_is_no_house_of_two_stories() {
    let id = "high-ceilings/two-story-build";
    let mut log = good(id);
    // The ground floor stays open.
    log.turns[0].retain(|event| !(event.cell().x == 0 && event.cell().y == 1 && event.cell().z == 3));
    is_caught_now(id, &log, "shape.has_upper_floor");
}

/// A room of three by three whose walls are doors, but for one block and the corners.
#[test]
fn walls_of_doors_are_caught() {
    let mut log = BlockLog::default();
    log.turns.push(Vec::new());
    for (x, z) in (0..5).flat_map(|x| (0..5).map(move |z| (x, z))) {
        let (on_x, on_z) = (x % 4 == 0, z % 4 == 0);
        let is_wall = on_x && on_z || (x, z) == (2, 4);
        for y in 0..2 {
            if is_wall {
                log.place(Cell::new(x, y, z), "stone");
            } else if (on_x || on_z) && y == 0 {
                log.place(Cell::new(x, y, z), "oak_door");
            }
        }
        log.place(Cell::new(x, 2, z), "stone");
    }
    is_caught_now("rooms/r1-build", &log, "shape.has_enclosed_rooms");
}

#[test]
fn doors_in_a_meadow_and_beds_in_walls_are_caught() {
    // Three of the four doors stand beside the theatre.
    let id = "theatres/s25-build";
    let mut log = good(id);
    let door = log.palette.get("oak_door").unwrap();
    let walls = log.palette.get("gray_concrete").unwrap();
    let mut upper = Vec::new();
    for event in &mut log.turns[0] {
        if let Event::Place { cell, material } = event
            && *material == door
            && !(cell.z == 0 && cell.x == 6)
        {
            *material = walls;
            upper.push(cell.offset(0, 1, 0));
        }
    }
    for cell in upper {
        log.place(cell, "gray_concrete");
    }
    for z in [2, 4, 6] {
        log.place(Cell::new(14, 0, z), "oak_door");
    }
    is_caught_now(id, &log, "shape.doors_lead_through");
    // The bed is a part of the back wall.
    let id = "bedrooms/r1-build";
    let mut log = good(id);
    let bed = log.palette.get("white_bed").unwrap();
    let back = Cell::new(2, 0, 5);
    log.turns[0].retain(|event| event.cell() != back);
    for event in &mut log.turns[0] {
        if let Event::Place { cell, material } = event
            && *material == bed
        {
            *cell = back;
        }
    }
    is_caught_now(id, &log, "shape.walks_out");
}

#[test]
fn a_pebble_makes_no_room_smaller() {
    let id = "revisions/r2-r1";
    let mut log = good(id);
    // In the second turn things stand in one of the two rooms, and nothing is built.
    let first = log.turns[0].clone();
    log.turns = vec![first, Vec::new()];
    for (x, z) in [(6, 1), (6, 2), (7, 3), (8, 4), (9, 4), (9, 3), (8, 2), (9, 1)] {
        log.place(Cell::new(x, 0, z), "stone");
        log.place(Cell::new(x, 1, z), "stone");
    }
    is_caught_now(id, &log, "shape.has_enclosed_rooms");
}

#[test]
fn a_slab_of_two_strips_is_caught() {
    let strips: &[Fill<'_>] = &[
        ("stone", [0, 0, 0], [0, 4, 0]),
        ("stone", [4, 0, 0], [4, 4, 0]),
        ("stone", [8, 0, 0], [8, 4, 0]),
        ("stone", [0, 0, 9], [0, 4, 9]),
        ("stone", [0, 5, 0], [17, 5, 0]),
        ("stone", [0, 5, 1], [0, 5, 18]),
    ];
    is_caught_now("second-floors/frame", &built(&[strips]), "shape.level_has");
}

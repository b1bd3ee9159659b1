//! Checks with arguments as task files have them, on structures: they score what the same rules score when they are
//! written plainly ([`twins`]), and find the same each time.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use arbitrary::{Arbitrary, Unstructured};
use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::published::read_check;
use plumbline_engine::voxel::{Cell, Profile, Reading, Structure};
use serde_json::{Value, json};

use super::twins;

#[path = "../../bench/arguments.rs"]
mod arguments;

/// Names of blocks that checks treat in different ways.
const BLOCKS: [&str; 16] = [
    "stone",
    "glass",
    "oak_planks",
    "oak_stairs",
    "oak_slab",
    "ladder",
    "oak_door",
    "spruce_door",
    "oak_trapdoor",
    "red_bed",
    "red_carpet",
    "torch",
    "water",
    "oak_fence",
    "air",
    "no_such_block",
];
/// An argument with values in JSON.
type Optional = (&'static str, &'static [&'static str]);

/// Arguments that some checks have and that may be left out, each with values in JSON.
const OPTIONAL: [Optional; 42] = [
    ("use_8_neighbors", &["true"]),
    ("use_substring_match", &["true", "false"]),
    ("substring_match", &["false"]),
    ("ratio_threshold", &["0", "0.3", "1"]),
    ("height_y", &["0", "1", "3"]),
    ("expected_material", &["null", "\"oak\"", "\"Stone\"", "\"\""]),
    ("strict", &["true", "\"non-flat\""]),
    ("start_material", &["\"bed\"", "\"stone\"", "\"\"", "null"]),
    ("with_supports", &["true"]),
    ("min_width", &["0", "2", "3"]),
    ("no_gaps", &["true"]),
    ("min_cover", &["0.5", "1"]),
    ("max_rooms", &["0", "1", "2"]),
    ("min_floor_cells", &["0", "1", "9"]),
    ("max_step", &["0", "2"]),
    ("width", &["1", "2", "3"]),
    (
        "part",
        &[
            "\"corners\"",
            "\"sides\"",
            "\"roof\"",
            "\"room_walls\"",
            "\"room_corners\"",
            "\"room_roof\"",
            "\"under_rooms\"",
        ],
    ),
    ("except", &["\"glass\"", "\"#doors\""]),
    ("of", &["\"#doors\"", "\"#beds\"", "\"oak_planks\"", "\"#oak\"", "null"]),
    ("max_blocks", &["0", "9"]),
    ("max_parts", &["1", "2"]),
    ("min_size", &["[1, 3]", "null"]),
    ("min_top", &["2", "4"]),
    ("y", &["0", "1", "2", "null"]),
    ("solid", &["true"]),
    ("min_part_blocks", &["1", "2"]),
    ("full_size", &["[1, 2]", "[3, 2]", "null"]),
    ("min_rise", &["1", "2"]),
    ("max_door_share", &["0", "0.2", "0.5", "null"]),
    ("counted_from", &["0", "2", "null"]),
    ("min_parting", &["1", "2"]),
    ("indoors", &["true"]),
    ("ground_cells", &["1", "4"]),
    ("min_hollow", &["0.5", "1"]),
    ("shell", &["true"]),
    ("one_piece", &["true"]),
    ("min_footing", &["0.5", "0.8", "1"]),
    ("onto_floor", &["true"]),
    ("max_columns", &["1", "4", "null"]),
    ("size", &["[1, 1]", "[1, 2]", "null"]),
    ("carry", &["true", "false"]),
    ("alone", &["true", "false"]),
];
/// Greatest number of blocks.
const MAX: usize = 300;
/// Greatest number of blocks where stress is computed, which takes a thousand times as long as any other check.
const MAX_STRESSED: usize = 20;

pub fn run(data: &[u8]) {
    let mut bytes = Unstructured::new(data);
    if let Ok((name, _)) = bytes.choose(Check::LIST) {
        let _ = scored(name, &mut bytes);
    }
}

fn scored(name: &str, bytes: &mut Unstructured<'_>) -> arbitrary::Result<()> {
    let mut arguments = arguments::arguments(name);
    for value in arguments.as_object_mut().expect("arguments are an object").values_mut() {
        if bytes.ratio(1, 4)? {
            *value = changed(value, bytes)?;
        }
    }
    // Each argument that this check has is given now and then.
    for (argument, values) in &TAKEN[name] {
        if bytes.ratio(1, 3)? {
            arguments[*argument] = serde_json::from_str(bytes.choose(values)?).expect("the list has JSON");
        }
    }
    let Some(check) = read(name, &arguments) else { return Ok(()) };
    let structure = build(bytes)?;
    if name.starts_with("structural_stability") && structure.len() > MAX_STRESSED {
        return Ok(());
    }
    let found = || check.evaluate(&Subject::unhurried(&structure)).expect("nothing stops it");
    let finding = found();
    assert_eq!(format!("{finding:?}"), format!("{:?}", found()));
    let alone = check.evaluate(&Subject::unhurried(&structure).for_scores()).expect("nothing stops it");
    assert_eq!(finding.score, alone.score, "{name} {arguments}: the score depends on whether evidence is asked");
    let twin = twins::score(name, &arguments, &twins::Build::of(&structure));
    let told = || format!("{name} {arguments} on {:?}", twins::Build::of(&structure).blocks);
    assert!(twin.is_none_or(|score| score == finding.score), "{} {finding:?}, its twin {twin:?}", told());
    Ok(())
}

/// The optional arguments of each check.
static TAKEN: LazyLock<BTreeMap<&str, Vec<Optional>>> = LazyLock::new(|| {
    let taken = |name| OPTIONAL.into_iter().filter(|(argument, values)| takes(name, argument, values)).collect();
    Check::LIST.iter().map(|(name, _)| (*name, taken(name))).collect()
});

/// Whether a check has an argument: then it takes one of these values for it.
fn takes(name: &str, argument: &str, values: &[&str]) -> bool {
    let mut arguments = arguments::arguments(name);
    values.iter().any(|value| {
        arguments[argument] = serde_json::from_str(value).expect("the list has JSON");
        read(name, &arguments).is_some()
    })
}

fn read(name: &str, arguments: &Value) -> Option<Check> {
    read_check(&json!({ "fn": name, "args": arguments }), &mut Faults::new())
}

/// Runs each check on builds of chance, as many for each.
#[cfg(test)]
pub fn run_each(inputs: &(impl Iterator<Item = Vec<u8>> + Clone)) {
    for (name, _) in Check::LIST.iter().filter(|(name, _)| !name.starts_with("structural_stability")) {
        for data in inputs.clone() {
            let _ = scored(name, &mut Unstructured::new(&data));
        }
    }
}

/// Panics unless every check has a twin, but for those of stress.
#[cfg(test)]
pub fn every_check_has_a_twin() {
    let structure = Structure::from_named([(Cell::new(0, 0, 0), "stone"), (Cell::new(1, 0, 0), "glass")]);
    for (name, _) in Check::LIST.iter().filter(|(name, _)| !name.starts_with("structural_stability")) {
        let twin = twins::score(name, &arguments::arguments(name), &twins::Build::of(&structure));
        assert!(twin.is_some(), "{name} has no twin");
    }
}

/// Builds of single blocks, boxes, huts, covers and their mirror images, as listed or as the game reads them.
fn build(bytes: &mut Unstructured<'_>) -> arbitrary::Result<Structure> {
    let (side, low) = (bytes.int_in_range(1..=9)?, bytes.int_in_range(-1..=0)?);
    let (reading, profile) = (
        *bytes.choose(&[Reading::AsListed, Reading::Game])?,
        *bytes.choose(&[Profile::Published, Profile::Mindcraft])?,
    );
    let is_listed_twice = bytes.ratio(1, 8)?;
    let mut blocks: Vec<(Cell, &str)> = Vec::new();
    while !bytes.is_empty() && blocks.len() < MAX {
        let mut at = || -> arbitrary::Result<[i32; 3]> {
            Ok([bytes.int_in_range(0..=side)?, bytes.int_in_range(low..=side)?, bytes.int_in_range(0..=side)?])
        };
        let (one, other) = (at()?, at()?);
        let name = *bytes.choose(&BLOCKS)?;
        match bytes.int_in_range(0..=9)? {
            8 => blocks.extend(hut(one, other)),
            9 => blocks.extend(cover(one, other).into_iter().map(|cell| (cell, name))),
            0 | 1 => blocks.extend(boxed(one, other, bytes.arbitrary()?).map(|cell| (cell, name))),
            2 => {
                let mirrored: Vec<_> =
                    blocks.iter().map(|(cell, name)| (Cell::new(side - cell.x, cell.y, cell.z), *name)).collect();
                blocks.extend(mirrored);
            }
            // Replaces what stood there, like a door set into a wall.
            3 => {
                blocks.retain(|(cell, _)| <[i32; 3]>::from(*cell) != one);
                blocks.push((one.into(), name));
            }
            _ => blocks.push((one.into(), name)),
        }
    }
    blocks.truncate(MAX);
    if !is_listed_twice {
        let mut taken = BTreeSet::new();
        blocks.retain(|(cell, _)| taken.insert(*cell));
    }
    Ok(reading.read(Structure::from_named(blocks), profile))
}

/// Returns the cells of a box between two corners, or of its surface.
fn boxed(one: [i32; 3], other: [i32; 3], is_hollow: bool) -> impl Iterator<Item = Cell> {
    let range = move |axis: usize| one[axis].min(other[axis])..=one[axis].max(other[axis]);
    let is_end = move |axis: usize, at: i32| at == one[axis] || at == other[axis];
    let cells = range(1).flat_map(move |y| range(0).flat_map(move |x| range(2).map(move |z| [x, y, z])));
    cells.filter(move |at| !is_hollow || (0..3).any(|axis| is_end(axis, at[axis]))).map(Cell::from)
}

/// Returns a hut on the ground with a bed, and a door in the side of the least z.
fn hut([x, top, z]: [i32; 3], [far_x, _, far_z]: [i32; 3]) -> impl Iterator<Item = (Cell, &'static str)> {
    let low = Cell::new(x.min(far_x), -1, z.min(far_z));
    // A larger one would be cut off at the most blocks, and lose its roof.
    let high = Cell::new(x.max(far_x).min(low.x + 6), top.clamp(3, 5), z.max(far_z).min(low.z + 6));
    let doorway = low.offset(1, 1, 0);
    let is_wall = move |cell: &Cell| cell.y >= 0 && *cell != doorway && *cell != doorway.offset(0, 1, 0);
    let walls = boxed(low.into(), high.into(), true).filter(is_wall).map(|cell| (cell, "stone"));
    walls.chain([(doorway, "oak_door"), (doorway.offset(0, 0, 2), "red_bed")])
}

/// Returns a cover that rises by a block with each step from its edges to its middle, two blocks thick.
fn cover(one: [i32; 3], other: [i32; 3]) -> Vec<Cell> {
    let range = |axis: usize| one[axis].min(other[axis])..=one[axis].max(other[axis]);
    let from_edge = |axis: usize, at: i32| one[axis].abs_diff(at).min(other[axis].abs_diff(at)) as i32;
    let height = |x: i32, z: i32| one[1] + from_edge(0, x).min(from_edge(2, z));
    let columns = range(0).flat_map(|x| range(2).map(move |z| Cell::new(x, height(x, z), z)));
    columns.flat_map(|cell| [cell, cell.offset(0, 1, 0)]).collect()
}

/// Returns another value, mostly of the same kind.
fn changed(value: &Value, bytes: &mut Unstructured<'_>) -> arbitrary::Result<Value> {
    Ok(match value {
        Value::Number(_) if bytes.ratio(7, 8)? => json!(bytes.int_in_range(-2..=9)?),
        Value::Number(_) => i64::arbitrary(bytes)?.into(),
        Value::Bool(was) => (!was).into(),
        Value::String(_) => (*bytes.choose(&BLOCKS)?).into(),
        Value::Array(items) if bytes.arbitrary()? => items.iter().chain(items).cloned().collect(),
        _ => Value::Null,
    })
}

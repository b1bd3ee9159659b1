//! Checks with arguments as task files have them, on structures: they end, and find the same each time.

use arbitrary::{Arbitrary, Unstructured};
use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::published::read_check;
use plumbline_engine::voxel::{Cell, Structure};
use serde_json::{Value, json};

#[path = "../../bench/arguments.rs"]
mod arguments;

/// Names of blocks that checks treat in different ways.
const BLOCKS: [&str; 12] = [
    "stone",
    "glass",
    "oak_planks",
    "oak_stairs",
    "oak_slab",
    "ladder",
    "oak_door",
    "red_bed",
    "torch",
    "water",
    "oak_fence",
    "no_such_block",
];
/// Greatest number of blocks.
const MOST: usize = 300;

pub fn run(data: &[u8]) {
    let _ = scored(&mut Unstructured::new(data));
}

fn scored(bytes: &mut Unstructured<'_>) -> arbitrary::Result<()> {
    let (name, _) = *bytes.choose(Check::LIST)?;
    let mut arguments = arguments::arguments(name);
    for value in arguments.as_object_mut().expect("arguments are an object").values_mut() {
        if bytes.ratio(1, 4)? {
            *value = changed(value, bytes)?;
        }
    }
    let Some(check) = read_check(&json!({ "fn": name, "args": arguments }), &mut Faults::new()) else { return Ok(()) };
    let side = bytes.int_in_range(1..=12)?;
    let mut blocks = Vec::new();
    while !bytes.is_empty() && blocks.len() < MOST {
        let at =
            Cell::new(bytes.int_in_range(0..=side)?, bytes.int_in_range(-1..=side)?, bytes.int_in_range(0..=side)?);
        blocks.push((at, *bytes.choose(&BLOCKS)?));
    }
    let structure = Structure::from_named(blocks);
    let found = || format!("{:?}", check.evaluate(&Subject::unhurried(&structure)));
    assert_eq!(found(), found());
    Ok(())
}

/// Returns another value, mostly of the same kind.
fn changed(value: &Value, bytes: &mut Unstructured<'_>) -> arbitrary::Result<Value> {
    Ok(match value {
        Value::Number(_) if bytes.arbitrary()? => json!(bytes.int_in_range(-2..=20)?),
        Value::Number(_) => i64::arbitrary(bytes)?.into(),
        Value::Bool(was) => (!was).into(),
        Value::String(_) => (*bytes.choose(&BLOCKS)?).into(),
        Value::Array(items) if bytes.arbitrary()? => items.iter().chain(items).cloned().collect(),
        _ => Value::Null,
    })
}

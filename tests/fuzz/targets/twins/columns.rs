//! Columns: the same cells on every level, from one to another.

use std::collections::BTreeSet;

use super::{Arguments, Build, Flat, parts};

pub fn holds(arguments: Arguments<'_>, build: &Build<'_>) -> bool {
    if build.blocks.is_empty() {
        return false;
    }
    let build = &build.standing(arguments.flag("solid", false));
    let (low, high) = (arguments.integer("from_y", 0), arguments.integer("to_y", 0));
    let of = arguments.blocks("of");
    let own = build.cells(|name| of.is_none_or(|of| of.has(name)));
    let places: BTreeSet<Flat> = own.iter().map(|at| (at[0], at[2])).collect();
    // No build of the fuzzer is as high as this.
    let is_filled = |at: &Flat| high - low < 1_000 && (low..=high).all(|y| own.contains(&[at.0, y, at.1]));
    let filled: BTreeSet<Flat> = places.into_iter().filter(|at| low <= high && is_filled(at)).collect();
    let columns = parts(&filled, true);
    let size: Vec<i64> = arguments.list("size").into_iter().filter_map(serde_json::Value::as_i64).collect();
    let has_size = |column: &BTreeSet<Flat>| {
        let span = |along: fn(&Flat) -> i64| {
            column.iter().map(along).max().expect("a place") - column.iter().map(along).min().expect("a place") + 1
        };
        let (x, z) = (span(|at| at.0), span(|at| at.1));
        let is_turned = [x, z] == [size[0], size[1]] || [z, x] == [size[0], size[1]];
        is_turned && column.len() as i64 == x * z
    };
    let all = build.all();
    let carries = |column: &BTreeSet<Flat>| column.iter().any(|at| all.contains(&[at.0, high + 1, at.1]));
    let stands_alone = |y: i64| {
        let level = build.level(y);
        let level_parts = parts(&level, true);
        if size.is_empty() {
            let holds_one =
                |part: &BTreeSet<Flat>| columns.iter().filter(|column| part.is_superset(column)).count() == 1;
            level_parts.iter().all(holds_one)
        } else {
            level == filled
        }
    };
    let levels: BTreeSet<i64> = all.iter().map(|at| at[1]).filter(|y| (low..=high).contains(y)).collect();
    let count = columns.len() as f64;
    arguments.number("min_columns").unwrap_or(1.0) <= count
        && arguments.number("max_columns").is_none_or(|most| count <= most)
        && (size.is_empty() || columns.iter().all(has_size))
        && (!arguments.flag("carry", false) || columns.iter().all(carries))
        && (!arguments.flag("alone", false) || levels.into_iter().all(stands_alone))
}

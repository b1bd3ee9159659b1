//! Every check at the limits: 100,000 blocks, close together and as far apart as coordinates go.
//!
//! A rule that were quadratic in the blocks, or that allocated by the extent of the build, would not come back.

use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::voxel::{Cell, Structure};
use serde_json::json;

const BLOCKS: i32 = 100_000;

/// Every check but the stress simulation, which has a limit of its own.
fn checks() -> Vec<Check> {
    let with =
        |name: &str, args: serde_json::Value| serde_json::from_value(json!({ "fn": name, "args": args })).unwrap();
    let mut checks = Vec::new();
    for (name, _) in Check::LIST {
        let args = match *name {
            "material.is_block_cnt_equal_to" => json!({ "expected_count": 5 }),
            "material.is_block_cnt_larger_than" => json!({ "cnt": 5 }),
            "material.is_block_cnt_geq" => json!({ "min_count": 5 }),
            "material.is_block_cnt_leq" => json!({ "max_count": 5 }),
            "material.are_blocks_known" => json!({}),
            "material.count_is_within" => json!({ "of": "#doors", "min": 5 }),
            "material.is_made_of" => json!({ "of": "stone", "part": "roof" }),
            "shape.has_enclosed_rooms" => json!({ "min_rooms": 2, "max_step": 1, "max_door_share": 0.5 }),
            "shape.walks_out" => json!({ "from": "stone", "width": 2, "indoors": true }),
            "shape.climbs_to" => json!({ "min_y": 3, "onto_floor": true }),
            "shape.has_upper_floor" => json!({ "min_y": 3, "ground_cells": 9 }),
            "shape.doors_lead_through" => json!({ "min_parting": 1 }),
            "shape.has_clear_span" => json!({ "height": 200, "min_free": 5, "one_piece": true }),
            "shape.is_vault" => {
                json!({ "min_clear": 2, "min_cover": 0.5, "no_gaps": true, "min_footing": 0.8, "min_hollow": 0.5, "shell": true })
            }
            "shape.has_ceilings" => json!({ "min_levels": 2 }),
            "shape.has_columns" => {
                json!({ "from_y": 0, "to_y": 3, "of": "#doors", "carry": true, "alone": true, "solid": true })
            }
            "shape.level_has" => json!({ "y": 0, "of": "#doors", "min_size": [2, 2], "full_size": [300, 300] }),
            "dependency.layers_follow" => json!({ "layers": ["stone", "#doors"] }),
            "structural_stability.equilibrium_score" => continue,
            name if name.starts_with("material.") => json!({ "expected_material": "stone" }),
            "size.is_equal" | "size.is_leq" => json!({ "xz": [5, 5], "y": 5 }),
            "size.min_y_is_equal" => json!({ "expected_y": 0 }),
            "size.min_y_is_leq" => json!({ "max_y": 0 }),
            "size.max_y_is_geq" => json!({ "min_y": 0 }),
            "size.all_dimensions_geq" => json!({ "min_size": 5 }),
            "shape.cluster_count_at_y_is" => json!({ "y": 0, "expected_count": 1 }),
            "shape.clusters_at_y_have_min_span" => json!({ "y": 0, "min_span": 3 }),
            "shape.cluster_at_y_has_min_radius" => json!({ "y": 0, "min_radius": 3 }),
            "shape.cluster_at_y_has_min_diameter" => json!({ "y": 0, "min_diameter": 3, "use_8_neighbors": true }),
            "shape.has_rooms" => json!({ "room_cnt": 2, "y": 0 }),
            "shape.are_adjacent" => json!({ "materials": ["stone", "door"] }),
            "shape.is_reachable_by_stairs" => json!({ "min_floor_y": 3 }),
            "dependency.material_sequence_order" => json!({ "material_sequence": ["stone", "door"] }),
            "structural_stability.stress_score" => continue,
            _ => json!({}),
        };
        checks.push(with(name, args));
    }
    checks
}

fn run_all(structure: &Structure) {
    for check in checks() {
        let finding = check.evaluate(&Subject::unhurried(structure)).unwrap();
        assert!((0.0..=1.0).contains(&finding.score), "{}: {}", check.name(), finding.score);
        assert!(finding.witnesses.len() <= 20, "{}", check.name());
        let alone = check.evaluate(&Subject::unhurried(structure).for_scores()).unwrap();
        assert_eq!(finding.score, alone.score, "{}", check.name());
    }
}

fn structure(cell: impl Fn(i32) -> Cell) -> Structure {
    Structure::from_named((0..BLOCKS).map(|i| (cell(i), if i % 100 == 0 { "oak_door" } else { "stone" })))
}

#[test]
fn a_solid_slab() {
    run_all(&structure(|i| Cell::new(i % 317, i / (317 * 317), i / 317 % 317)));
}

/// As large as builds may be that one walks in: cells of one block of air each, with floors, walls and doors.
#[test]
fn a_honeycomb() {
    let cells = (0..120).flat_map(|x| (0..60).flat_map(move |y| (0..120).map(move |z| Cell::new(x, y, z))));
    let walls = cells.filter(|cell| cell.x % 2 == 0 || cell.z % 2 == 0 || cell.y % 3 == 2).take(BLOCKS as usize);
    let name = |cell: Cell| if cell.y % 3 == 0 && cell.x % 4 == 1 && cell.z % 2 == 0 { "oak_door" } else { "stone" };
    run_all(&Structure::from_named(walls.map(|cell| (cell, name(cell)))));
}

#[test]
fn one_level() {
    run_all(&structure(|i| Cell::new(i % 317, 0, i / 317)));
}

#[test]
fn a_comb_whose_teeth_are_clusters() {
    run_all(&structure(|i| Cell::new(i % 500 * 2, 0, i / 500)));
}

#[test]
fn a_tower_and_a_line() {
    run_all(&structure(|i| Cell::new(0, i % 4_000 - 2_000, i / 4_000)));
    run_all(&structure(|i| Cell::new(i, 0, 0)));
}

#[test]
fn scattered_over_the_world() {
    // A fixed multiplicative walk: spread, and the same each time.
    let spread = |i: i32, factor: i64| ((i64::from(i) * factor) % 60_000_001 - 30_000_000) as i32;
    run_all(&structure(|i| Cell::new(spread(i, 48_271), i % 4_096 - 2_048, spread(i, 69_621))));
    run_all(&structure(|i| Cell::new(spread(i, 48_271), 0, spread(i, 69_621))));
}

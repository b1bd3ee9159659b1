//! How long each check takes at most, on builds that are made to be hard for it: `worst_checks [BLOCKS]`.
//!
//! The figures stand in `src/checks/cost.rs`, which decides by them where a log is graded. Prints, for each check, the
//! slowest build and the nanoseconds per block, as the least of five rounds.

#![allow(clippy::print_stdout, reason = "it prints what it measured")]

use std::time::Instant;

use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::voxel::{Cell, Structure};
use serde_json::{Value, json};

/// Arguments that let a check do all its work.
fn arguments(name: &str) -> Value {
    let short = name.split('.').next_back().unwrap_or_default();
    match short {
        "is_block_cnt_equal_to" => {
            json!({ "expected_count": 5, "expected_material": "stone", "use_substring_match": true })
        }
        "is_block_cnt_larger_than" => json!({ "cnt": 5, "expected_material": "stone" }),
        "is_block_cnt_geq" => json!({ "min_count": 5, "expected_material": "stone" }),
        "is_block_cnt_leq" => json!({ "max_count": 5, "expected_material": "stone" }),
        "is_all_material_equal_to" => json!({ "expected_material": "stone", "use_substring_match": true }),
        "is_highest_block_material_equal_to" => json!({ "expected_material": "stone" }),
        "count_is_within" => json!({ "of": "stone", "min": 1 }),
        "is_made_of" => json!({ "of": "stone", "part": "all", "min_share": 0.5 }),
        "is_equal" | "is_leq" => json!({ "xz": [5, 5], "y": 5 }),
        "min_y_is_equal" => json!({ "expected_y": 0 }),
        "min_y_is_leq" => json!({ "max_y": 0 }),
        "max_y_is_geq" => json!({ "min_y": 0 }),
        "all_dimensions_geq" => json!({ "min_size": 3 }),
        "cluster_count_at_y_is" => json!({ "y": 0, "expected_count": 2 }),
        "clusters_at_y_have_min_span" => json!({ "y": 0, "min_span": 1_000 }),
        "cluster_at_y_has_min_radius" => json!({ "y": 0, "min_radius": 5 }),
        "cluster_at_y_has_min_diameter" => json!({ "y": 0, "min_diameter": 5 }),
        "is_true_arch" => json!({ "support_y": 0 }),
        "has_rooms" => json!({ "room_cnt": 2, "y": 0 }),
        "are_adjacent" => json!({ "materials": ["stone", "glass"] }),
        "is_single_level" => json!({ "start_material": "bed" }),
        "has_exit" => json!({ "width": 16, "depth": 15, "height": 16, "start_material": "bed" }),
        "has_wide_exit" => json!({ "width": 16, "start_material": "bed" }),
        "is_reachable_by_stairs" => json!({ "min_floor_y": 1_000 }),
        "has_enclosed_rooms" => json!({ "min_rooms": 2 }),
        "doors_lead_through" => json!({ "min_doors": 2 }),
        "walks_out" => json!({ "from": "red_bed" }),
        "climbs_to" => json!({ "min_y": 50 }),
        "has_clear_span" => json!({ "height": 1, "min_free": 3 }),
        "is_vault" => json!({ "min_clear": 1 }),
        "stress_score" => json!({ "von_mises_stress": 1.0 }),
        "equilibrium_score" => json!({ "reference_pa": 1.0 }),
        "layers_follow" => json!({ "layers": ["stone", "glass"] }),
        "material_sequence_order" => json!({ "material_sequence": ["stone", "glass"] }),
        _ if short.ends_with("_material_equal_to") => json!({ "expected_material": "stone", "height_y": 0 }),
        _ => json!({}),
    }
}

const MATERIALS: [&str; 5] = ["stone", "glass", "oak_door", "red_bed", "oak_stairs"];

/// Builds of so many blocks: solid, flat, thin, scattered near and far, in walls, in towers, in checks.
fn builds(count: i32) -> Vec<(&'static str, Vec<Cell>)> {
    let side = f64::from(count).cbrt().ceil() as i32;
    let plane = f64::from(count).sqrt().ceil() as i32;
    let mut state = 7_u64;
    let mut random = move |n: i32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % n.max(1) as u64) as i32
    };
    let mut scattered = |x: i32, y: i32, z: i32| -> Vec<Cell> {
        (0..count).map(|_| Cell::new(random(x), random(y), random(z))).collect()
    };
    let cells = |cell: &dyn Fn(i32) -> Cell| (0..count).map(cell).collect::<Vec<_>>();
    vec![
        ("cube", cells(&|i| Cell::new(i % side, i / side / side, i / side % side))),
        ("plane", cells(&|i| Cell::new(i % plane, 0, i / plane))),
        ("wall", cells(&|i| Cell::new(i % plane, i / plane, 0))),
        ("line", cells(&|i| Cell::new(i, 0, 0))),
        ("diagonal", cells(&|i| Cell::new(i, 0, i))),
        ("stairs", cells(&|i| Cell::new(i % 300, i % 300, i / 300))),
        ("tower", cells(&|i| Cell::new(i / 300, i % 300, 0))),
        ("checkered plane", cells(&|i| Cell::new(2 * (i % plane) + i / plane % 2, 0, i / plane))),
        (
            "checkered cube",
            cells(&|i| Cell::new(2 * (i % side) + (i / side + i / side / side) % 2, i / side / side, i / side % side)),
        ),
        ("dotted plane", cells(&|i| Cell::new(3 * (i % plane), 0, 3 * (i / plane)))),
        (
            "rings",
            cells(&|i| {
                let r = 1 + (i / 8) % 60;
                let k = i % 8;
                Cell::new([-r, -r, -r, 0, 0, r, r, r][k as usize], i / 480, [-r, 0, r, -r, r, -r, 0, r][k as usize])
            }),
        ),
        ("scattered 20", scattered(20, 20, 20)),
        ("scattered 60", scattered(60, 60, 60)),
        ("scattered 120", scattered(120, 120, 120)),
        ("scattered plane", scattered(120, 1, 120)),
        ("scattered 1000", scattered(1_000, 300, 1_000)),
        ("scattered far", scattered(10_000_000, 300, 10_000_000)),
        ("scattered far plane", scattered(10_000_000, 1, 10_000_000)),
    ]
}

fn main() {
    let count = std::env::args().nth(1).and_then(|count| count.parse().ok()).unwrap_or(1_000);
    for (name, _) in Check::LIST {
        let check: Result<Check, _> = serde_json::from_value(json!({ "fn": name, "args": arguments(name) }));
        let check = match check {
            Ok(check) => check,
            Err(error) => {
                println!("{name:50} {error}");
                continue;
            }
        };
        let is_stress = name.starts_with("structural_stability");
        let mut worst = (0, String::new());
        for (build, cells) in builds(count) {
            for mixed in [false, true] {
                let material = |i: usize| if mixed { MATERIALS[i % MATERIALS.len()] } else { "stone" };
                let structure = Structure::from_named(cells.iter().enumerate().map(|(i, cell)| (*cell, material(i))));
                if is_stress && (mixed || build.starts_with("scattered")) {
                    continue;
                }
                let least = (0..if is_stress { 1 } else { 5 }).map(|_| {
                    let begun = Instant::now();
                    let _ = std::hint::black_box(check.evaluate(&Subject::unhurried(&structure)));
                    begun.elapsed().as_nanos()
                });
                let took = least.min().unwrap_or_default();
                if took > worst.0 {
                    worst = (took, format!("{build}{}", if mixed { ", mixed" } else { "" }));
                }
            }
        }
        println!("{name:50} {:>9} us  {:>8} ns/block  {}", worst.0 / 1_000, worst.0 / count as u128, worst.1);
    }
}

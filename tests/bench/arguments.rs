//! Arguments for checks, by their names, with which programs beside this file run every check.

use serde_json::{Value, json};

/// Arguments that let a check do all its work.
pub fn arguments(name: &str) -> Value {
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
        "has_upper_floor" => json!({ "min_y": 3, "min_cells": 4 }),
        "level_has" => json!({ "y": 0, "of": "stone", "min_blocks": 5, "min_parts": 2, "min_size": [2, 2] }),
        "has_columns" => json!({ "from_y": 0, "to_y": 3, "min_columns": 4, "carry": true, "alone": true }),
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

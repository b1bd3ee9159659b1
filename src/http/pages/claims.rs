//! What checks require, in the words of the pages.

use serde_json::Value;

use super::arguments::{Args, is_one, material, plain, range};
use plumbline_engine::checks::Check;
use plumbline_engine::text::counted;
pub use plumbline_engine::text::sentence;

/// Says what a check requires in one sentence, such as "All blocks are stone".
#[must_use]
pub fn claim(name: &str, args: &Value) -> String {
    let args = Args(args);
    of_materials(name, args)
        .or_else(|| of_sizes(name, args))
        .or_else(|| of_shapes(name, args))
        .or_else(|| of_levels(name, args))
        .or_else(|| of_safety_and_planning(name, args))
        .unwrap_or_else(|| plain_name(name))
}

/// Says what a check of a task requires in one sentence.
#[must_use]
pub fn claim_of(check: &Check) -> String {
    let written = serde_json::to_value(check).expect("a check is JSON");
    claim(check.name(), &written["args"])
}

/// Returns the name of a check as words: the last resort, for checks that no suite of the program has.
fn plain_name(name: &str) -> String {
    let words = name.rsplit('.').next().unwrap_or(name).replace('_', " ");
    sentence(&words)
}

fn of_materials(name: &str, args: Args<'_>) -> Option<String> {
    let wanted = || args.text("expected_material").map_or_else(|| "the material".to_owned(), material);
    let side = |side: &str| {
        let share = args.share("ratio_threshold");
        Some(format!("{share} blocks of the {side} wall at y = {} are {}", args.told("height_y"), wanted()))
    };
    match name {
        "material.is_all_material_equal_to" => Some(format!("All blocks are {}", wanted())),
        "material.are_blocks_known" => Some("Every block exists in Minecraft 1.21.4".to_owned()),
        "material.count_is_within" => {
            // No count is below 0, so a bound of 0 says nothing, unless there is no other.
            let least = args.number("min").filter(|min| *min > 0.0 || args.number("max").is_none());
            let none = (args.number("max") == Some(0.0)).then(|| "no".to_owned());
            Some(sentence(&args.blocks(&none.or_else(|| range(least, args.number("max")))?, "of")))
        }
        "material.is_block_cnt_equal_to" => Some(args.blocks(&args.told("expected_count"), "expected_material")),
        "material.is_block_cnt_geq" => {
            Some(args.blocks(&format!("At least {}", args.told("min_count")), "expected_material"))
        }
        "material.is_block_cnt_leq" => {
            Some(args.blocks(&format!("At most {}", args.told("max_count")), "expected_material"))
        }
        "material.is_block_cnt_larger_than" => {
            Some(args.blocks(&format!("More than {}", args.told("cnt")), "expected_material"))
        }
        "material.is_made_of" => {
            let at = format!("at y = {}", args.told("y"));
            let part = match args.text("part")? {
                "all" => "blocks".to_owned(),
                "room_corners" => format!("corners of the rooms {at}"),
                "room_walls" => format!("blocks of the rooms' walls {at}"),
                "room_roof" => "blocks of the rooms' roof".to_owned(),
                "under_rooms" => format!("cells {at} below the rooms"),
                other => format!("blocks of the {} {at}", other.replace('_', " ")),
            };
            let except = args.text("except").map(|tag| format!(", apart from {}", material(tag))).unwrap_or_default();
            Some(format!("{} {part} are {}{except}", args.share("min_share"), material(args.text("of")?)))
        }
        "material.is_corner_material_equal_to" => {
            let share = args.share("ratio_threshold");
            Some(format!("{share} corners at y = {} are {}", args.told("height_y"), wanted()))
        }
        "material.is_highest_block_material_equal_to" => {
            Some(format!("{} highest blocks are {}", args.share("ratio_threshold"), wanted()))
        }
        "material.is_max_x_material_equal_to" => side("east"),
        "material.is_min_x_material_equal_to" => side("west"),
        "material.is_max_z_material_equal_to" => side("south"),
        "material.is_min_z_material_equal_to" => side("north"),
        _ => None,
    }
}

fn of_sizes(name: &str, args: Args<'_>) -> Option<String> {
    let extents = |relation: &str| {
        let plan = args.0.get("xz").and_then(Value::as_array).map(|plan| {
            let sides: Vec<String> = plan.iter().filter_map(Value::as_f64).map(plain).collect();
            format!("{} in plan", sides.join(" × "))
        });
        let height = args.number("y").map(|y| format!("{} high", counted(y as i64, "block")));
        let parts: Vec<String> = plan.into_iter().chain(height).collect();
        (!parts.is_empty()).then(|| format!("{relation} {}", parts.join(" and ")))
    };
    match name {
        "size.is_equal" => extents("The build measures"),
        "size.is_leq" => extents("The build measures at most"),
        "size.all_dimensions_geq" => Some(format!("At least {} on every axis", blocks(args, "min_size"))),
        "size.max_y_is_geq" => Some(format!("The highest block is at y = {} or higher", args.told("min_y"))),
        "size.min_y_is_leq" => Some(format!("The lowest block is at y = {} or lower", args.told("max_y"))),
        "size.min_y_is_equal" => Some(format!("The lowest block is at y = {}", args.told("expected_y"))),
        _ => None,
    }
}

fn blocks(args: Args<'_>, name: &str) -> String {
    let number = args.number(name).unwrap_or_default();
    if number.fract() == 0.0 { counted(number as i64, "block") } else { format!("{} blocks", plain(number)) }
}

fn of_shapes(name: &str, args: Args<'_>) -> Option<String> {
    Some(match name {
        "shape.are_adjacent" => format!("{} touch each other", sentence(&args.list("materials", " and "))),
        "shape.are_doors_passable" => "Nothing blocks a door".to_owned(),
        "shape.doors_lead_through" => {
            let parting = args.number("min_parting").filter(|doors| *doors > 0.0);
            let parting = parting.map(|doors| {
                let part = if doors > 1.0 { "part" } else { "parts" };
                format!(", {} of which {part} a room from elsewhere", plain(doors))
            });
            let doors = counted(args.count("min_doors"), "door");
            format!("At least {doors}, each free on both sides{}", parting.unwrap_or_default())
        }
        "shape.climbs_to" => {
            let over = if args.is("onto_floor") { ", over the floor there" } else { "" };
            format!("One can climb to y = {} or higher{over}", args.told("min_y"))
        }
        "shape.is_reachable_by_stairs" => format!("Stairs lead up to y = {} or higher", args.told("min_floor_y")),
        "shape.has_ceilings" => {
            let levels = counted(args.count("min_levels"), "level");
            let top = args.number("min_top").map(|top| format!(", the highest at y = {} or higher", plain(top)));
            let cells = counted(args.count("min_cells"), "cell");
            format!("Ceilings over at least {cells} of floor lie at {levels} or more{}", top.unwrap_or_default())
        }
        "shape.has_clear_span" => format!(
            "A deck at least {} wide at y = {} or higher spans at least {} between its supports{}",
            // The argument is left out where it is 1.
            counted(args.0.get("min_width").and_then(Value::as_i64).unwrap_or(1), "block"),
            args.told("height"),
            blocks(args, "min_free"),
            if args.is("one_piece") { ", all one piece" } else { "" }
        ),
        "shape.has_enclosed_rooms" => {
            let count = range(args.number("min_rooms").filter(|min| *min > 0.0), args.number("max_rooms"))
                .unwrap_or_else(|| "any number of".to_owned());
            let rooms = if is_one(&count) { "room" } else { "rooms" };
            format!(
                "{} {rooms} with walls, a roof, a door and at least {} of floor{}",
                sentence(&count),
                counted(args.count("min_floor_cells"), "cell"),
                match args.number("max_step") {
                    None => "",
                    Some(0.0) => ", reached without a step",
                    Some(_) => ", reached from the ground",
                }
            )
        }
        "shape.has_rooms" => format!("At least {} at y = {}", counted(args.count("room_cnt"), "room"), args.told("y")),
        "shape.has_upper_floor" => {
            let ground = args.number("ground_cells").filter(|cells| *cells > 0.0);
            let ground = ground.map(|cells| format!(", and {} on the ground floor", plain(cells)));
            format!(
                "An upper floor of at least {} at y = {} or higher can be reached{}",
                counted(args.count("min_cells"), "cell"),
                args.told("min_y"),
                ground.unwrap_or_default()
            )
        }
        "shape.has_exit" => format!("An exit {} wide and {} high", blocks(args, "width"), blocks(args, "height")),
        "shape.has_wide_exit" => format!("An exit {} wide", blocks(args, "width")),
        "shape.walks_out" => format!(
            "{}, each with a path {} wide that leads outside",
            args.blocks(&format!("At least {}", args.told("min_starts")), "from"),
            blocks(args, "width")
        ),
        "shape.is_single_level" => "One can walk outside on one level".to_owned(),
        "shape.has_no_axis_symmetry" => "The build is not symmetric along an axis".to_owned(),
        "shape.is_bottom_surface_concave" => "The underside is concave".to_owned(),
        "shape.is_top_surface_concave" => "The upper surface is concave".to_owned(),
        "shape.is_true_arch" => {
            let rise = args.number("min_rise").filter(|rise| *rise > 0.0);
            let rise = rise.map(|rise| format!(" by at least {}", counted(rise as i64, "block")));
            let rise = rise.unwrap_or_default();
            format!("An arch rises{rise} between two supports at y = {}", args.told("support_y"))
        }
        "shape.is_vault" if args.number("min_footing").is_some() => {
            "A hollow vault falls to all sides from its middle, and its edge stands on the ground".to_owned()
        }
        "shape.is_vault" => "A vault falls to all sides from its middle".to_owned(),
        _ => return None,
    })
}

fn of_levels(name: &str, args: Args<'_>) -> Option<String> {
    let at = || format!("at y = {}", args.told("y"));
    Some(match name {
        "shape.level_has" => {
            let blocks = range(args.number("min_blocks").filter(|min| *min > 0.0), args.number("max_blocks"));
            let parts = range(args.number("min_parts").filter(|min| *min > 0.0), args.number("max_parts"));
            let blocks = blocks.map(|range| args.blocks(&range, "of"));
            let parts =
                parts.map(|range| format!("{range} separate {}", if is_one(&range) { "part" } else { "parts" }));
            let size = args.0.get("min_size").and_then(Value::as_array).map(|size| {
                let sides: Vec<String> = size.iter().filter_map(Value::as_f64).map(plain).collect();
                format!("one part of at least {}", sides.join(" × "))
            });
            let each = args.number("min_part_blocks").filter(|least| *least > 0.0);
            let each = each.map(|least| format!("each part of at least {}", counted(least as i64, "block")));
            let parts = parts.into_iter().chain(each).reduce(|parts, each| format!("{parts}, {each}"));
            let full = args.0.get("full_size").and_then(Value::as_array).map(|size| {
                let sides: Vec<String> = size.iter().filter_map(Value::as_f64).map(plain).collect();
                args.blocks(&format!("a full rectangle of {}", sides.join(" × ")), "of")
            });
            let all: Vec<String> = blocks.into_iter().chain(parts).chain(size).chain(full).collect();
            if all.is_empty() {
                return Some(format!("Anything {}", at()));
            }
            format!("{} {}", sentence(&all.join(", ")), at())
        }
        "shape.has_columns" => {
            let count = range(args.number("min_columns").filter(|min| *min > 0.0), args.number("max_columns"));
            let count = count.unwrap_or_else(|| "any number of".to_owned());
            let columns = if is_one(&count) { "column" } else { "columns" };
            let of = args.text("of").map(|of| format!(" of {}", material(of))).unwrap_or_default();
            let carry = if args.is("carry") { ", each under a block" } else { "" };
            let alone = if args.is("alone") { ", and nothing else" } else { "" };
            format!(
                "{} {columns}{of} from y = {} to y = {}{carry}{alone}",
                sentence(&count),
                args.told("from_y"),
                args.told("to_y")
            )
        }
        "shape.cluster_count_at_y_is" => {
            format!("{} {}", counted(args.count("expected_count"), "separate part"), at())
        }
        "shape.cluster_at_y_has_min_radius" => format!("A radius of {} or more {}", args.told("min_radius"), at()),
        "shape.cluster_at_y_has_min_diameter" => {
            format!("A diameter of {} or more {}", args.told("min_diameter"), at())
        }
        "shape.clusters_at_y_have_min_span" => {
            format!("The parts {} are {} or more apart", at(), blocks(args, "min_span"))
        }
        _ => return None,
    })
}

fn of_safety_and_planning(name: &str, args: Args<'_>) -> Option<String> {
    Some(match name {
        "physical_plausibility.is_ground_connected" => "No block floats".to_owned(),
        "structural_stability.stress_score" => {
            format!("No stress above {}", pascals(args.number("von_mises_stress")?))
        }
        "structural_stability.equilibrium_score" => {
            format!("No stress in equilibrium above {}", pascals(args.number("reference_pa")?))
        }
        "efficiency.l1_dist" => "The path from block to block is as short as possible".to_owned(),
        "dependency.layers_follow" => {
            let layers = sentence(&args.list("layers", ", then "));
            if layers.contains(", then ") {
                format!("{layers}: each complete before the next")
            } else {
                format!("A layer of {}", args.list("layers", ""))
            }
        }
        "dependency.material_sequence_order" => {
            let materials = sentence(&args.list("material_sequence", ", then "));
            match (materials.is_empty(), args.is("use_substring_match")) {
                (true, _) => "No order is asked for".to_owned(),
                (false, true) => format!("{materials}: placed in this order"),
                (false, false) => format!("{materials}: placed in exactly this order"),
            }
        }
        _ => return None,
    })
}

/// Writes a pressure in a unit that keeps it short.
pub(super) fn pascals(pascals: f64) -> String {
    match pascals {
        pa if pa >= 1e6 => format!("{} MPa", plain(pa / 1e6)),
        pa if pa >= 1e3 => format!("{} kPa", plain(pa / 1e3)),
        pa => format!("{} Pa", plain(pa)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_engine::hidden::GENERATOR_VERSION;
    use plumbline_engine::hidden::siblings::Siblings;
    use plumbline_engine::tasks::embedded;
    use serde_json::json;

    #[test]
    fn every_check_of_every_suite_has_words_of_its_own() {
        let (mut seen, mut tasks) = (0, Vec::new());
        for suite in embedded::suites().unwrap() {
            tasks.extend(suite.tasks);
        }
        tasks.extend(Siblings::of(GENERATOR_VERSION).unwrap().specifications().iter().map(|own| own.task.clone()));
        for task in &tasks {
            for check in task.checks() {
                let told = claim_of(check);
                assert_ne!(told, plain_name(check.name()), "{check:?}");
                let is_code = told.contains(['{', '}', '_', '?', '"', '#', '[']) || told.contains("null");
                let is_nothing = ["0 blocks wide", "spans 0", "of 0", "over 0"].iter().any(|none| told.contains(none));
                assert!(!is_code && !is_nothing && !told.contains("  "), "{check:?}: {told}");
                seen += 1;
            }
        }
        assert!(seen > 10_000, "{seen}");
    }

    #[test]
    fn claims_read_as_people_say_them() {
        for (name, args, told) in [
            (
                "material.is_made_of",
                json!({ "min_share": 1.0, "of": "stone", "part": "all", "y": 0 }),
                "All blocks are stone",
            ),
            (
                "material.is_made_of",
                json!({ "min_share": 0.5, "of": "stone", "part": "room_corners", "y": 1 }),
                "At least 50 % of the corners of the rooms at y = 1 are stone",
            ),
            ("material.count_is_within", json!({ "min": 49, "max": 49, "of": null }), "49 blocks"),
            ("material.count_is_within", json!({ "min": 3, "max": null, "of": "#beds" }), "At least 3 beds"),
            ("material.count_is_within", json!({ "min": 0, "max": 1, "of": "#oak" }), "At most 1 block of oak"),
            ("material.count_is_within", json!({ "min": 0, "max": 0, "of": "#doors" }), "No doors"),
            ("material.count_is_within", json!({ "min": 0, "max": null, "of": null }), "At least 0 blocks"),
            (
                "shape.level_has",
                json!({ "min_blocks": 0, "max_blocks": 1, "min_parts": 0, "max_parts": 1, "y": 2 }),
                "At most 1 block, at most 1 separate part at y = 2",
            ),
            (
                "shape.walks_out",
                json!({ "min_starts": 1, "from": "#beds", "width": 2 }),
                "At least 1 bed, each with a path 2 blocks wide that leads outside",
            ),
            ("size.is_equal", json!({ "xz": [7, 8], "y": 1 }), "The build measures 7 × 8 in plan and 1 block high"),
            (
                "shape.cluster_at_y_has_min_radius",
                json!({ "min_radius": 5.385_164_807_134_504, "y": 0 }),
                "A radius of 5.39 or more at y = 0",
            ),
            (
                "shape.level_has",
                json!({ "min_blocks": 49, "max_blocks": 49, "min_parts": 1, "max_parts": 1, "y": -1 }),
                "49 blocks, 1 separate part at y = -1",
            ),
            (
                "dependency.layers_follow",
                json!({ "layers": ["stone", "oak_planks"] }),
                "Stone, then oak planks: each complete before the next",
            ),
            ("structural_stability.stress_score", json!({ "von_mises_stress": 62_000_000 }), "No stress above 62 MPa"),
            (
                "shape.has_clear_span",
                json!({ "height": 2, "min_free": 5 }),
                "A deck at least 1 block wide at y = 2 or higher spans at least 5 blocks between its supports",
            ),
            (
                "structural_stability.equilibrium_score",
                json!({ "reference_pa": 12_500 }),
                "No stress in equilibrium above 12.5 kPa",
            ),
            ("dependency.layers_follow", json!({ "layers": ["stone"] }), "A layer of stone"),
            ("shape.level_has", json!({ "y": 3 }), "Anything at y = 3"),
            ("custom.is_nice_build", json!({}), "Is nice build"),
        ] {
            assert_eq!(claim(name, &args), told);
        }
    }
}

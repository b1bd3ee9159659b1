//! Planning: the way from block to block, and the order of materials.

use super::{Arguments, Build};

pub fn path(build: &Build<'_>) -> f64 {
    let steps = build.blocks.windows(2).map(|pair| (0..3).map(|i| pair[0].at[i].abs_diff(pair[1].at[i])).sum::<u64>());
    let length = steps.sum::<u64>() as f64;
    let count = build.blocks.len() as f64;
    if count <= 1.0 || length <= 0.0 { 1.0 } else { ((count - 1.0) / length).min(1.0) }
}

pub fn holds(rule: &str, arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    match rule {
        "material_sequence_order" => {
            let substring = arguments.flag("use_substring_match", true);
            let mut wanted: Vec<&str> =
                arguments.list("material_sequence").into_iter().filter_map(serde_json::Value::as_str).collect();
            if wanted.is_empty() {
                return Some(true);
            }
            for block in &build.blocks {
                let Some(current) = wanted.first() else { break };
                let is_met = if substring { block.name.contains(current) } else { block.name == *current };
                if is_met && !current.is_empty() && !block.name.is_empty() {
                    wanted.remove(0);
                }
            }
            Some(wanted.is_empty())
        }
        "layers_follow" => {
            if build.blocks.is_empty() {
                return Some(false);
            }
            let layers = arguments.list("layers").into_iter().cloned();
            let layers: Vec<plumbline_engine::voxel::blocks::BlockSet> =
                layers.map(serde_json::from_value).collect::<Result<_, _>>().ok()?;
            let places = |layer: usize| -> Vec<usize> {
                (0..build.blocks.len()).filter(|i| layers[layer].has(build.blocks[*i].name)).collect()
            };
            let is_full = |layer| places(layer).len() as f64 >= arguments.number("min_blocks").unwrap_or(1.0);
            let filled: Vec<Vec<usize>> = (0..layers.len()).map(places).filter(|places| !places.is_empty()).collect();
            let follows = filled.windows(2).all(|two| two[1].first() >= two[0].last());
            Some((0..layers.len()).all(is_full) && follows)
        }
        _ => None,
    }
}

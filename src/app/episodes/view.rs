//! What an agent sees of the world of an episode: a box of blocks, or a picture.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use super::body::Region;
use crate::actions::job::WorldState;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::pictures::isometric::{Corner, Scene, svg};
use crate::pictures::raster::png;
use plumbline_engine::game::world::natural;
use plumbline_engine::voxel::Cell;

/// The blocks of a box, ground included. Cells that are not listed are air.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct View {
    /// Least corner of the box.
    pub from: [i32; 3],
    /// Greatest corner of the box, which belongs to it.
    pub to: [i32; 3],
    /// Blocks with the states that were named.
    #[schema(example = json!(["grass_block", "oak_door[half=upper]"]))]
    pub palette: Vec<String>,
    /// `[x, y, z, i]` for each block, where i is an index of the palette; by y, x and z.
    pub rows: Vec<[i32; 4]>,
}

/// Returns the blocks of a box.
#[must_use]
pub fn seen(world: &WorldState, Region { from, to }: Region) -> View {
    let is_inside = |at: &[i32; 3]| (0..3).all(|axis| (from[axis]..=to[axis]).contains(&at[axis]));
    let built: HashMap<[i32; 3], &str> = world
        .blocks
        .iter()
        .filter(|(at, _)| is_inside(at))
        .map(|(at, block)| (*at, world.palette[*block as usize].as_str()))
        .collect();
    let mut ids: HashMap<String, i32> = HashMap::new();
    let mut view = View { from, to, palette: Vec::new(), rows: Vec::new() };
    for y in from[1]..=to[1] {
        for x in from[0]..=to[0] {
            for z in from[2]..=to[2] {
                let block = match built.get(&[x, y, z]) {
                    Some(block) => (*block).to_owned(),
                    None => natural(Cell { x, y, z }).to_string(),
                };
                if block == "air" {
                    continue;
                }
                let next = ids.len() as i32;
                let id = *ids.entry(block).or_insert_with_key(|block| {
                    view.palette.push(block.clone());
                    next
                });
                view.rows.push([x, y, z, id]);
            }
        }
    }
    view
}

/// Draws what was built, seen from above and from a corner, as PNG.
///
/// # Errors
/// Returns 500 if the picture cannot be written.
pub fn picture(world: &WorldState, corner: Corner) -> AppResult<Vec<u8>> {
    let blocks = world.standing().collect();
    let scene = Scene { blocks, dug: world.dug().collect(), most: LIMITS.picture_blocks, corner, has_ground: true };
    png(&svg(&scene), LIMITS.picture_pixels).map_err(|error| AppError::internal(&error))
}

//! The world of a job before and after its turns, and the events of a turn.

use std::collections::BTreeMap;

use super::host::Host;
use crate::actions::job::WorldState;
use crate::actions::{ActionLimits, RecordedEvent, Replayed};
use plumbline_engine::game::coordinates::Place;
use plumbline_engine::game::registry::StateId;
use plumbline_engine::game::world::Change;
use plumbline_engine::game::{Look, World};
use plumbline_engine::text::agreeing;
use plumbline_engine::voxel::Cell;
use plumbline_engine::voxel::replay::placed_and_gone;

/// Builds the world before the first turn.
pub fn world_of(start: Option<&WorldState>, limits: &ActionLimits) -> World {
    let mut world = World::with_limit(limits.events);
    let Some(start) = start else { return world };
    let look = |(state, named): (u16, u16)| StateId::numbered(state).map(|state| Look { state, named });
    for ([x, y, z], index) in &start.blocks {
        if let Some(look) = start.looks.get(*index as usize).copied().and_then(look) {
            world.put(Cell::new(*x, *y, *z), look);
        }
    }
    world.block_limit = start.block_limit;
    let [yaw, pitch] = start.view;
    world.body = Place { position: start.position, yaw, pitch, anchor: 0.0 };
    world.start_at(start.now_ms);
    world
}

/// Returns the world as it stands, with the body in it.
pub fn state_of(host: &Host) -> WorldState {
    let world = &host.world;
    let mut built: Vec<(Cell, Look)> = world.built().collect();
    built.sort_unstable_by_key(|(cell, _)| (cell.y, cell.x, cell.z));
    let mut names = Names::default();
    let blocks = built.into_iter().map(|(Cell { x, y, z }, look)| ([x, y, z], names.index(look))).collect();
    let Place { position, yaw, pitch, anchor: _ } = world.body;
    let mut looks = vec![(0, 0); names.palette.len()];
    for (look, index) in &names.index {
        looks[*index as usize] = *look;
    }
    WorldState {
        palette: names.palette,
        blocks,
        position,
        view: [yaw, pitch],
        now_ms: world.now_ms(),
        looks,
        block_limit: world.block_limit,
        held: host.held.clone(),
    }
}

/// Applies the events of a turn without code, which hold all that followed from them. Blocks that the game does not
/// have are left out.
pub fn apply(world: &mut World, events: &[([i32; 3], Option<String>)]) {
    for ([x, y, z], name) in events {
        let look = name.as_deref().map_or(Ok(Look::AIR), Look::read);
        if let Ok(look) = look {
            world.restore(Cell::new(*x, *y, *z), look);
        }
    }
}

/// A palette of blocks with their states.
#[derive(Default)]
struct Names {
    palette: Vec<String>,
    index: BTreeMap<(u16, u16), u32>,
}

impl Names {
    fn index(&mut self, look: Look) -> u32 {
        *self.index.entry((look.state.0, look.named)).or_insert_with(|| {
            self.palette.push(look.to_string());
            u32::try_from(self.palette.len() - 1).expect("fewer looks than the game has states")
        })
    }
}

/// Adds changes of the world to a turn as events.
pub fn record(changes: &[Change], replayed: &mut Replayed) {
    let mut names = Names::default();
    let event = |change: &Change| {
        let Cell { x, y, z } = change.cell;
        RecordedEvent { cell: [x, y, z], material: change.look.map(|look| names.index(look)) }
    };
    replayed.events = changes.iter().map(event).collect();
    replayed.palette = names.palette;
    replayed.has_states = true;
    replayed.notes.extend(difference(changes));
}

/// Tells when the two profiles make different builds of a turn: only under this one a removal reaches what the same
/// turn placed.
fn difference(changes: &[Change]) -> Option<String> {
    let gone = placed_and_gone(changes.iter().map(|change| (change.cell, change.look.is_some())));
    let removed = (gone > 0).then(|| agreeing(gone, "block was", "blocks were"))?;
    Some(format!(
        "{removed} removed in the turn that placed them: gone under mindcraft, while published removes only blocks of earlier turns"
    ))
}

//! Commands of the game, a line each, in one world.

use plumbline_engine::game::World;
use plumbline_engine::game::world::is_in_world;

/// Greatest number of changes of the world.
const MAX: usize = 20_000;
/// Greatest number of commands.
const COMMANDS: usize = 20;

pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let mut world = World::with_limit(MAX);
    for line in text.lines().take(COMMANDS) {
        let before = world.changes().len();
        if world.command(line).is_err() {
            assert_eq!(world.changes().len(), before, "{line} was refused");
        }
    }
    world.settle();
    assert!(world.changes().len() <= MAX);
    assert!(world.built().all(|(cell, _)| is_in_world(cell)));
}

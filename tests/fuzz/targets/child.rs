//! What a child process that runs action code answers: it may have been taken over by the code.

use plumbline::actions::job::{Answer, WorldState};

pub fn run(data: &[u8]) {
    let Ok(answer) = serde_json::from_slice::<Answer>(data) else { return };
    let Some(world) = answer.end.filter(WorldState::is_sound) else { return };
    let standing = world.standing().count();
    assert_eq!(standing + world.dug().count(), world.blocks.len());
    let again = serde_json::to_vec(&world).expect("a world is JSON");
    assert_eq!(serde_json::from_slice::<WorldState>(&again).expect("it reads back"), world);
}

//! Replay, against the rules written plainly: an ordered map from cells to blocks.

use arbitrary::Unstructured;
use plumbline_engine::voxel::replay::{Replay, events_between, placed_and_gone};
use plumbline_engine::voxel::{BlockLog, Cell, Profile, Structure, Turn};

const BLOCKS: [&str; 3] = ["stone", "dirt", "oak_planks"];
/// Greatest number of turns.
const TURNS: usize = 5;

/// Blocks in order.
type Blocks = Vec<(Cell, String)>;
/// A change: a cell, and what is placed there, if it is not removed.
type Change = (Cell, Option<&'static str>);

pub fn run(data: &[u8]) {
    let _ = compared(&mut Unstructured::new(data));
}

fn compared(bytes: &mut Unstructured<'_>) -> arbitrary::Result<()> {
    let profile = *bytes.choose(&[Profile::Published, Profile::Mindcraft])?;
    let mut turns = vec![Vec::new()];
    while !bytes.is_empty() {
        if turns.len() < TURNS && bytes.ratio(1, 8)? {
            turns.push(Vec::new());
        }
        let cell = Cell::new(bytes.int_in_range(0..=2)?, bytes.int_in_range(0..=1)?, bytes.int_in_range(0..=1)?);
        let block = if bytes.arbitrary()? { Some(*bytes.choose(&BLOCKS)?) } else { None };
        turns.last_mut().expect("there is a turn").push((cell, block));
    }
    let mut log = BlockLog { profile, ..BlockLog::default() };
    for changes in &turns {
        log.turns.push(Turn::new());
        for (cell, block) in changes {
            match block {
                Some(block) => log.place(*cell, block),
                None => log.remove(*cell),
            }
        }
    }
    let (mut plain, mut before, mut again) = (Blocks::new(), Structure::from_named([]), BlockLog::default());
    for (changes, structure) in turns.iter().zip(Replay::new(&log)) {
        match profile {
            Profile::Published => published(&mut plain, changes),
            Profile::Mindcraft => changes.iter().for_each(|change| change_in_order(&mut plain, *change)),
        }
        assert_eq!(named(&structure), plain);
        again.turns.push(events_between(&before, &structure, |name| again.palette.intern(name)));
        before = structure;
        let seen = changes.iter().map(|(cell, block)| (*cell, block.is_some()));
        assert_eq!(placed_and_gone(seen), gone(changes));
    }
    assert_eq!(Replay::new(&again).last().as_ref().map(named), Some(plain));
    Ok(())
}

/// Removes what earlier turns left, then places in order.
fn published(blocks: &mut Blocks, changes: &[Change]) {
    blocks.retain(|(cell, _)| !changes.contains(&(*cell, None)));
    changes.iter().filter(|(_, block)| block.is_some()).for_each(|change| change_in_order(blocks, *change));
}

fn change_in_order(blocks: &mut Blocks, (cell, block): Change) {
    let stands = blocks.iter().position(|(at, _)| *at == cell);
    match (stands, block) {
        (Some(at), Some(block)) => block.clone_into(&mut blocks[at].1),
        (None, Some(block)) => blocks.push((cell, block.to_owned())),
        (Some(at), None) => {
            blocks.remove(at);
        }
        (None, None) => {}
    }
}

/// Counts the cells that were placed in a turn and whose last change is a removal.
fn gone(changes: &[Change]) -> usize {
    let mut cells: Vec<Cell> = changes.iter().map(|(cell, _)| *cell).collect();
    cells.sort_unstable();
    cells.dedup();
    let of = |cell: &Cell| changes.iter().filter(|(at, _)| at == cell).collect::<Vec<_>>();
    let is_gone = |cell: &&Cell| {
        let own = of(cell);
        own.iter().any(|(_, block)| block.is_some()) && own.last().is_some_and(|(_, block)| block.is_none())
    };
    cells.iter().filter(is_gone).count()
}

fn named(structure: &Structure) -> Blocks {
    (0..structure.len()).map(|i| (structure.cells()[i], structure.material(i).to_owned())).collect()
}

//! Conversion of events to the structure after each turn (`docs/rules.md#replay`), and of structures back to events.

use std::sync::Arc;

use super::block_log::{BlockLog, Event, Turn};
use super::cell::{Cell, CellMap, CellSet};
use super::palette::{MaterialId, Palette};
use super::structure::Structure;

/// An iterator over the structures after each turn of a log. It holds one structure at a time.
#[derive(Debug)]
pub struct Replay<'a> {
    palette: Arc<Palette>,
    turns: std::slice::Iter<'a, Turn>,
    standing: Vec<(Cell, MaterialId)>,
}

impl<'a> Replay<'a> {
    /// Starts a replay before the first turn of `log`.
    #[must_use]
    pub fn new(log: &'a BlockLog) -> Self {
        Self { palette: Arc::new(log.palette.clone()), turns: log.turns.iter(), standing: Vec::new() }
    }
}

impl Iterator for Replay<'_> {
    type Item = Structure;

    fn next(&mut self) -> Option<Structure> {
        let turn = self.turns.next()?;
        apply(&mut self.standing, turn);
        Some(Structure::new(Arc::clone(&self.palette), self.standing.iter().copied()))
    }
}

/// Applies one turn to the standing entries.
///
/// Removals apply to the entries that earlier turns left, never to a cell placed in the same turn. A placement on a
/// standing cell changes its material and keeps its position in the order. A new cell is appended at the end.
fn apply(standing: &mut Vec<(Cell, MaterialId)>, turn: &[Event]) {
    let mut placed: Vec<(Cell, MaterialId)> = Vec::new();
    let mut position: CellMap<usize> = CellMap::default();
    let mut removed = CellSet::default();
    for event in turn {
        match *event {
            Event::Place { cell, material } => {
                let at = *position.entry(cell).or_insert_with(|| {
                    placed.push((cell, material));
                    placed.len() - 1
                });
                placed[at].1 = material;
            }
            Event::Remove { cell } => {
                removed.insert(cell);
            }
        }
    }
    standing.retain(|(cell, _)| !removed.contains(cell));
    for (cell, material) in standing.iter_mut() {
        if let Some(at) = position.remove(cell) {
            *material = placed[at].1;
        }
    }
    placed.retain(|(cell, _)| position.contains_key(cell));
    standing.append(&mut placed);
}

/// Computes the events that turn `before` into `after`, including the order of the entries, under the rules of `docs/rules.md#replay`.
///
/// Entries that already stand in the right order keep their positions, and are placed again only if their material
/// changes. All others are removed where they stood and placed in order. `material` maps a name to its id in the log.
#[must_use]
pub fn events_between(before: &Structure, after: &Structure, mut material: impl FnMut(&str) -> MaterialId) -> Turn {
    let mut events = Turn::new();
    for &cell in before.cells() {
        if !after.contains(cell) {
            events.push(Event::Remove { cell });
        }
    }
    let mut kept_up_to: Option<u32> = None;
    let mut order_kept = true;
    for (i, &cell) in after.cells().iter().enumerate() {
        let name = after.material(i);
        let stood_at = before.index().get(&cell).copied();
        order_kept = order_kept && stood_at.is_some() && (kept_up_to.is_none() || stood_at > kept_up_to);
        if order_kept {
            kept_up_to = stood_at;
        } else if stood_at.is_some() {
            events.push(Event::Remove { cell });
        }
        let unchanged = stood_at.is_some_and(|at| before.material(at as usize) == name);
        if !(order_kept && unchanged) {
            events.push(Event::Place { cell, material: material(name) });
        }
    }
    events
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn events() -> impl Strategy<Value = Turn> {
        let cell = (0..3i32, 0..2i32, 0..2i32).prop_map(|(x, y, z)| Cell::new(x, y, z));
        let event = (cell, 0..3u32, any::<bool>()).prop_map(|(cell, material, place)| {
            if place { Event::Place { cell, material } } else { Event::Remove { cell } }
        });
        prop::collection::vec(event, 0..12)
    }

    fn named(structure: &Structure) -> Vec<(Cell, String)> {
        (0..structure.len()).map(|i| (structure.cells()[i], structure.material(i).to_owned())).collect()
    }

    proptest! {
        #[test]
        fn events_between_structures_replay_to_the_same_structures(turns in prop::collection::vec(events(), 1..5)) {
            let mut log = BlockLog::default();
            for name in ["stone", "dirt", "oak_planks"] {
                log.palette.intern(name);
            }
            log.turns = turns;
            let wanted: Vec<Structure> = Replay::new(&log).collect();
            let mut again = BlockLog::default();
            let mut before = Structure::from_named([]);
            for structure in &wanted {
                let turn = events_between(&before, structure, |name| again.palette.intern(name));
                again.turns.push(turn);
                before = structure.clone();
            }
            let replayed: Vec<Structure> = Replay::new(&again).collect();
            for (a, b) in wanted.iter().zip(&replayed) {
                prop_assert_eq!(named(a), named(b));
            }
        }
    }
}

//! Conversion of events to the structure after each turn (`docs/rules.md#replay`), and of structures back to events.

use std::sync::Arc;

use super::block_log::{BlockLog, Event, Turn};
use super::cell::{Cell, CellMap, CellSet};
use super::palette::{MaterialId, Palette};
use super::profile::Profile;
use super::reading::Reading;
use super::structure::Structure;

/// An iterator over the structures after each turn of a log. It holds one structure at a time.
#[derive(Debug)]
pub struct Replay<'a> {
    palette: Arc<Palette>,
    turns: std::slice::Iter<'a, Turn>,
    profile: Profile,
    /// Whether a block that replaces one of another kind takes a new place in the order, as it does in the game.
    renews: bool,
    standing: Vec<(Cell, MaterialId)>,
}

impl<'a> Replay<'a> {
    /// Starts a replay before the first turn of `log`.
    #[must_use]
    pub fn new(log: &'a BlockLog) -> Self {
        Self {
            palette: Arc::new(log.palette.clone()),
            turns: log.turns.iter(),
            profile: log.profile,
            renews: false,
            standing: Vec::new(),
        }
    }

    /// Starts a replay whose structures are read as `reading` says. Read as the game has them, blocks of `mindcraft`
    /// logs that replace others take a new place in the order.
    pub fn read_as(log: &'a BlockLog, reading: Reading) -> impl Iterator<Item = Structure> + 'a {
        let profile = log.profile;
        let replay = Self { renews: !reading.is_as_listed(), ..Self::new(log) };
        replay.map(move |structure| reading.read(structure, profile))
    }
}

impl Iterator for Replay<'_> {
    type Item = Structure;

    fn next(&mut self) -> Option<Structure> {
        let turn = self.turns.next()?;
        match self.profile {
            Profile::Published => apply(&mut self.standing, turn),
            Profile::Mindcraft => apply_in_order(&mut self.standing, turn, self.renews),
        }
        Some(Structure::of_distinct(Arc::clone(&self.palette), self.standing.iter().copied()))
    }
}

/// Applies one turn to the standing entries.
///
/// Removals apply to the entries that earlier turns left, never to a cell placed in the same turn. A placement on a
/// standing cell changes its material and keeps its position in the order. A new cell is appended at the end.
fn apply(standing: &mut Vec<(Cell, MaterialId)>, turn: &[Event]) {
    let mut placed: Vec<(Cell, MaterialId)> = Vec::with_capacity(turn.len());
    let mut position: CellMap<usize> = CellMap::default();
    position.reserve(turn.len());
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
    if standing.is_empty() {
        *standing = placed;
        return;
    }
    for (cell, material) in standing.iter_mut() {
        if let Some(at) = position.remove(cell) {
            *material = placed[at].1;
        }
    }
    placed.retain(|(cell, _)| position.contains_key(cell));
    standing.append(&mut placed);
}

/// Applies one turn event by event: a removal also removes what the same turn placed.
///
/// As in [`apply`], a placement on a standing cell changes its material and keeps its position in the order, and a new
/// cell, or one that was removed before, is appended at the end. So is one whose material changes, if `renews` holds.
fn apply_in_order(standing: &mut Vec<(Cell, MaterialId)>, turn: &[Event], renews: bool) {
    let mut entries: Vec<Option<(Cell, MaterialId)>> = standing.drain(..).map(Some).collect();
    let mut position: CellMap<usize> =
        entries.iter().enumerate().filter_map(|(at, entry)| entry.map(|(cell, _)| (cell, at))).collect();
    for event in turn {
        match *event {
            Event::Place { cell, material } => {
                let stood = position.get(&cell).copied();
                let is_renewed = renews && stood.is_some_and(|at| entries[at].is_some_and(|(_, old)| old != material));
                if let Some(at) = stood.filter(|_| !is_renewed) {
                    entries[at] = Some((cell, material));
                } else {
                    if let Some(at) = stood {
                        entries[at] = None;
                    }
                    position.insert(cell, entries.len());
                    entries.push(Some((cell, material)));
                }
            }
            Event::Remove { cell } => {
                if let Some(at) = position.remove(&cell) {
                    entries[at] = None;
                }
            }
        }
    }
    standing.extend(entries.into_iter().flatten());
}

/// Counts the cells that a turn leaves empty although it placed a block there, from its changes in order: each a cell,
/// and whether a block was placed there or removed. Under [`Profile::Published`], where a removal reaches only blocks
/// of earlier turns, these blocks would stand.
pub fn placed_and_gone(changes: impl Iterator<Item = (Cell, bool)> + Clone) -> usize {
    // Most logs remove nothing.
    if changes.clone().all(|(_, is_placed)| is_placed) {
        return 0;
    }
    let (mut placed, mut gone) = (CellSet::default(), CellSet::default());
    for (cell, is_placed) in changes {
        if is_placed {
            placed.insert(cell);
            gone.remove(&cell);
        } else if placed.contains(&cell) {
            gone.insert(cell);
        }
    }
    gone.len()
}

/// Computes the events that turn `before` into `after`, including the order of the entries, under the rules of
/// `docs/rules.md#replay`.
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

    #[test]
    fn a_removal_in_the_turn_of_its_placement_counts_only_in_order() {
        let mut log = BlockLog::default();
        let [a, b] = [Cell::new(0, 0, 0), Cell::new(1, 0, 0)];
        for step in 0..2 {
            log.place(a, "stone");
            log.place(b, "dirt");
            if step == 0 {
                log.remove(a);
            }
        }
        let order = |log: &BlockLog| named(&Replay::new(log).last().unwrap());
        assert_eq!(order(&log), [(a, "stone".to_owned()), (b, "dirt".to_owned())]);
        log.profile = Profile::Mindcraft;
        assert_eq!(order(&log), [(b, "dirt".to_owned()), (a, "stone".to_owned())]);
        assert!(log.canonical_json().ends_with(br#""profile":"mindcraft"}"#));
        assert_eq!(BlockLog::from_canonical_json(&log.canonical_json()).unwrap().profile, Profile::Mindcraft);
        log.remove(a);
        log.remove(b);
        assert_eq!(order(&log), []);
    }

    #[test]
    fn a_block_that_replaces_another_takes_a_new_place_in_the_order_of_the_game() {
        let mut log = BlockLog { profile: Profile::Mindcraft, ..BlockLog::default() };
        let [a, b] = [Cell::new(0, 0, 0), Cell::new(1, 0, 0)];
        log.place(a, "glass");
        log.place(b, "stone");
        log.place(b, "stone");
        log.place(a, "dirt");
        let order = |structure: Structure| named(&structure).into_iter().map(|(cell, _)| cell).collect::<Vec<_>>();
        assert_eq!(order(Replay::read_as(&log, Reading::Game).last().unwrap()), [b, a]);
        assert_eq!(order(Replay::read_as(&log, Reading::AsListed).last().unwrap()), [a, b]);
        log.profile = Profile::Published;
        assert_eq!(order(Replay::read_as(&log, Reading::Game).last().unwrap()), [a, b]);
    }

    proptest! {
        #[test]
        fn no_cell_is_listed_twice(turns in prop::collection::vec(events(), 1..5)) {
            let mut log = BlockLog::default();
            for name in ["stone", "oak_door", "red_bed"] {
                log.palette.intern(name);
            }
            log.turns = turns;
            for profile in Profile::ALL {
                log.profile = profile;
                for reading in [Reading::AsListed, Reading::Game] {
                    for structure in Replay::read_as(&log, reading) {
                        prop_assert!(structure.is_distinct());
                        prop_assert_eq!(structure.len(), structure.index().len());
                    }
                }
            }
        }

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

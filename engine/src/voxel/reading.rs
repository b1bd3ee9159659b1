//! How the entries of a structure are read before checks see them: as listed, or as the blocks of the game that they
//! are.
//!
//! The published rules take every name as it is spelled and every entry as a block. In the game a door fills two cells
//! and so does a bed, and `minecraft:stone` is `stone`. Suites from version 3 on read structures so
//! (`docs/rules.md#reading`).

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::blocks::{canonical, is_bed, is_door};
use super::cell::{Cell, CellMap};
use super::palette::{MaterialId, Palette};
use super::profile::Profile;
use super::structure::Structure;

/// How the entries of a structure are read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// Names as they are spelled, and every entry a block.
    #[default]
    AsListed,
    /// Names without namespace and state; a door or a bed is one object in two cells.
    Game,
}

impl Reading {
    /// Returns whether this is [`Reading::AsListed`], which stored forms leave out.
    #[must_use]
    pub fn is_as_listed(&self) -> bool {
        *self == Self::AsListed
    }

    /// Reads a structure. The profile of its log tells whether beds are listed by halves.
    #[must_use]
    pub fn read(self, structure: Structure, profile: Profile) -> Structure {
        match self {
            Self::AsListed => structure,
            Self::Game => as_game(structure, profile),
        }
    }
}

/// Reads a structure as the game does.
///
/// A door block is the lower half of a door and fills the cell above as well, unless the log lists a door of the same
/// kind there: then that is its upper half. Under `mindcraft`, two bed blocks of the same kind side by side are the
/// halves of one bed.
fn as_game(structure: Structure, profile: Profile) -> Structure {
    let is_halved = |name: &str| is_door(name) || profile == Profile::Mindcraft && is_bed(name);
    let is_plain = |name: &str| canonical(name) == name && !is_halved(name);
    if structure.palette().names().all(is_plain) {
        return structure.with_second_halves(CellMap::default());
    }
    let mut palette = Palette::new();
    let ids: Vec<MaterialId> = structure.palette().names().map(|name| palette.intern(canonical(name))).collect();
    if !palette.names().any(is_halved) {
        return structure.renamed(Arc::new(palette), &ids).with_second_halves(CellMap::default());
    }
    let doors = palette.mask(is_door);
    let beds = palette.mask(|name| profile == Profile::Mindcraft && is_bed(name));
    let is_distinct = structure.is_distinct();
    let entries: Vec<(Cell, MaterialId)> = structure.entries().map(|(cell, id)| (cell, ids[id as usize])).collect();
    let at: CellMap<MaterialId> = entries.iter().copied().collect();
    let mut first_half: CellMap<Cell> = CellMap::default();
    // Of a column of equal doors every second one is an upper half, counted from the lowest.
    let mut columns: Vec<(i32, i32, MaterialId, i32)> =
        at.iter().filter(|(_, id)| doors[**id as usize]).map(|(cell, id)| (cell.x, cell.z, *id, cell.y)).collect();
    columns.sort_unstable();
    let mut below: Option<(i32, i32, MaterialId, i32)> = None;
    for door in columns {
        let (x, z, id, y) = door;
        if y > i32::MIN && below == Some((x, z, id, y - 1)) {
            first_half.insert(Cell::new(x, y, z), Cell::new(x, y - 1, z));
            below = None;
        } else {
            below = Some(door);
        }
    }
    let mut is_paired = super::cell::CellSet::default();
    // The game places one half right after the other; a bed whose halves were listed apart takes what is left beside
    // it.
    for is_next_wanted in [true, false] {
        for (i, &(cell, id)) in entries.iter().enumerate().filter(|(_, (_, id))| beds[*id as usize]) {
            let next = entries.get(i + 1).map(|(cell, _)| *cell);
            let is_free = |side: &Cell| at.get(side) == Some(&id) && !is_paired.contains(side);
            let other =
                cell.side_neighbours().into_iter().filter(is_free).find(|side| !is_next_wanted || next == Some(*side));
            if let Some(other) = other.filter(|_| !is_paired.contains(&cell)) {
                is_paired.extend([cell, other]);
                first_half.insert(other, cell);
            }
        }
    }
    let mut whole = Vec::with_capacity(entries.len());
    for (cell, id) in entries {
        whole.push((cell, id));
        let above = cell.offset(0, 1, 0);
        if doors[id as usize] && !first_half.contains_key(&cell) && !at.contains_key(&above) {
            whole.push((above, id));
            first_half.insert(above, cell);
        }
    }
    let palette = Arc::new(palette);
    // No upper half is added where a block stands.
    let structure = if is_distinct { Structure::of_distinct(palette, whole) } else { Structure::new(palette, whole) };
    structure.with_second_halves(first_half)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(profile: Profile, blocks: &[([i32; 3], &str)]) -> Structure {
        let cells = blocks.iter().map(|([x, y, z], name)| (Cell::new(*x, *y, *z), *name));
        Reading::Game.read(Structure::from_named(cells), profile)
    }

    fn objects(structure: &Structure) -> usize {
        structure.cells().iter().filter(|cell| structure.other_half(**cell).is_none()).count()
    }

    #[test]
    fn a_door_is_one_object_whether_one_half_is_listed_or_both() {
        for profile in Profile::ALL {
            let one = read(profile, &[([0, 0, 0], "oak_door")]);
            let both = read(profile, &[([0, 1, 0], "oak_door"), ([0, 0, 0], "minecraft:oak_door[half=lower]")]);
            for structure in [one, both] {
                assert_eq!((structure.len(), objects(&structure)), (2, 1), "{structure:?}");
                assert_eq!(structure.other_half(Cell::new(0, 1, 0)), Some(Cell::new(0, 0, 0)));
            }
        }
        let two =
            read(Profile::Published, &[([0, 0, 0], "oak_door"), ([0, 1, 0], "oak_door"), ([0, 2, 0], "oak_door")]);
        assert_eq!((two.len(), objects(&two)), (4, 2), "two doors upon each other");
        let shut = read(Profile::Published, &[([0, 0, 0], "oak_door"), ([0, 1, 0], "stone")]);
        assert_eq!(shut.len(), 2, "a block stands where the upper half would be");
    }

    #[test]
    fn the_halves_of_a_bed_are_listed_under_mindcraft_alone() {
        let blocks = [([0, 0, 0], "red_bed"), ([0, 0, -1], "red_bed"), ([1, 0, 0], "red_bed"), ([1, 0, -1], "red_bed")];
        assert_eq!(objects(&read(Profile::Mindcraft, &blocks)), 2);
        assert_eq!(objects(&read(Profile::Published, &blocks)), 4);
        assert_eq!(objects(&read(Profile::Mindcraft, &blocks[..1])), 1, "a bed of which one half is listed");
        // Foot beside foot, and the heads in opposite directions.
        let crossed = [([0, 0, 0], "red_bed"), ([0, 0, -1], "red_bed"), ([1, 0, 0], "red_bed"), ([1, 0, 1], "red_bed")];
        assert_eq!(objects(&read(Profile::Mindcraft, &crossed)), 2);
        let apart = [crossed[0], ([9, 0, 0], "stone"), crossed[1]];
        assert_eq!(objects(&read(Profile::Mindcraft, &apart)), 2, "halves that were listed apart, and a stone");
    }

    #[test]
    fn names_lose_namespace_and_state_and_order_stays() {
        let structure = read(
            Profile::Mindcraft,
            &[([0, 0, 0], "minecraft:stone"), ([1, 0, 0], "oak_log[axis=x]"), ([2, 0, 0], "stone")],
        );
        let names: Vec<&str> = (0..3).map(|i| structure.material(i)).collect();
        assert_eq!(names, ["stone", "oak_log", "stone"]);
    }
}

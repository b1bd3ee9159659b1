//! Houses: rooms in a row behind one front wall, each with its own door, under one roof.

use serde::Deserialize;

use super::materials;
use super::site::Site;
use crate::voxel::Cell;

/// Materials of a house, and the width of its doors.
pub(super) struct Fabric<'a> {
    pub(super) floor: Option<&'a str>,
    pub(super) pillars: &'a str,
    pub(super) walls: &'a str,
    pub(super) roof: &'a str,
    pub(super) door: &'a str,
    pub(super) bed: &'a str,
    pub(super) doors_wide: i32,
}

pub(super) const PLAIN: Fabric<'static> = Fabric {
    floor: None,
    pillars: "stone_bricks",
    walls: "stone_bricks",
    roof: "spruce_planks",
    door: "oak_door",
    bed: "white_bed",
    doors_wide: 1,
};

/// Materials of the two-story plans.
pub(super) const TWO_STORY: Fabric<'static> =
    Fabric { floor: Some("stone"), pillars: "white_concrete", walls: "oak_planks", roof: "red_wool", ..PLAIN };

/// Dimensions of a house, in blocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measures {
    /// Distance from one dividing wall to the next.
    pub(super) pitch: i32,
    /// z of the back wall; the front wall is at z = 0.
    pub(super) back: i32,
    /// Level of the roof over the ground floor; walls reach from y = 0 up to it.
    pub(super) height: i32,
}

impl Default for Measures {
    fn default() -> Self {
        Self { pitch: 5, back: 5, height: 3 }
    }
}

/// Features that a house is to have.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Wants {
    pub(super) rooms: i32,
    pub(super) beds: i32,
    pub(super) measures: Measures,
    /// Whether a second story of one room stands on the first, with its door at the head of the stairs.
    pub(super) has_upper_story: bool,
    /// Level that outer stairs lead to.
    pub(super) stairs_to_y: Option<i32>,
    /// Highest level of a chimney.
    pub(super) chimney_to_y: Option<i32>,
    /// Number of steps by which the roof rises, two blocks apart.
    pub(super) roof_steps: i32,
    /// Whether walls between rooms reach up to a roof that rises.
    pub(super) has_full_walls: bool,
}

/// Parameters of a house: its number of rooms.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Rooms {
    n: i32,
}

/// Builds a house with rooms.
pub fn rooms(site: &mut Site, rooms: &Rooms) {
    raise(site, Wants { rooms: rooms.n, ..Wants::default() }, &PLAIN);
}

/// Builds a house with rooms and a bed in each.
pub fn bedrooms(site: &mut Site, rooms: &Rooms) {
    raise(site, Wants { rooms: rooms.n, beds: rooms.n, ..Wants::default() }, &PLAIN);
}

/// Parameters of a revision: the number of rooms in the first and in the second turn.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Revision {
    first: i32,
    second: i32,
}

/// Builds one turn of a house that is enlarged or made smaller in the second turn.
pub fn revised(site: &mut Site, revision: &Revision, turn: usize) {
    let rooms = if turn == 1 { revision.first } else { revision.second };
    // The wall between two rooms becomes the outer wall.
    site.remove(|cell| cell.x > rooms * Measures::default().pitch);
    raise(site, Wants { rooms, ..Wants::default() }, &PLAIN);
}

/// Builds one turn of a house that gains a room in each turn.
pub fn grown(site: &mut Site, turn: usize) {
    raise(site, Wants { rooms: i32::try_from(turn).unwrap_or(1), ..Wants::default() }, &PLAIN);
}

/// Parameters of a basic building: the colour of its roof.
#[derive(Debug, Clone, Deserialize)]
pub struct Basic {
    colour: String,
}

/// Builds a house with stone pillars, dirt walls and a roof of coloured wool.
pub fn basic(site: &mut Site, basic: &Basic) {
    let roof = format!("{}_wool", basic.colour);
    raise(site, Wants::default(), &Fabric { pillars: "stone", walls: "dirt", roof: &roof, ..PLAIN });
}

/// Parameters of a house: its numbers of rooms, beds and stories.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct House {
    pub(super) rooms: i32,
    pub(super) beds: i32,
    #[serde(default)]
    pub(super) stories: i32,
}

impl House {
    fn wants(&self, chimney_to_y: Option<i32>) -> Wants {
        Wants {
            rooms: self.rooms,
            beds: self.beds,
            stairs_to_y: (self.stories == 2).then_some(4),
            chimney_to_y,
            ..Wants::default()
        }
    }
}

/// Builds a house on one level, with a floor and with doors two blocks wide.
pub fn accessible(site: &mut Site, house: &House) {
    raise(site, house.wants(None), &Fabric { floor: Some("smooth_stone"), doors_wide: 2, ..PLAIN });
}

/// Builds a house with a chimney in one corner, so that it is not its own mirror image.
pub fn asymmetric(site: &mut Site, house: &House) {
    raise(site, house.wants(Some(Measures::default().height + 1)), &PLAIN);
}

/// Builds a house with ceilings of three heights: its roof rises in two steps towards the back.
pub fn high(site: &mut Site, house: &House) {
    raise(site, Wants { roof_steps: 2, ..house.wants(None) }, &PLAIN);
}

/// Builds a house with a concrete foundation, stone pillars, dirt walls and a roof of planks.
pub fn one_story(site: &mut Site) {
    let fabric = Fabric { floor: Some("gray_concrete"), pillars: "stone", walls: "dirt", roof: "oak_planks", ..PLAIN };
    raise(site, Wants::default(), &fabric);
}

/// Builds a house with a stone foundation, concrete pillars, walls of planks, a red roof and outer stairs.
pub fn two_story(site: &mut Site) {
    raise(site, Wants { stairs_to_y: Some(3), ..Wants::default() }, &TWO_STORY);
}

pub(super) fn raise(site: &mut Site, wants: Wants, fabric: &Fabric<'_>) {
    let rooms = wants.rooms.max(1);
    let Measures { pitch, back, height } = wants.measures;
    let right = rooms * pitch;
    let is_opening = |cell: Cell| {
        let in_room = cell.x.rem_euclid(pitch);
        cell.z == 0 && cell.y <= 1 && (2..2 + fabric.doors_wide).contains(&in_room)
    };
    if let Some(floor) = fabric.floor {
        site.fill(&(0..=right), &(-1..=-1), &(0..=back), floor);
    }
    let pillar_top = if wants.has_upper_story { 2 * height } else { height - 1 };
    for (x, z) in [(0, 0), (right, 0), (right, back), (0, back)] {
        site.fill(&(x..=x), &(0..=pillar_top), &(z..=z), fabric.pillars);
    }
    site.ring(&(0..=right), &(0..=height - 1), &(0..=back), fabric.walls, &is_opening);
    for wall in 1..rooms {
        let x = wall * pitch;
        site.fill(&(x..=x), &(0..=height - 1), &(1..=back - 1), fabric.walls);
    }
    for room in 0..rooms {
        for door in 0..fabric.doors_wide {
            site.place(Cell::new(room * pitch + 2 + door, 0, 0), fabric.door);
        }
    }
    for bed in 0..wants.beds {
        let (room, row) = (bed % rooms, bed / rooms);
        site.place(Cell::new(room * pitch + 1, 0, back - 1 - 2 * row), fabric.bed);
    }
    if let Some(top) = wants.stairs_to_y {
        outer_stairs(site, back + 2, top, fabric.walls);
    }
    if wants.has_upper_story {
        upper_story(site, right, wants.measures, fabric);
        lay_roof(site, right, 2 * height + 1, wants, fabric);
    } else {
        lay_roof(site, right, height, wants, fabric);
    }
    for room in 0..rooms {
        site.place(Cell::new(room * pitch + 3, height - 1, 2), "lantern");
    }
    if let Some(top) = wants.chimney_to_y {
        site.fill(&(1..=1), &(height + 1..=top), &(1..=1), "bricks");
    }
}

/// Lays a roof over all rooms, the lowest part at `height`. Where it steps up, walls close the steps.
fn lay_roof(site: &mut Site, right: i32, height: i32, wants: Wants, fabric: &Fabric<'_>) {
    let (steps, Measures { back, pitch, .. }) = (wants.roof_steps, wants.measures);
    site.fill(&(0..=right), &(height..=height), &(0..=if steps == 0 { back } else { 1 }), fabric.roof);
    for step in 1..=steps {
        let (front, level) = (2 * step, height + step);
        let last = if step == steps { back } else { front + 1 };
        site.fill(&(0..=right), &(level - 1..=level - 1), &(front..=front), fabric.walls);
        for x in [0, right] {
            site.fill(&(x..=x), &(height..=level - 1), &(front..=last), fabric.walls);
        }
        if last == back {
            site.fill(&(0..=right), &(height..=level - 1), &(back..=back), fabric.walls);
        }
        if wants.has_full_walls {
            for x in (1..wants.rooms).map(|wall| wall * pitch) {
                site.fill(&(x..=x), &(height..=level - 1), &(front..=last), fabric.walls);
            }
        }
        site.fill(&(0..=right), &(level..=level), &(front..=last), fabric.roof);
    }
}

/// Builds straight stairs behind the house, each step on a block of its own.
fn outer_stairs(site: &mut Site, z: i32, top: i32, material: &str) {
    for y in 0..=top {
        if y > 0 {
            site.place(Cell::new(y, y - 1, z), material);
        }
        site.place(Cell::new(y, y, z), material);
    }
}

/// Builds the floor and the walls of a second story, and stairs behind the house to a landing in front of its door.
fn upper_story(site: &mut Site, right: i32, Measures { back, height, .. }: Measures, fabric: &Fabric<'_>) {
    site.fill(&(0..=right), &(height..=height), &(0..=back), fabric.walls);
    outer_stairs(site, back + 2, height, fabric.walls);
    site.place(Cell::new(height, height, back + 1), fabric.walls);
    let is_opening = |cell: Cell| cell.z == back && cell.x == height && cell.y <= height + 2;
    site.ring(&(0..=right), &(height + 1..=2 * height), &(0..=back), fabric.walls, &is_opening);
    site.place(Cell::new(height, height + 1, back), fabric.door);
}

/// Parameters of a cabin: its size along each axis, in blocks.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Cabin {
    pub(super) size: i32,
}

/// Builds a hollow cube whose six sides are one block thick: the largest cabin for the stock.
pub fn cabin(site: &mut Site, cabin: &Cabin) {
    let last = cabin.size - 1;
    let whole = 0..=last;
    site.fill(&whole, &(0..=0), &whole, "oak_planks");
    site.ring(&whole, &(1..=last - 1), &whole, "oak_planks", &|_| false);
    site.fill(&whole, &(last..=last), &whole, "oak_planks");
}

/// Parameters of a theatre: its number of seats, and the materials of seats, walls and doors.
#[derive(Debug, Clone, Deserialize)]
pub struct Theatre {
    seats: usize,
    #[serde(default = "materials::oak_stairs")]
    seat: String,
    #[serde(default = "materials::gray_concrete")]
    walls: String,
    #[serde(default = "materials::oak_door")]
    door: String,
}

/// Builds rows of seats beside an aisle, with double doors at both ends of it and lanterns beside the doors.
pub fn theatre(site: &mut Site, theatre: &Theatre) {
    const LAST: i32 = 12;
    const CEILING: i32 = 4;
    let is_opening = |cell: Cell| (cell.z == 0 || cell.z == LAST) && cell.y <= 1 && (6..=7).contains(&cell.x);
    site.fill(&(0..=LAST), &(-1..=-1), &(0..=LAST), "smooth_stone");
    for z in [0, LAST] {
        site.place(Cell::new(5, 0, z), "sea_lantern");
        site.place(Cell::new(8, 0, z), "sea_lantern");
    }
    site.ring(&(0..=LAST), &(0..=CEILING - 1), &(0..=LAST), &theatre.walls, &is_opening);
    for z in [0, LAST] {
        for x in [6, 7] {
            site.place(Cell::new(x, 0, z), &theatre.door);
        }
    }
    let seats = (2..LAST).step_by(2).flat_map(|z| [2, 3, 4, 5, 8, 9, 10, 11].map(|x| Cell::new(x, 0, z)));
    for seat in seats.take(theatre.seats) {
        site.place(seat, &theatre.seat);
    }
    site.fill(&(0..=LAST), &(CEILING..=CEILING), &(0..=LAST), &theatre.walls);
}

//! Houses of hidden suites. They are built like the public ones, but their dimensions, materials and stories are drawn.

use serde::Deserialize;

use super::houses::{Fabric, Measures, PLAIN, Wants, raise};
use super::materials;
use super::site::Site;
use crate::voxel::Cell;

/// Parameters of a drawn house.
#[derive(Debug, Clone, Deserialize)]
pub struct DrawnHouse {
    #[serde(default = "one")]
    rooms: i32,
    #[serde(default)]
    beds: i32,
    #[serde(default = "five")]
    pitch: i32,
    #[serde(default = "five")]
    depth: i32,
    #[serde(default = "three")]
    height: i32,
    #[serde(default = "one")]
    stories: i32,
    floor: Option<String>,
    #[serde(default = "materials::stone_bricks")]
    pillars: String,
    #[serde(default = "materials::stone_bricks")]
    walls: String,
    #[serde(default = "materials::spruce_planks")]
    roof: String,
    #[serde(default = "materials::oak_door")]
    door: String,
    #[serde(default = "one")]
    doors_wide: i32,
    /// Number of levels by which a chimney rises above the roof; 0 for no chimney.
    #[serde(default)]
    chimney: i32,
    /// Number of steps in which the roof rises towards the back.
    #[serde(default)]
    steps: i32,
}

const fn one() -> i32 {
    1
}

const fn three() -> i32 {
    3
}

const fn five() -> i32 {
    5
}

impl DrawnHouse {
    fn raise(&self, site: &mut Site, rooms: i32, has_full_walls: bool) {
        let measures = Measures { pitch: self.pitch, back: self.depth, height: self.height };
        let wants = Wants {
            rooms,
            beds: self.beds,
            measures,
            has_upper_story: self.stories == 2,
            chimney_to_y: (self.chimney > 0).then_some(self.height + self.chimney),
            roof_steps: self.steps,
            has_full_walls,
            ..Wants::default()
        };
        let fabric = Fabric {
            floor: self.floor.as_deref(),
            pillars: &self.pillars,
            walls: &self.walls,
            roof: &self.roof,
            door: &self.door,
            doors_wide: self.doors_wide,
            ..PLAIN
        };
        raise(site, wants, &fabric);
    }
}

/// Builds a house in one turn.
pub fn house(site: &mut Site, house: &DrawnHouse) {
    house.raise(site, house.rooms, false);
}

/// Builds a house in one turn, with walls between its rooms that reach up to its roof.
pub fn later_house(site: &mut Site, house: &DrawnHouse) {
    house.raise(site, house.rooms, true);
}

/// Parameters of a house that changes from turn to turn: its number of rooms in each turn, and the rest of it.
#[derive(Debug, Clone, Deserialize)]
pub struct Phases {
    phases: Vec<i32>,
    #[serde(flatten)]
    house: DrawnHouse,
}

/// Builds one turn of a house whose number of rooms changes. If it shrinks, an inner wall becomes the outer wall.
pub fn phased(site: &mut Site, phases: &Phases, turn: usize) {
    let rooms = phases.phases.get(turn - 1).copied().unwrap_or(1);
    site.remove(|cell| cell.x > rooms * phases.house.pitch);
    phases.house.raise(site, rooms, false);
}

/// Parameters of a cabin built from stock: its size along each axis, in blocks, its material and its door.
#[derive(Debug, Clone, Deserialize)]
pub struct StockCabin {
    size: i32,
    material: String,
    door: String,
}

impl StockCabin {
    pub(super) fn new(size: i32, material: &str, door: &str) -> Self {
        Self { size, material: material.to_owned(), door: door.to_owned() }
    }
}

/// Builds a hollow cube with a door, its floor flush with the ground: the largest cabin for the stock.
pub fn stock_cabin(site: &mut Site, cabin: &StockCabin) {
    let last = cabin.size - 1;
    let whole = 0..=last;
    let door = Cell::new(last / 2, 0, 0);
    let is_opening = |cell: Cell| cell == door || cell == door.offset(0, 1, 0);
    site.fill(&whole, &(-1..=-1), &whole, &cabin.material);
    site.ring(&whole, &(0..=last - 2), &whole, &cabin.material, &is_opening);
    site.fill(&whole, &(last - 1..=last - 1), &whole, &cabin.material);
    site.place(door, &cabin.door);
}

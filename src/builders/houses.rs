//! Houses: rooms in a row behind one front wall, each with its own door, under one roof.

use super::demands::Demands;
use super::site::Site;
use crate::voxel::Cell;

/// From one dividing wall to the next.
const ROOM_PITCH: i32 = 5;
/// The back wall's z; the front wall stands at z = 0.
const BACK: i32 = 5;
/// Level of the roof; walls reach up to it from y = 0.
const ROOF_Y: i32 = 3;

/// What a house is made of.
struct Fabric<'a> {
    floor: Option<&'a str>,
    pillars: &'a str,
    walls: &'a str,
    roof: &'a str,
    doors_wide: i32,
}

const PLAIN: Fabric<'static> =
    Fabric { floor: None, pillars: "stone_bricks", walls: "stone_bricks", roof: "spruce_planks", doors_wide: 1 };

/// Rooms, beds, stairs, a chimney and an odd corner, as demanded. Rooms that stand already are kept.
pub fn house(site: &mut Site, demands: &Demands) {
    raise(site, demands, &PLAIN);
}

/// Stone pillars, dirt walls, and a roof of a colour.
pub fn basic(site: &mut Site, demands: &Demands) {
    let roof = format!("{}_wool", demands.top_colour.as_deref().unwrap_or("red"));
    raise(site, demands, &Fabric { pillars: "stone", walls: "dirt", roof: &roof, ..PLAIN });
}

/// On one level with a floor, and with doors two wide.
pub fn accessible(site: &mut Site, demands: &Demands) {
    raise(site, demands, &Fabric { floor: Some("smooth_stone"), doors_wide: 2, ..PLAIN });
}

/// Each part of the material that its place in the sequence asks for: foundation, pillars, walls, roof.
pub fn planned(site: &mut Site, demands: &Demands) {
    let [floor, pillars, walls, roof] = [0, 1, 2, 3].map(|i| demands.material(i));
    raise(site, demands, &Fabric { floor: Some(floor), pillars, walls, roof, ..PLAIN });
}

fn raise(site: &mut Site, demands: &Demands, fabric: &Fabric<'_>) {
    let rooms = demands.rooms.max(1);
    let right = rooms * ROOM_PITCH;
    let is_opening = |cell: Cell| {
        let in_room = cell.x.rem_euclid(ROOM_PITCH);
        cell.z == 0 && cell.y <= 1 && (2..2 + fabric.doors_wide).contains(&in_room)
    };
    if let Some(floor) = fabric.floor {
        site.fill(&(0..=right), &(-1..=-1), &(0..=BACK), floor);
    }
    for (x, z) in [(0, 0), (right, 0), (right, BACK), (0, BACK)] {
        site.fill(&(x..=x), &(0..=ROOF_Y - 1), &(z..=z), fabric.pillars);
    }
    site.ring(&(0..=right), &(0..=ROOF_Y - 1), &(0..=BACK), fabric.walls, &is_opening);
    for wall in 1..rooms {
        let x = wall * ROOM_PITCH;
        site.fill(&(x..=x), &(0..=ROOF_Y - 1), &(1..=BACK - 1), fabric.walls);
    }
    for room in 0..rooms {
        for door in 0..fabric.doors_wide {
            site.place(Cell::new(room * ROOM_PITCH + 2 + door, 0, 0), "oak_door");
        }
    }
    for bed in 0..demands.beds {
        let (room, row) = (bed % rooms, bed / rooms);
        site.place(Cell::new(room * ROOM_PITCH + 1, 0, BACK - 1 - 2 * row), "white_bed");
    }
    if let Some(top) = demands.stairs_to_y {
        outer_stairs(site, top, fabric.walls);
    }
    site.fill(&(0..=right), &(ROOF_Y..=ROOF_Y), &(0..=BACK), fabric.roof);
    if demands.asymmetric || demands.highest_y.is_some() {
        let top = demands.highest_y.unwrap_or(ROOF_Y + 1);
        site.fill(&(1..=1), &(ROOF_Y + 1..=top), &(1..=1), "bricks");
    }
}

/// Straight stairs behind the house, each step on a block.
fn outer_stairs(site: &mut Site, top: i32, material: &str) {
    for y in 0..=top {
        if y > 0 {
            site.place(Cell::new(y, y - 1, BACK + 2), material);
        }
        site.place(Cell::new(y, y, BACK + 2), material);
    }
}

/// The largest hollow cube: all six sides, one block thick.
pub fn cabin(site: &mut Site, demands: &Demands) {
    let last = demands.extent.unwrap_or(4) - 1;
    let whole = 0..=last;
    site.fill(&whole, &(0..=0), &whole, "oak_planks");
    site.ring(&whole, &(1..=last - 1), &whole, "oak_planks", &|_| false);
    site.fill(&whole, &(last..=last), &whole, "oak_planks");
}

/// Seats in rows beside an aisle, double doors at both ends of it, lanterns beside the doors.
pub fn theatre(site: &mut Site, demands: &Demands) {
    const LAST: i32 = 12;
    const CEILING: i32 = 4;
    let is_opening = |cell: Cell| (cell.z == 0 || cell.z == LAST) && cell.y <= 1 && (6..=7).contains(&cell.x);
    site.fill(&(0..=LAST), &(-1..=-1), &(0..=LAST), "smooth_stone");
    for z in [0, LAST] {
        site.place(Cell::new(5, 0, z), "sea_lantern");
        site.place(Cell::new(8, 0, z), "sea_lantern");
    }
    site.ring(&(0..=LAST), &(0..=CEILING - 1), &(0..=LAST), "gray_concrete", &is_opening);
    for z in [0, LAST] {
        for x in [6, 7] {
            site.place(Cell::new(x, 0, z), "oak_door");
        }
    }
    let seats = (2..LAST).step_by(2).flat_map(|z| [2, 3, 4, 5, 8, 9, 10, 11].map(|x| Cell::new(x, 0, z)));
    for seat in seats.take(demands.seats.max(0) as usize) {
        site.place(seat, "oak_stairs");
    }
    site.fill(&(0..=LAST), &(CEILING..=CEILING), &(0..=LAST), "gray_concrete");
}

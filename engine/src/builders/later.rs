//! Good builds of families whose tasks ask for more from version 3 of the suite on: real upper stories, ceilings of
//! three heights over rooms, cabins with a door, domes of exact width and height.

use serde::Deserialize;

use super::drawn::{StockCabin, stock_cabin};
use super::houses::{Cabin, House, Measures, PLAIN, TWO_STORY, Wants, raise};
use super::site::Site;
use crate::voxel::Cell;

impl House {
    fn later_wants(&self) -> Wants {
        Wants {
            rooms: self.rooms,
            beds: self.beds,
            has_upper_story: self.stories == 2,
            has_full_walls: true,
            ..Wants::default()
        }
    }
}

/// Builds a house with a chimney in one corner, so that it is not its own mirror image.
pub fn asymmetric(site: &mut Site, house: &House) {
    let wants = house.later_wants();
    let height = Measures::default().height;
    let roof = if wants.has_upper_story { 2 * height + 1 } else { height };
    raise(site, Wants { chimney_to_y: Some(roof + 1), ..wants }, &PLAIN);
}

/// Builds a house with ceilings of three heights: its roof rises in two steps towards the back.
pub fn high(site: &mut Site, house: &House) {
    let measures = Measures { back: 7, ..Measures::default() };
    raise(site, Wants { roof_steps: 2, measures, ..house.later_wants() }, &PLAIN);
}

/// Builds a house with a stone foundation, concrete pillars, walls of planks, a red roof, and a second story.
pub fn two_story(site: &mut Site) {
    raise(site, Wants { has_upper_story: true, ..Wants::default() }, &TWO_STORY);
}

/// Builds a hollow cube with a door, its floor flush with the ground.
pub fn cabin(site: &mut Site, cabin: &Cabin) {
    stock_cabin(site, &StockCabin::new(cabin.size, "oak_planks", "oak_door"));
}

/// Parameters of a dome: its width and height, in blocks, and its material.
#[derive(Debug, Clone, Deserialize)]
pub struct Dome {
    d: i32,
    h: i32,
    material: Option<String>,
}

impl Dome {
    /// Returns the same dome, of snow.
    #[must_use]
    pub fn of_snow(&self) -> Self {
        Self { material: Some("snow_block".to_owned()), ..self.clone() }
    }
}

/// Builds a closed shell over a circle, whose height falls from the middle like a parabola; of white concrete unless
/// the parameters name another material.
pub fn dome(site: &mut Site, dome: &Dome) {
    let Dome { d, h, ref material } = *dome;
    let material = material.as_deref().unwrap_or("white_concrete");
    // In units of half a block, so that the middle of an even width is a whole number.
    let square = |at: i32| (2 * at - (d - 1)).pow(2);
    let top = |x: i32, z: i32| {
        let distance = f64::from(square(x) + square(z)) / f64::from(d * d);
        (distance < 1.0).then(|| (f64::from(h) * (1.0 - distance)).round() as i32)
    };
    for y in 0..=h {
        for x in 0..d {
            for z in 0..d {
                let Some(own) = top(x, z) else { continue };
                let sides = [(x - 1, z), (x + 1, z), (x, z - 1), (x, z + 1)];
                let lowest = sides.iter().map(|(x, z)| top(*x, *z).unwrap_or(0)).min().unwrap_or(0);
                if (lowest.min(own)..=own).contains(&y) {
                    site.place(Cell::new(x, y, z), material);
                }
            }
        }
    }
}

//! Civil engineering: bridges, arches and domes.

use serde::Deserialize;

use super::materials;
use super::site::Site;
use crate::voxel::Cell;

/// Parameters of a bridge, in blocks: span between the supports, clearance for boats, width, and the rise of an arch.
#[derive(Debug, Clone, Deserialize)]
pub struct River {
    w: i32,
    boat: i32,
    #[serde(default = "three")]
    width: i32,
    #[serde(default = "two")]
    crown: i32,
    #[serde(default = "materials::stone_bricks")]
    material: String,
}

impl River {
    /// Returns the river with as many free cells between its supports as it is wide.
    #[must_use]
    pub fn with_free_cells(&self) -> Self {
        Self { w: self.w + 1, ..self.clone() }
    }
}

const fn three() -> i32 {
    3
}

const fn two() -> i32 {
    2
}

/// Builds a flat deck between two piers, with posts at its ends.
pub fn bridge(site: &mut Site, river: &River) {
    let (span, clear, across) = (river.w, river.boat, 0..=river.width - 1);
    for x in [0, span] {
        site.fill(&(x..=x), &(0..=clear - 1), &across, &river.material);
    }
    site.fill(&(0..=span), &(clear..=clear), &across, &river.material);
    let top = clear + 1;
    for x in [0, span] {
        for z in [0, river.width - 1] {
            site.fill(&(x..=x), &(clear + 1..=top), &(z..=z), &river.material);
        }
    }
}

/// Builds an arch between two piers. Both surfaces rise from the supports and level out over the river.
pub fn arch_bridge(site: &mut Site, river: &River) {
    let (span, clear, across) = (river.w, river.boat, 0..=river.width - 1);
    for x in [0, span] {
        site.fill(&(x..=x), &(0..=clear - 1), &across, &river.material);
    }
    let rise = |x: i32| x.min(span - x).min(river.crown);
    for x in 0..=span {
        // Reaches down to the level of the neighbour nearer to the support, so that faces touch.
        let below = rise(x - 1).min(rise(x + 1)).max(0).min(rise(x));
        site.fill(&(x..=x), &(clear + below..=clear + rise(x)), &across, &river.material);
    }
}

/// Parameters of a gateway: width and height of its opening and thickness, in blocks; materials of pillars and lintel.
#[derive(Debug, Clone, Deserialize)]
pub struct Gateway {
    free: i32,
    clear: i32,
    thickness: i32,
    pillar: String,
    lintel: String,
}

/// Builds two pillars with a lintel over them.
pub fn gateway(site: &mut Site, gateway: &Gateway) {
    let Gateway { free, clear, thickness, ref pillar, ref lintel } = *gateway;
    let through = 0..=thickness - 1;
    for x in [0, free + 1] {
        site.fill(&(x..=x), &(0..=clear - 1), &through, pillar);
    }
    site.fill(&(0..=free + 1), &(clear..=clear), &through, lintel);
}

/// Parameters of an arch under stress, in blocks: width, length of the legs, height of the crown (3 or 4).
#[derive(Debug, Clone, Deserialize)]
pub struct StressedArch {
    width: i32,
    leg: i32,
    height: i32,
    #[serde(default = "materials::stone")]
    material: String,
}

/// Builds an arch like the reference arches of `docs/rules.md#stress`: leaning legs that meet under a crown, over a
/// span of five.
pub fn arch_under_stress(site: &mut Site, arch: &StressedArch) {
    let StressedArch { width, leg, height, ref material } = *arch;
    let across = 0..=width - 1;
    for y in 0..height {
        let from = y - 2 - leg;
        site.fill(&(from..=from + leg - 1), &(y..=y), &across, material);
        site.fill(&(1 - from - leg..=-from), &(y..=y), &across, material);
    }
    site.fill(&(-1..=1), &(height..=height), &across, material);
}

/// Parameters of a dome: its diameter, in blocks, and its material.
#[derive(Debug, Clone, Deserialize)]
pub struct Dome {
    d: i32,
    material: Option<String>,
}

/// Builds a dome, of white concrete unless the parameters name another material.
pub fn dome(site: &mut Site, dome: &Dome) {
    shell(site, dome.d, dome.material.as_deref().unwrap_or("white_concrete"));
}

/// Builds a dome of snow.
pub fn igloo(site: &mut Site, dome: &Dome) {
    shell(site, dome.d, "snow_block");
}

/// Builds a hollow dome that is level at the crown, gets steeper towards the ground, and is closed ring by ring.
fn shell(site: &mut Site, diameter: i32, material: &str) {
    let radius = (diameter + 1) / 2;
    let slope = |ring: i32| if 3 * ring <= radius { 0 } else { 1 + i32::from(3 * ring > 2 * radius) };
    let height = |ring: i32| (ring + 1..=radius).map(slope).sum::<i32>();
    let ring_of = |x: i32, z: i32| f64::from(x * x + z * z).sqrt().round() as i32;
    for y in 0..=height(0) {
        for x in -radius..=radius {
            for z in -radius..=radius {
                let ring = ring_of(x, z);
                if ring <= radius && (height((ring + 1).min(radius))..=height(ring)).contains(&y) {
                    site.place(Cell::new(x, y, z), material);
                }
            }
        }
    }
}

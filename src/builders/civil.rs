//! Civil engineering: bridges, arches and domes.

use super::demands::Demands;
use super::site::Site;
use crate::voxel::Cell;

const STONE: &str = "stone_bricks";
/// Bridges are three wide.
const WIDTH: std::ops::RangeInclusive<i32> = 0..=2;

/// Clear height of the river, in blocks: one more than the highest level that must show two piers.
fn clearance(demands: &Demands) -> i32 {
    demands.clusters.iter().map(|(y, _)| y + 1).max().unwrap_or(3)
}

/// A flat deck between two piers, with posts at its ends.
pub fn bridge(site: &mut Site, demands: &Demands) {
    let (span, clear) = (demands.span.unwrap_or(10), clearance(demands));
    for x in [0, span] {
        site.fill(&(x..=x), &(0..=clear - 1), &WIDTH, STONE);
    }
    site.fill(&(0..=span), &(clear..=clear), &WIDTH, STONE);
    let top = demands.highest_y.unwrap_or(clear).max(clear);
    for x in [0, span] {
        for z in [0, 2] {
            site.fill(&(x..=x), &(clear + 1..=top), &(z..=z), STONE);
        }
    }
}

/// An arch between two piers: both surfaces rise from the supports and level out over the river.
pub fn arch_bridge(site: &mut Site, demands: &Demands) {
    let (span, clear) = (demands.span.unwrap_or(10), clearance(demands));
    for x in [0, span] {
        site.fill(&(x..=x), &(0..=clear - 1), &WIDTH, STONE);
    }
    let crown = (demands.highest_y.unwrap_or(clear + 1) - clear).max(2);
    let rise = |x: i32| x.min(span - x).min(crown);
    for x in 0..=span {
        // Down to the level of the neighbour nearer to the support, so that faces touch.
        let below = rise(x - 1).min(rise(x + 1)).max(0).min(rise(x));
        site.fill(&(x..=x), &(clear + below..=clear + rise(x)), &WIDTH, STONE);
    }
}

/// The reference arches of SPEC 4: leaning legs that meet under a crown, over a span of five.
pub fn arch_under_stress(site: &mut Site, demands: &Demands) {
    let (width, leg, height) = match demands.reference_pa {
        Some(pa) if pa < 4_000.0 => (2, 2, 3),
        Some(pa) if pa < 5_000.0 => (2, 3, 4),
        _ => (3, 3, 4),
    };
    let across = 0..=width - 1;
    for y in 0..height {
        let from = y - 2 - leg;
        site.fill(&(from..=from + leg - 1), &(y..=y), &across, "stone");
        site.fill(&(1 - from - leg..=-from), &(y..=y), &across, "stone");
    }
    site.fill(&(-1..=1), &(height..=height), &across, "stone");
}

/// A dome of concrete.
pub fn dome(site: &mut Site, demands: &Demands) {
    shell(site, demands, "white_concrete");
}

/// A dome of snow.
pub fn igloo(site: &mut Site, demands: &Demands) {
    shell(site, demands, "snow_block");
}

/// A hollow dome: level at the crown, ever steeper towards the ground, closed ring by ring.
fn shell(site: &mut Site, demands: &Demands, material: &str) {
    let radius = (demands.diameter.unwrap_or(5) + 1) / 2;
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

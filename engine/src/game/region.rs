//! `/fill` and `/clone`: commands on boxes of blocks.

use super::command::{CloneFilter, CloneMode, FillMode};
use super::refusal::Refusal;
use super::registry::Look;
use super::shapes::order_of_copy;
use super::world::World;
use crate::voxel::cell::Cell;

/// A box of cells, with both of its corners in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    min: Cell,
    max: Cell,
}

impl Region {
    /// Returns the box between two opposite corners.
    pub fn between(a: Cell, b: Cell) -> Self {
        Self {
            min: Cell::new(a.x.min(b.x), a.y.min(b.y), a.z.min(b.z)),
            max: Cell::new(a.x.max(b.x), a.y.max(b.y), a.z.max(b.z)),
        }
    }

    fn extent(&self) -> [i64; 3] {
        [self.max.x - self.min.x, self.max.y - self.min.y, self.max.z - self.min.z].map(|length| i64::from(length) + 1)
    }

    /// Returns the number of cells, or refuses if there are more than the limit.
    fn volume(&self, limit: i64) -> Result<usize, Refusal> {
        let [x, y, z] = self.extent();
        let volume = x.saturating_mul(y).saturating_mul(z);
        if volume > limit {
            return Err(Refusal::new(format!("too many blocks in the area: at most {limit}, not {volume}")));
        }
        Ok(usize::try_from(volume).expect("a volume within the limit"))
    }

    /// Returns the cells in the order of the server: x changes fastest, then y, then z.
    fn cells(self) -> impl Iterator<Item = Cell> {
        let Self { min, max } = self;
        (min.z..=max.z)
            .flat_map(move |z| (min.y..=max.y).flat_map(move |y| (min.x..=max.x).map(move |x| Cell::new(x, y, z))))
    }

    fn is_on_surface(&self, cell: Cell) -> bool {
        let Self { min, max } = *self;
        cell.x == min.x || cell.x == max.x || cell.y == min.y || cell.y == max.y || cell.z == min.z || cell.z == max.z
    }

    fn overlaps(&self, other: &Self) -> bool {
        let along = |min: i32, max: i32, other_min: i32, other_max: i32| min <= other_max && other_min <= max;
        along(self.min.x, self.max.x, other.min.x, other.max.x)
            && along(self.min.y, self.max.y, other.min.y, other.max.y)
            && along(self.min.z, self.max.z, other.min.z, other.max.z)
    }

    fn moved_to(&self, min: Cell) -> Self {
        let offset = [min.x - self.min.x, min.y - self.min.y, min.z - self.min.z];
        Self { min, max: self.max.offset(offset[0], offset[1], offset[2]) }
    }
}

/// Fills a box. Returns the number of blocks that changed.
pub fn fill(world: &mut World, region: &Region, look: Look, mode: &FillMode) -> Result<usize, Refusal> {
    region.volume(world.volume_limit())?;
    let mut changed = 0;
    for cell in region.cells() {
        let wanted = match mode {
            FillMode::Keep if !world.state(cell).is_air() => continue,
            FillMode::Replace(Some(filter)) if !filter.accepts(world.state(cell)) => continue,
            FillMode::Outline if !region.is_on_surface(cell) => continue,
            FillMode::Hollow if !region.is_on_surface(cell) => Look::AIR,
            FillMode::Destroy => {
                world.set(cell, Look::AIR);
                look
            }
            FillMode::Keep | FillMode::Replace(_) | FillMode::Outline | FillMode::Hollow => look,
        };
        changed += usize::from(world.place(cell, wanted));
    }
    if changed == 0 { Err(Refusal::new("no blocks were filled")) } else { Ok(changed) }
}

/// Copies a box to another place. Returns the number of blocks that were copied, those included that stood there
/// already.
pub fn clone(
    world: &mut World,
    from: &Region,
    to: Cell,
    which: &CloneFilter,
    mode: CloneMode,
) -> Result<usize, Refusal> {
    let copy = from.moved_to(to);
    if mode == CloneMode::Normal && from.overlaps(&copy) {
        return Err(Refusal::new("the source and destination areas cannot overlap"));
    }
    from.volume(world.volume_limit())?;
    let is_copied = |look: Look| match which {
        CloneFilter::All => true,
        CloneFilter::Masked => !look.state.is_air(),
        CloneFilter::Filtered(filter) => filter.accepts(look.state),
    };
    let mut originals: Vec<(Cell, Look)> =
        from.cells().map(|cell| (cell, world.look(cell))).filter(|(_, look)| is_copied(*look)).collect();
    if mode == CloneMode::Move {
        for (cell, _) in &originals {
            world.set(*cell, Look::AIR);
        }
    }
    // The server sets full cubes first, so that what hangs on them finds them, and before the rest blocks with data of their
    // own.
    originals.sort_by_key(|(_, look)| order_of_copy(*look));
    let count = originals.len();
    for (cell, look) in originals {
        let target = cell.offset(to.x - from.min.x, to.y - from.min.y, to.z - from.min.z);
        world.set(target, look);
    }
    if count == 0 { Err(Refusal::new("no blocks were cloned")) } else { Ok(count) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world(commands: &[&str]) -> World {
        let mut world = World::default();
        for command in commands {
            world.command(command).unwrap_or_else(|refusal| panic!("{command}: {refusal}"));
        }
        world
    }

    fn count(world: &World, name: &str) -> usize {
        world.built().filter(|(_, look)| look.to_string() == name).count()
    }

    #[test]
    fn fill_has_five_modes() {
        let world_ = world(&["fill 0 0 0 4 4 4 stone"]);
        assert_eq!(count(&world_, "stone"), 125);
        assert_eq!(world_.changes()[1].cell, Cell::new(1, 0, 0));
        assert_eq!(world_.changes()[5].cell, Cell::new(0, 1, 0));
        let world_ = world(&["fill 4 4 4 0 0 0 stone", "fill 0 0 0 4 4 4 glass hollow"]);
        assert_eq!((count(&world_, "stone"), count(&world_, "glass")), (0, 98));
        let world_ = world(&["setblock 2 2 2 dirt", "fill 0 0 0 4 4 4 glass outline"]);
        assert_eq!((count(&world_, "dirt"), count(&world_, "glass")), (1, 98));
        let world_ = world(&["setblock 0 0 0 dirt", "fill 0 0 0 1 0 0 glass keep"]);
        assert_eq!((count(&world_, "dirt"), count(&world_, "glass")), (1, 1));
        let world_ = world(&["fill 0 0 0 2 0 0 oak_log", "setblock 1 0 0 dirt", "fill 0 0 0 2 0 0 air replace #logs"]);
        assert_eq!((count(&world_, "dirt"), count(&world_, "oak_log")), (1, 0));
        let world_ = world(&["setblock 0 0 0 dirt", "fill 0 0 0 0 0 0 stone destroy"]);
        assert_eq!(world_.changes().len(), 3);
    }

    #[test]
    fn too_large_a_box_is_refused_at_once() {
        let mut world = World::default();
        let refusal = world.command("fill 0 0 0 99 99 99 stone").unwrap_err().to_string();
        assert_eq!(refusal, "too many blocks in the area: at most 32768, not 1000000");
        assert!(world.command("fill -30000000 -64 -30000000 29999999 319 29999999 stone").is_err());
        assert!(world.command("fill 0 0 0 0 0 0 air").is_err());
        world.command("gamerule commandModificationBlockLimit 2000000000").unwrap();
        assert!(world.command("fill 0 0 0 999 99 99 stone").is_err());
    }

    #[test]
    fn clone_copies_moves_and_refuses_to_overlap() {
        let build = ["fill 0 0 0 1 0 0 stone", "setblock 0 1 0 torch"];
        let mut world_ = world(&build);
        world_.command("clone 0 0 0 1 1 0 5 0 0").unwrap();
        assert_eq!(world_.look(Cell::new(5, 1, 0)).to_string(), "torch");
        assert_eq!(count(&world_, "stone"), 4);
        assert!(world_.command("clone 0 0 0 1 1 0 1 0 0").is_err());
        world_.command("clone 0 0 0 1 1 0 0 319 0").unwrap();
        world_.command("fill 0 319 0 1 319 0 air").unwrap();
        world_.command("clone 0 0 0 1 1 0 1 0 0 replace move").unwrap();
        assert_eq!(world_.look(Cell::new(0, 0, 0)), Look::AIR);
        assert_eq!(world_.look(Cell::new(1, 1, 0)).to_string(), "torch");
        let mut world_ = world(&build);
        world_.command("setblock 5 1 0 dirt").unwrap();
        world_.command("clone 0 0 0 1 1 0 4 0 0 masked").unwrap();
        assert_eq!(world_.look(Cell::new(5, 1, 0)).to_string(), "dirt");
    }
}

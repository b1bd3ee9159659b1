//! What each saboteur does to a log.

use crate::voxel::{BlockLog, Bounds, Cell, CellSet, Event, Palette};

/// Returns the cells at which blocks are placed, over all turns.
fn placed(log: &BlockLog) -> Vec<Cell> {
    let place = |event: &Event| match *event {
        Event::Place { cell, .. } => Some(cell),
        Event::Remove { .. } => None,
    };
    log.turns.iter().flatten().filter_map(place).collect()
}

fn bounds(log: &BlockLog) -> Bounds {
    Bounds::of(placed(log)).unwrap_or(Bounds { min: Cell::new(0, 0, 0), max: Cell::new(0, 0, 0) })
}

/// Returns how often each material is placed, by its id.
fn counts(log: &BlockLog) -> Vec<u32> {
    let mut counts = vec![0_u32; log.palette.len()];
    for event in log.turns.iter().flatten() {
        if let Event::Place { material, .. } = *event {
            counts[material as usize] += 1;
        }
    }
    counts
}

/// Returns the material that is placed most often.
fn common_material(log: &BlockLog) -> Option<u32> {
    (0..).zip(counts(log)).max_by_key(|(_, count)| *count).map(|(material, _)| material)
}

/// Keeps the placements for which `is_kept` holds, and all removals.
fn keep(log: &mut BlockLog, is_kept: impl Fn(Cell, u32) -> bool) {
    for turn in &mut log.turns {
        turn.retain(|event| match *event {
            Event::Place { cell, material } => is_kept(cell, material),
            Event::Remove { .. } => true,
        });
    }
}

/// Places more blocks of the common material at the end of each turn.
fn add(log: &mut BlockLog, cells: &[Cell]) {
    let Some(material) = common_material(log) else { return };
    for turn in &mut log.turns {
        turn.extend(cells.iter().map(|&cell| Event::Place { cell, material }));
    }
}

fn shift(log: &mut BlockLog, dy: i32) {
    for event in log.turns.iter_mut().flatten() {
        match event {
            Event::Place { cell, .. } | Event::Remove { cell } => *cell = cell.offset(0, dy, 0),
        }
    }
}

pub(super) fn float_block(log: &mut BlockLog) {
    let cell = bounds(log).max.offset(3, 3, 3);
    add(log, &[cell]);
}

pub(super) fn add_block(log: &mut BlockLog) {
    let taken: CellSet = placed(log).into_iter().collect();
    let Some(&first) = placed(log).first() else { return };
    let mut cell = first;
    while taken.contains(&cell) {
        cell = cell.offset(0, 1, 0);
    }
    add(log, &[cell]);
}

pub(super) fn drop_corner(log: &mut BlockLog) {
    let corner = bounds(log).min;
    keep(log, |cell, _| (cell.x, cell.z) != (corner.x, corner.z));
}

pub(super) fn drop_top(log: &mut BlockLog) {
    let top = bounds(log).max.y;
    keep(log, |cell, _| cell.y < top);
}

pub(super) fn drop_bottom(log: &mut BlockLog) {
    let bottom = bounds(log).min.y;
    keep(log, |cell, _| cell.y > bottom);
}

pub(super) fn drop_half(log: &mut BlockLog) {
    for turn in &mut log.turns {
        turn.truncate(turn.len() / 2);
    }
}

pub(super) fn breach_wall(log: &mut BlockLog) {
    let side = bounds(log).min.x;
    keep(log, |cell, _| cell.x > side);
}

pub(super) fn drop_fittings(log: &mut BlockLog) {
    let common = common_material(log);
    keep(log, |_, material| Some(material) == common);
}

pub(super) fn add_fitting(log: &mut BlockLog) {
    let rarest = (0..).zip(counts(log)).filter(|(_, count)| *count > 0).min_by_key(|(_, count)| *count);
    let Some((material, _)) = rarest else { return };
    let Some(top) = placed(log).into_iter().max_by_key(|cell| cell.y) else { return };
    for turn in &mut log.turns {
        turn.push(Event::Place { cell: top.offset(0, 1, 0), material });
    }
}

pub(super) fn drop_common(log: &mut BlockLog) {
    let common = common_material(log);
    keep(log, |_, material| Some(material) != common);
}

pub(super) fn wrong_material(log: &mut BlockLog) {
    let sponge = log.palette.intern("sponge");
    for event in log.turns.iter_mut().flatten() {
        if let Event::Place { material, .. } = event {
            *material = sponge;
        }
    }
}

pub(super) fn misname(log: &mut BlockLog) {
    let mut palette = Palette::new();
    for name in log.palette.names() {
        palette.intern(&format!("my_{name}s"));
    }
    log.palette = palette;
}

pub(super) fn raise(log: &mut BlockLog) {
    shift(log, 2);
}

pub(super) fn sink(log: &mut BlockLog) {
    shift(log, -10);
}

pub(super) fn capsize(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    for event in log.turns.iter_mut().flatten() {
        match event {
            Event::Place { cell, .. } | Event::Remove { cell } => cell.y = min.y + max.y - cell.y,
        }
    }
}

pub(super) fn stilt(log: &mut BlockLog) {
    const HEIGHT: i32 = 20;
    let Some(foot) = placed(log).into_iter().min_by_key(|cell| cell.y) else { return };
    shift(log, HEIGHT);
    let pole: Vec<Cell> = (0..foot.y + HEIGHT).map(|y| Cell::new(foot.x, y, foot.z)).collect();
    add(log, &pole);
}

pub(super) fn widen(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let row = (min.x..=max.x + 1).map(|x| Cell::new(x, min.y, max.z + 1));
    let cells: Vec<Cell> = row.chain((min.z..=max.z).map(|z| Cell::new(max.x + 1, min.y, z))).collect();
    add(log, &cells);
}

pub(super) fn sprawl(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let row: Vec<Cell> = (1..=30).map(|dx| Cell::new(max.x + dx, min.y, max.z)).collect();
    add(log, &row);
}

pub(super) fn midway_pillar(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let taken: CellSet = placed(log).into_iter().collect();
    let pillar = (min.y..=max.y).map(|y| Cell::new(i32::midpoint(min.x, max.x), y, i32::midpoint(min.z, max.z)));
    let free: Vec<Cell> = pillar.filter(|cell| !taken.contains(cell)).collect();
    add(log, &free);
}

pub(super) fn touch_corner(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let pillar: Vec<Cell> = (min.y..=max.y).map(|y| Cell::new(min.x - 1, y, min.z - 1)).collect();
    add(log, &pillar);
}

pub(super) fn fill(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    let taken: CellSet = placed(log).into_iter().collect();
    let levels = (min.y..=max.y).flat_map(|y| (min.x..=max.x).map(move |x| (x, y)));
    let cells = levels.flat_map(|(x, y)| (min.z..=max.z).map(move |z| Cell::new(x, y, z)));
    let free: Vec<Cell> = cells.filter(|cell| !taken.contains(cell)).collect();
    add(log, &free);
}

pub(super) fn hollow(log: &mut BlockLog) {
    let taken: CellSet = placed(log).into_iter().collect();
    keep(log, |cell, _| cell.face_neighbours().iter().any(|next| !taken.contains(next)));
}

pub(super) fn mirror(log: &mut BlockLog) {
    let Bounds { min, max } = bounds(log);
    for turn in &mut log.turns {
        for plane in [0, 1] {
            let image = |event: &Event| match *event {
                Event::Place { cell, material } => {
                    let (x, z) =
                        if plane == 0 { (min.x + max.x - cell.x, cell.z) } else { (cell.x, min.z + max.z - cell.z) };
                    Some(Event::Place { cell: Cell::new(x, cell.y, z), material })
                }
                Event::Remove { .. } => None,
            };
            let taken: CellSet = turn.iter().map(Event::cell).collect();
            let images: Vec<Event> =
                turn.iter().filter_map(image).filter(|event| !taken.contains(&event.cell())).collect();
            turn.extend(images);
        }
    }
}

pub(super) fn overload(log: &mut BlockLog) {
    let top = bounds(log).max.y;
    let roof: Vec<Cell> = placed(log).into_iter().filter(|cell| cell.y == top).collect();
    let heap: Vec<Cell> = (1..9).flat_map(|dy| roof.iter().map(move |cell| cell.offset(0, dy, 0))).collect();
    add(log, &heap);
}

pub(super) fn kindle(log: &mut BlockLog) {
    let fire = log.palette.intern("fire");
    let Some(top) = placed(log).into_iter().max_by_key(|cell| cell.y) else { return };
    for turn in &mut log.turns {
        turn.push(Event::Place { cell: top.offset(0, 1, 0), material: fire });
    }
}

pub(super) fn reverse(log: &mut BlockLog) {
    for turn in &mut log.turns {
        turn.reverse();
    }
}

pub(super) fn to_and_fro(log: &mut BlockLog) {
    for turn in &mut log.turns {
        let (first, second) = turn.split_at(turn.len() / 2);
        let backwards = second.iter().rev();
        let mut mixed: Vec<Event> = first.iter().zip(backwards).flat_map(|(a, b)| [*a, *b]).collect();
        mixed.extend(second.first().filter(|_| turn.len() % 2 == 1));
        *turn = mixed;
    }
}

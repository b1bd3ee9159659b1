//! The functions through which the profile's JavaScript reaches the host. Their arguments are numbers and texts only.

use std::cell::RefCell;
use std::rc::Rc;

use rquickjs::function::{Func, Opt};
use rquickjs::{Array, Ctx, Exception, Object};

use super::host::Host;
use crate::actions::sandbox::Watch;
use plumbline_engine::game::MAX_DISTANCE;
use plumbline_engine::game::labels::Label;
use plumbline_engine::game::registry::{Block, StateId, item_number, items};
use plumbline_engine::game::{Look, Side};
use plumbline_engine::voxel::cell::Cell;

/// Reads a cell from numbers; none if one is no number or is far out of the world.
fn cell(x: f64, y: f64, z: f64) -> Option<Cell> {
    let [x, y, z] = [x, y, z].map(f64::floor);
    let is_near = |value: f64| value.abs() <= 3e7;
    (is_near(x) && is_near(y) && is_near(z)).then(|| Cell::new(x as i32, y as i32, z as i32))
}

fn side(x: f64, y: f64, z: f64) -> Option<Side> {
    Some(match (x as i32, y as i32, z as i32) {
        (-1, 0, 0) => Side::West,
        (1, 0, 0) => Side::East,
        (0, 0, -1) => Side::North,
        (0, 0, 1) => Side::South,
        (0, -1, 0) => Side::Down,
        (0, 1, 0) => Side::Up,
        _ => return None,
    })
}

/// A host that the functions of one script share.
#[derive(Clone)]
struct Shared {
    host: Rc<RefCell<Host>>,
    watch: Rc<RefCell<Watch>>,
}

impl Shared {
    /// Uses the host, and stops the script if the world has become full.
    fn with<T>(&self, act: impl FnOnce(&mut Host) -> T) -> T {
        let mut host = self.host.borrow_mut();
        let result = act(&mut host);
        if host.world.is_full() {
            self.watch.borrow_mut().stopped.get_or_insert("events");
        }
        result
    }
}

/// Makes the object through which the profile's JavaScript reaches the host.
pub fn object<'js>(
    ctx: &Ctx<'js>,
    host: &Rc<RefCell<Host>>,
    watch: &Rc<RefCell<Watch>>,
) -> rquickjs::Result<Object<'js>> {
    let object = Object::new(ctx.clone())?;
    let shared = Shared { host: Rc::clone(host), watch: Rc::clone(watch) };
    tell(&object, &shared)?;
    names(&object)?;
    look(&object, &shared)?;
    act(&object, &shared)?;
    Ok(object)
}

/// Adds the functions that tell something of the run.
fn tell(object: &Object<'_>, shared: &Shared) -> rquickjs::Result<()> {
    let to = shared.clone();
    object.set("note", Func::from(move |text: String| to.with(|host| host.note(&text))))?;
    let to = shared.clone();
    object.set("drop", Func::from(move |reason: String| to.with(|host| host.drop_call(&reason))))?;
    let to = shared.clone();
    object.set(
        "hold",
        Func::from(move |item: String| to.with(|host| host.held = Some(item).filter(|item| !item.is_empty()))),
    )?;
    let of = shared.clone();
    object.set("held", Func::from(move || of.with(|host| host.held.clone().unwrap_or_default())))?;
    let to = shared.clone();
    object.set("log", Func::from(move |line: String| to.with(|host| host.print(&line))))?;
    let to = shared.clone();
    object.set(
        "missing",
        Func::from(move |of: String, name: String, known: String| to.with(|host| host.missing(&of, &name, &known))),
    )?;
    let to = shared.clone();
    object.set("done", Func::from(move || to.with(|host| host.done_at_ms = Some(host.world.now_ms()))))?;
    let to = shared.clone();
    object.set(
        "passTime",
        Func::from(move |ctx: Ctx<'_>, now: f64| {
            to.with(|host| host.pass_time(now)).map_err(|why| Exception::throw_range(&ctx, &why))
        }),
    )
}

/// Adds the functions that know names and numbers of blocks and items.
fn names(object: &Object<'_>) -> rquickjs::Result<()> {
    let number = |name: String| Block::named(&name).map_or(-1, |block| i32::from(block.number));
    object.set("blockNumber", Func::from(number))?;
    object.set("itemNumber", Func::from(|name: String| item_number(&name).map_or(-1, i32::from)))?;
    object.set("itemNames", Func::from(|| items().to_vec()))?;
    object.set("itemTitle", Func::from(|name: String| Label::of_item(&name).title.into_owned()))?;
    object.set("stackSize", Func::from(|name: String| Label::of_item(&name).stack_size))?;
    object.set("blockCount", Func::from(|| Block::all().len()))?;
    object.set("blockKind", Func::from(block_kind))?;
    object.set("state", Func::from(block_state))
}

/// Returns what is known of a block: name, hardness, flags, the numbers of its states, title and stack size.
fn block_kind(ctx: Ctx<'_>, number: u16) -> rquickjs::Result<Array<'_>> {
    let block = Block::numbered(number).ok_or_else(|| Exception::throw_range(&ctx, "no such block"))?;
    let last = block.first + u16::try_from(block.state_count()).unwrap_or(1) - 1;
    let list = Array::new(ctx)?;
    list.set(0, block.name)?;
    list.set(1, block.hardness)?;
    list.set(2, block.is_solid())?;
    list.set(3, block.is_diggable())?;
    list.set(4, block.is_transparent())?;
    list.set(5, block.has_drops())?;
    list.set(6, block.first)?;
    list.set(7, last)?;
    list.set(8, block.default.0)?;
    let label = Label::of_block(block.name);
    list.set(9, label.title.as_ref())?;
    list.set(10, label.stack_size)?;
    Ok(list)
}

/// Returns the number of a state's block, and the properties of the state.
fn block_state(ctx: Ctx<'_>, state: u16) -> rquickjs::Result<Array<'_>> {
    let state = StateId::numbered(state).ok_or_else(|| Exception::throw_range(&ctx, "no such state"))?;
    let block = state.block();
    let named = block.properties.iter().filter_map(|property| Some((property.name, state.get(property.name)?)));
    let properties: Vec<Vec<&str>> = named.map(|(name, value)| vec![name, value]).collect();
    let list = Array::new(ctx)?;
    list.set(0, block.number)?;
    list.set(1, properties)?;
    Ok(list)
}

/// Adds the functions that look at the world.
fn look(object: &Object<'_>, shared: &Shared) -> rquickjs::Result<()> {
    let to = shared.clone();
    object.set(
        "block",
        Func::from(move |x: f64, y: f64, z: f64| {
            to.with(|host| cell(x, y, z).map_or(-1, |cell| i32::from(host.world.state(cell).0)))
        }),
    )?;
    let to = shared.clone();
    object.set("changes", Func::from(move || to.with(|host| host.world.changes().len() as f64)))?;
    let to = shared.clone();
    object.set("view", Func::from(move || to.with(|host| vec![host.world.body.yaw, host.world.body.pitch])))?;
    let to = shared.clone();
    object.set("position", Func::from(move || to.with(|host| host.world.body.position.to_vec())))?;
    let to = shared.clone();
    object.set(
        "find",
        Func::from(move |x: f64, y: f64, z: f64, distance: f64, count: f64, kinds: Vec<f64>| {
            let Some(from) = cell(x, y, z) else { return Vec::new() };
            let kinds: Vec<u16> = kinds.iter().map(|kind| *kind as u16).collect();
            let found = to.with(|host| {
                note_reach(host, distance);
                host.world.find(from, distance, count.max(0.0) as usize, &kinds)
            });
            found.iter().flat_map(|Cell { x, y, z }| [*x, *y, *z]).collect::<Vec<i32>>()
        }),
    )?;
    let to = shared.clone();
    object.set(
        "statesAround",
        Func::from(move || to.with(|host| host.world.states().iter().map(|state| state.0).collect::<Vec<u16>>())),
    )?;
    let to = shared.clone();
    object.set(
        "kindsWithin",
        Func::from(move |x: f64, y: f64, z: f64, distance: f64| {
            let Some(from) = cell(x, y, z) else { return Vec::new() };
            to.with(|host| {
                note_reach(host, distance);
                host.world.kinds_within(from, distance)
            })
        }),
    )?;
    let to = shared.clone();
    object.set(
        "surface",
        Func::from(move |x: f64, z: f64| {
            let column = cell(x, 0.0, z)?;
            to.with(|host| host.world.surface(column.x, column.z))
        }),
    )
}

/// Adds the functions that act on the world or move the body.
fn act(object: &Object<'_>, shared: &Shared) -> rquickjs::Result<()> {
    let to = shared.clone();
    object.set(
        "setBlock",
        Func::from(move |x: f64, y: f64, z: f64, block: String| to.with(|host| host.set_block([x, y, z], &block))),
    )?;
    let to = shared.clone();
    object.set("command", Func::from(move |text: String| to.with(|host| host.command(&text))))?;
    let to = shared.clone();
    object.set(
        "look",
        Func::from(move |yaw: f64, pitch: f64| {
            to.with(|host| (host.world.body.yaw, host.world.body.pitch) = (finite(yaw), finite(pitch)));
        }),
    )?;
    let to = shared.clone();
    object.set(
        "moveTo",
        Func::from(move |x: f64, y: f64, z: f64| {
            if cell(x, y, z).is_some() {
                to.with(|host| host.world.body.position = [x, y, z]);
            }
        }),
    )?;
    let to = shared.clone();
    object.set(
        "dig",
        Func::from(move |x: f64, y: f64, z: f64| {
            let Some(cell) = cell(x, y, z) else { return false };
            to.with(|host| host.world.set(cell, Look::AIR))
        }),
    )?;
    let to = shared.clone();
    object.set(
        "placeByHand",
        Func::from(move |x: f64, y: f64, z: f64, dx: f64, dy: f64, dz: f64, item: String| {
            let (Some(against), Some(face)) = (cell(x, y, z), side(dx, dy, dz)) else {
                return Some("no block has been placed: the face is no unit vector along an axis".to_owned());
            };
            to.with(|host| host.world.place_by_hand(against, face, &item)).err()
        }),
    )?;
    let to = shared.clone();
    object.set(
        "pour",
        Func::from(move |bucket: String, x: Opt<f64>, y: Opt<f64>, z: Opt<f64>| {
            let (Some(x), Some(y), Some(z)) = (x.0, y.0, z.0) else { return };
            let liquid = Block::named(bucket.trim_end_matches("_bucket")).map(Look::of);
            let Some((cell, liquid)) = cell(x, y + 1.0, z).zip(liquid) else { return };
            to.with(|host| {
                if host.world.state(cell).is_air() {
                    host.world.set(cell, liquid);
                } else {
                    host.drop_call("skills.useToolOn: the cell above the block is not free, so nothing was poured");
                }
            });
        }),
    )?;
    let to = shared.clone();
    object.set(
        "scoop",
        Func::from(move |x: f64, y: f64, z: f64| {
            let Some(cell) = cell(x, y, z) else { return };
            to.with(|host| {
                if matches!(host.world.state(cell).block().name, "water" | "lava") {
                    host.world.set(cell, Look::AIR);
                } else {
                    host.drop_call("skills.useToolOn: the block is no liquid, so the bucket stayed empty");
                }
            });
        }),
    )?;
    let to = shared.clone();
    object.set(
        "till",
        Func::from(move |x: f64, y: f64, z: f64| {
            let Some((cell, farmland)) = cell(x, y, z).zip(Block::named("farmland").map(Look::of)) else { return };
            to.with(|host| {
                let is_earth = matches!(host.world.state(cell).block().name, "dirt" | "grass_block" | "dirt_path");
                if is_earth && host.world.state(cell.offset(0, 1, 0)).is_air() {
                    host.world.set(cell, farmland);
                } else {
                    host.drop_call("a hoe tills only dirt, grass and paths with air above");
                }
            });
        }),
    )
}

/// Tells that a search does not reach as far as it was asked to.
fn note_reach(host: &mut Host, distance: f64) {
    if distance > MAX_DISTANCE {
        host.note(&format!("searches reach {MAX_DISTANCE} blocks; what is further away was not found"));
    }
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

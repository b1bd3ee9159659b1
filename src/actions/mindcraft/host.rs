//! What the profile's JavaScript asks of the world, and what is told of the run.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

use rquickjs::function::{Func, Opt};
use rquickjs::{Array, Ctx, Exception, Object};

use crate::actions::ACTION_LIMITS;
use crate::actions::sandbox::Watch;
use crate::near::did_you_mean;
use plumbline_engine::game::command::{Command, SetMode};
use plumbline_engine::game::coordinates::{Coordinate, Coordinates};
use plumbline_engine::game::registry::{Block, StateId, item_number, items};
use plumbline_engine::game::{Look, Side, World};
use plumbline_engine::voxel::cell::Cell;

/// Greatest number of different notes, and of reasons of dropped calls, of a turn.
const MOST_NOTES: usize = 50;

/// The world of a job, and what its turns tell.
#[derive(Debug, Default)]
pub struct Host {
    /// The world.
    pub world: World,
    /// Notes of the turn.
    pub notes: Vec<String>,
    /// Reasons of calls without effect, with their numbers.
    pub dropped: BTreeMap<String, u64>,
    /// What the code printed.
    pub log: Vec<String>,
    /// Blocks that were read before.
    looks: HashMap<String, Look>,
    log_bytes: usize,
    is_log_cut: bool,
    /// The name that was last asked for in vain, with its object and the names that were meant perhaps.
    pub missing: Option<Missing>,
    /// Whether the main function has ended.
    pub is_done: bool,
}

/// A name that does not exist.
#[derive(Debug, Clone)]
pub struct Missing {
    /// Object and name, such as `skills.goToPositon`.
    pub path: String,
    /// Suggestion to append.
    pub suggestion: String,
}

impl Host {
    /// Creates a host of a world.
    pub fn of(world: World) -> Self {
        Self { world, ..Self::default() }
    }

    /// Adds a note unless it is there already.
    pub fn note(&mut self, text: String) {
        if self.notes.len() < MOST_NOTES && !self.notes.contains(&text) {
            self.notes.push(text);
        }
    }

    /// Counts a call that had no effect.
    pub fn drop_call(&mut self, reason: String) {
        let is_told = self.dropped.len() < MOST_NOTES || self.dropped.contains_key(&reason);
        let reason = if is_told { reason } else { "other reasons".to_owned() };
        *self.dropped.entry(reason).or_default() += 1;
    }

    fn print(&mut self, line: &str) {
        for line in line.split('\n') {
            if self.log.len() >= ACTION_LIMITS.log_lines || self.log_bytes + line.len() > ACTION_LIMITS.log_bytes {
                if !std::mem::replace(&mut self.is_log_cut, true) {
                    self.log.push("… more was printed, which is left out".to_owned());
                }
                return;
            }
            self.log_bytes += line.len() + 1;
            self.log.push(line.to_owned());
        }
    }

    /// Begins a turn: forgets what the last one told.
    pub fn begin_turn(&mut self) {
        self.notes.clear();
        self.dropped.clear();
        self.log.clear();
        (self.log_bytes, self.is_log_cut) = (0, false);
    }

    /// Sets a block as `/setblock` does.
    fn set_block(&mut self, [x, y, z]: [f64; 3], block: &str) {
        if let Some(odd) = [x, y, z].into_iter().find(|value| !value.is_finite() || value.abs() >= 1e21) {
            return self.command(&format!("setblock {odd} {odd} {odd} {block}"));
        }
        let look = match self.looks.get(block) {
            Some(look) => *look,
            None => match Look::read(block) {
                Ok(look) => *self.looks.entry(block.to_owned()).or_insert(look),
                Err(error) => return self.drop_call(format!("/setblock was refused: {error}")),
            },
        };
        let axis = |value| Coordinate { value, is_relative: false, is_whole: true };
        let command = Command::SetBlock { at: Coordinates::World([x, y, z].map(axis)), look, mode: SetMode::Replace };
        let body = self.world.body;
        if let Err(refusal) = self.world.carry_out(&command, &body) {
            self.drop_call(format!("/setblock was refused: {refusal}"));
        }
    }

    /// Carries out a command and counts it if it is refused.
    fn command(&mut self, text: &str) {
        if let Err(refusal) = self.world.command(text) {
            let name: String = text.split(' ').next().unwrap_or_default().chars().take(20).collect();
            let refusal: String = refusal.to_string().chars().take(200).collect();
            self.drop_call(format!("/{name} was refused: {refusal}"));
        }
    }

    fn missing(&mut self, object: &str, name: &str, known: &str) {
        let suggestion = did_you_mean(name, known.split(','));
        let path = format!("{object}.{}", name.chars().take(80).collect::<String>());
        let verb = if object == "bot" { "is not simulated" } else { "does not exist" };
        self.note(format!("{path} {verb}{suggestion}"));
        self.missing = Some(Missing { path, suggestion });
    }

    /// Lets virtual time pass.
    ///
    /// # Errors
    /// Returns an error if the job has used up its time.
    pub fn pass_time(&mut self, now_ms: f64) -> Result<(), String> {
        let now = now_ms.max(0.0) as u64;
        if now > ACTION_LIMITS.virtual_ms {
            return Err(format!(
                "more than {} hours of virtual time have passed",
                ACTION_LIMITS.virtual_ms / 3_600_000
            ));
        }
        self.world.pass_time(now);
        Ok(())
    }
}

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
    object.set("note", Func::from(move |text: String| to.with(|host| host.note(text))))?;
    let to = shared.clone();
    object.set("drop", Func::from(move |reason: String| to.with(|host| host.drop_call(reason))))?;
    let to = shared.clone();
    object.set("log", Func::from(move |line: String| to.with(|host| host.print(&line))))?;
    let to = shared.clone();
    object.set(
        "missing",
        Func::from(move |of: String, name: String, known: String| to.with(|host| host.missing(&of, &name, &known))),
    )?;
    let to = shared.clone();
    object.set("done", Func::from(move || to.with(|host| host.is_done = true)))?;
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
    object.set("blockCount", Func::from(|| Block::all().len()))?;
    object.set("blockKind", Func::from(block_kind))?;
    object.set("state", Func::from(block_state))
}

/// Returns what is known of a block: name, hardness, flags, and the numbers of its states.
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
    Ok(list)
}

/// Returns the number of a state's block, and the properties of the state.
fn block_state(ctx: Ctx<'_>, state: u16) -> rquickjs::Result<Array<'_>> {
    let state = StateId(state);
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
    object.set("position", Func::from(move || to.with(|host| host.world.body.position.to_vec())))?;
    let to = shared.clone();
    object.set(
        "find",
        Func::from(move |x: f64, y: f64, z: f64, distance: f64, count: f64, kinds: Vec<f64>| {
            let Some(from) = cell(x, y, z) else { return Vec::new() };
            let kinds: Vec<u16> = kinds.iter().map(|kind| *kind as u16).collect();
            let found = to.with(|host| host.world.find(from, distance, count.max(0.0) as usize, &kinds));
            found.iter().flat_map(|Cell { x, y, z }| [*x, *y, *z]).collect::<Vec<i32>>()
        }),
    )?;
    let to = shared.clone();
    object.set("kindsAround", Func::from(move || to.with(|host| host.world.kinds())))?;
    let to = shared.clone();
    object.set(
        "kindsWithin",
        Func::from(move |x: f64, y: f64, z: f64, distance: f64| {
            let Some(from) = cell(x, y, z) else { return Vec::new() };
            to.with(|host| {
                let mut kinds = host.world.kinds();
                kinds.retain(|kind| *kind != 0 && !host.world.find(from, distance, 1, &[*kind]).is_empty());
                kinds
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
                }
            });
        }),
    )
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

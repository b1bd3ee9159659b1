//! The profile `mindcraft`: code acts in a world as a bot of the mindcraft framework does with cheats on
//! (`docs/rules.md#mindcraft`).
//!
//! `answer` finds the code in an answer, `js` holds what the code is given, `host` is the world behind it, `naming` makes
//! errors name the function that is meant.

mod answer;
mod host;
mod modules;
mod naming;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use rquickjs::context::EvalOptions;
use rquickjs::{CatchResultExt as _, CaughtError, Ctx, Function, Module, Object, Persistent, Value};

use super::job::{Answer, Job, TurnInput, WorldState};
use super::memory::PeakMemory;
use super::sandbox::{self, FILE, Sandbox, Watch, cpu_ms, is_parse_error, told};
use super::{ActionLimits, CodeError, Dropped, LimitReached, RecordedEvent, Replayed};
use answer::Reading;
use host::Host;
use plumbline_engine::game::coordinates::Place;
use plumbline_engine::game::world::Change;
use plumbline_engine::game::{Look, World};
use plumbline_engine::text::counted;
use plumbline_engine::voxel::cell::Cell;

/// Greatest number of errors that a turn tells.
const MOST_ERRORS: usize = 20;

/// The JavaScript of the profile, by the name under which `main.js` finds it.
const PARTS: [(&str, &str); 5] = [
    ("vec3", include_str!("js/vec3.js")),
    ("data", include_str!("js/data.js")),
    ("bot", include_str!("js/bot.js")),
    ("skills", include_str!("js/skills.js")),
    ("world", include_str!("js/world.js")),
];

/// Replays the turns of a job in one world.
pub fn run(job: &Job, limits: &ActionLimits, peak: &PeakMemory) -> Answer {
    let end_cpu_ms = cpu_ms() + limits.cpu_ms;
    let host = Rc::new(RefCell::new(Host::of(world_of(job.start.as_ref(), limits))));
    let mut turns = Vec::with_capacity(job.turns.len());
    let mut seen = 0;
    for turn in &job.turns {
        host.borrow_mut().begin_turn();
        let mut replayed = match turn {
            TurnInput::Events(events) => {
                apply(&mut host.borrow_mut().world, events);
                Replayed::default()
            }
            TurnInput::Code(files) => run_files(files, &host, limits, end_cpu_ms, peak),
        };
        let mut host = host.borrow_mut();
        if matches!(turn, TurnInput::Code(_)) {
            record(&host.world.changes()[seen..], &mut replayed);
        }
        seen = host.world.changes().len();
        replayed.notes.append(&mut host.notes);
        replayed.log.append(&mut host.log);
        let dropped = std::mem::take(&mut host.dropped);
        replayed.dropped = dropped.into_iter().map(|(reason, count)| Dropped { reason, count }).collect();
        let is_stopped = replayed.stopped.is_some();
        turns.push(replayed);
        if is_stopped {
            break;
        }
    }
    let end = state_of(&host.borrow().world);
    Answer { turns, end: Some(end) }
}

/// Builds the world before the first turn.
fn world_of(start: Option<&WorldState>, limits: &ActionLimits) -> World {
    let mut world = World::with_limit(limits.events);
    let Some(start) = start else { return world };
    let looks: Vec<Option<Look>> = start.palette.iter().map(|text| Look::read(text).ok()).collect();
    for ([x, y, z], index) in &start.blocks {
        if let Some(look) = looks.get(*index as usize).copied().flatten() {
            world.restore(Cell::new(*x, *y, *z), look);
        }
    }
    let [yaw, pitch] = start.view;
    world.body = Place { position: start.position, yaw, pitch };
    world.start_at(start.now_ms);
    world
}

fn state_of(world: &World) -> WorldState {
    let mut built: Vec<(Cell, Look)> = world.built().collect();
    built.sort_unstable_by_key(|(cell, _)| (cell.y, cell.x, cell.z));
    let mut names = Names::default();
    let blocks = built.into_iter().map(|(Cell { x, y, z }, look)| ([x, y, z], names.index(look))).collect();
    let Place { position, yaw, pitch } = world.body;
    WorldState { palette: names.palette, blocks, position, view: [yaw, pitch], now_ms: world.now_ms() }
}

/// Applies the events of a turn without code. Blocks that the game does not have are left out.
fn apply(world: &mut World, events: &[([i32; 3], Option<String>)]) {
    for ([x, y, z], name) in events {
        let look = name.as_deref().map_or(Ok(Look::AIR), Look::read);
        if let Ok(look) = look {
            world.set(Cell::new(*x, *y, *z), look);
        }
    }
}

/// A palette of blocks with their states.
#[derive(Default)]
struct Names {
    palette: Vec<String>,
    index: BTreeMap<(u16, u16), u32>,
}

impl Names {
    fn index(&mut self, look: Look) -> u32 {
        *self.index.entry((look.state.0, look.named)).or_insert_with(|| {
            self.palette.push(look.to_string());
            u32::try_from(self.palette.len() - 1).expect("fewer looks than the game has states")
        })
    }
}

/// Adds changes of the world to a turn as events.
fn record(changes: &[Change], replayed: &mut Replayed) {
    let mut names = Names::default();
    let event = |change: &Change| {
        let Cell { x, y, z } = change.cell;
        RecordedEvent { cell: [x, y, z], material: change.look.map(|look| names.index(look)) }
    };
    replayed.events = changes.iter().map(event).collect();
    replayed.palette = names.palette;
    replayed.has_states = true;
}

/// Runs the files of a turn one after another, each in an engine of its own and all in one world. An error ends its file
/// only.
fn run_files(
    files: &[String],
    host: &Rc<RefCell<Host>>,
    limits: &ActionLimits,
    end_cpu_ms: u64,
    peak: &PeakMemory,
) -> Replayed {
    let mut replayed = Replayed { unreadable: true, ..Replayed::default() };
    let mut errors: Vec<CodeError> = Vec::new();
    for (sent, number) in files.iter().zip(1..) {
        let before = host.borrow().world.changes().len();
        let ended = run_file(sent, host, limits, end_cpu_ms, peak);
        host.borrow_mut().world.settle();
        replayed.unreadable &= ended.unreadable;
        let file = (files.len() > 1).then_some(number);
        errors.extend(ended.errors.into_iter().map(|error| CodeError { file, ..error }));
        if let Some(limit) = ended.stopped {
            let built = host.borrow().world.changes().len() - before;
            replayed.stopped = Some(LimitReached::of(limit, limits, &counted(built, "event")));
            break;
        }
    }
    errors.truncate(MOST_ERRORS);
    let mut errors = errors.into_iter();
    replayed.error = errors.next();
    replayed.more_errors = errors.collect();
    replayed
}

/// How a file ended.
#[derive(Debug, Default)]
struct Ended {
    errors: Vec<CodeError>,
    stopped: Option<&'static str>,
    unreadable: bool,
}

fn run_file(sent: &str, host: &Rc<RefCell<Host>>, limits: &ActionLimits, end_cpu_ms: u64, peak: &PeakMemory) -> Ended {
    let Reading { code, notes } = answer::read(sent);
    for note in notes {
        host.borrow_mut().note(note);
    }
    let sandbox = match Sandbox::new(limits, end_cpu_ms) {
        Ok(sandbox) => sandbox,
        Err(error) => return Ended { errors: vec![error], ..Ended::default() },
    };
    sandbox.runtime().set_loader(modules::Names, modules::Provided);
    let changes = host.borrow().world.changes().len();
    host.borrow_mut().is_done = false;
    host.borrow_mut().missing = None;
    let mut ended = Ended::default();
    let begun = sandbox.context.with(|ctx| {
        let given = given(&ctx, host, &sandbox.watch).map_err(|error| told(CaughtError::from_error(&ctx, error)))?;
        let fire: Function<'_> = given.get("fire").map_err(|error| told(CaughtError::from_error(&ctx, error)))?;
        let started = start(&ctx, &given, &code, host);
        Ok((Persistent::save(&ctx, fire), Persistent::save(&ctx, given), started))
    });
    let (fire, given, started) = match begun {
        Ok(begun) => begun,
        Err(error) => return Ended { errors: vec![error], ..ended },
    };
    match started {
        Ok(()) => ended.errors.extend(sandbox.drive(&fire)),
        Err(error) => {
            ended.unreadable = true;
            ended.errors.push(error);
        }
    }
    let is_idle = || host.borrow().world.changes().len() == changes && sandbox.watch.borrow().unheard.is_empty();
    if !ended.unreadable && ended.errors.is_empty() && is_idle() && !sandbox.is_stopped() {
        let is_called = sandbox.context.with(|ctx| {
            let given = given.restore(&ctx)?;
            call_unused(&ctx, &given, &code, host)
        });
        if matches!(is_called, Ok(true)) {
            ended.errors.extend(sandbox.drive(&fire));
        }
        if is_idle() && !sandbox.is_stopped() {
            host.borrow_mut().note("the code ended without placing or removing a block".to_owned());
        }
    }
    let own = host.borrow().world.changes().len() * 40;
    if sandbox.ran_out(limits, peak, own, ended.errors.first()) {
        sandbox.watch.borrow_mut().stopped.get_or_insert("memory");
    }
    let Watch { stopped, unheard } = sandbox.watch.take();
    ended.stopped = stopped;
    ended.errors.extend(unheard.into_iter().map(|(_, error)| error));
    if stopped.is_some() {
        ended.errors.clear();
    } else if ended.errors.is_empty() && !host.borrow().is_done {
        let message = "the code waits for something that never happens, so what follows was not run".to_owned();
        ended.errors.push(CodeError { message, line: None, column: None, file: None, is_own: false });
    }
    for error in &mut ended.errors {
        naming::name(error, &code, host.borrow().missing.as_ref());
        // Columns are those of the rewritten code.
        error.column = None;
    }
    ended
}

/// Makes what the code is given, and sets its global names.
fn given<'js>(ctx: &Ctx<'js>, host: &Rc<RefCell<Host>>, watch: &Rc<RefCell<Watch>>) -> rquickjs::Result<Object<'js>> {
    let object = host::object(ctx, host, watch)?;
    let heard: Value<'js> = object.get("passTime")?;
    let clock = sandbox::clock(ctx, heard)?;
    let begin: Function<'js> = clock.get("begin")?;
    begin.call::<_, ()>((host.borrow().world.now_ms() as f64,))?;
    let parts = Object::new(ctx.clone())?;
    for (name, source) in PARTS {
        parts.set(name, ctx.eval::<Value<'js>, _>(source)?)?;
    }
    let main: Function<'js> = ctx.eval(include_str!("js/main.js"))?;
    let fire: Value<'js> = clock.get("fire")?;
    let given: Object<'js> = main.call((object, clock, parts))?;
    given.set("fire", fire)?;
    let find: Value<'js> = given.get("find")?;
    ctx.globals().set(modules::FIND, find)?;
    Ok(given)
}

fn strict() -> EvalOptions {
    let mut options = EvalOptions::default();
    options.strict = true;
    options.filename = Some(FILE.to_owned());
    options
}

/// Starts the code in the first form in which it can be read: an expression, such as a function, which is then called;
/// the body of a function, as mindcraft has it; a module.
///
/// # Errors
/// Returns why it cannot be read in any form, in which case none of it was run.
fn start<'js>(ctx: &Ctx<'js>, given: &Object<'js>, code: &str, host: &Rc<RefCell<Host>>) -> Result<(), CodeError> {
    let failed = |error: rquickjs::Error| told(CaughtError::from_error(ctx, error));
    // Defining a function runs nothing, so the only errors are those of reading.
    let defined = |text: String| ctx.eval_with_options::<Function<'js>, _>(text, strict()).catch(ctx);
    let run: Function<'js> = given.get("run").map_err(failed)?;
    let expression = code.trim_end().trim_end_matches(';').trim_end();
    if let Ok(make) = defined(format!("(async function () {{ return ({expression}\n) }})")) {
        return run.call::<_, ()>((make, true)).map_err(failed);
    }
    let body = |code: &str| format!("(async (bot) => {{{code}\n}})");
    let refused = match defined(body(&answer::rewritten(code))) {
        Ok(make) => return run.call::<_, ()>((make, false)).map_err(failed),
        Err(error) => error,
    };
    if let Ok(make) = defined(body(code)) {
        let note =
            "mindcraft would have failed on this code: it adds a check after each line that ends with a semicolon";
        host.borrow_mut().note(note.to_owned());
        return run.call::<_, ()>((make, false)).map_err(failed);
    }
    match Module::declare(ctx.clone(), FILE, code).catch(ctx) {
        Ok(module) => {
            let evaluated = module.eval().catch(ctx);
            let (module, promise) = evaluated.map_err(told)?;
            host.borrow_mut().note("the code was run as a module, which mindcraft refuses".to_owned());
            let exports = module.namespace().map_err(failed)?;
            let run_module: Function<'js> = given.get("runModule").map_err(failed)?;
            run_module.call::<_, ()>((promise, exports)).map_err(failed)
        }
        // Of two readings that fail, the one for which the code was written tells more.
        Err(error) if has_module_words(code) && is_parse_error(&error) => Err(told(error)),
        Err(_) => Err(told(refused)),
    }
}

fn has_module_words(code: &str) -> bool {
    code.lines().any(|line| {
        let line = line.trim_start();
        line.starts_with("import ") || line.starts_with("export ") || line.starts_with("import{")
    })
}

/// Calls what the code only defined: what it exports, or the function that is its last value. Returns whether there was
/// one.
fn call_unused<'js>(
    ctx: &Ctx<'js>,
    given: &Object<'js>,
    code: &str,
    host: &Rc<RefCell<Host>>,
) -> rquickjs::Result<bool> {
    let call: Function<'js> = given.get("callUnused")?;
    let module: Object<'js> = given.get("module")?;
    if call.call((module.get::<_, Value<'js>>("exports")?,))? {
        return Ok(true);
    }
    if !code.contains("=>") && !code.contains("function") {
        return Ok(false);
    }
    let printed = host.borrow().log.len();
    let value = ctx.eval_with_options::<Value<'js>, _>(code, strict());
    host.borrow_mut().log.truncate(printed);
    let Ok(value) = value else {
        ctx.catch();
        return Ok(false);
    };
    call.call((value,))
}

#[cfg(test)]
mod tests;

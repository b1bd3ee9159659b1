//! The profile `mindcraft`: code acts in a world as a bot of the mindcraft framework does with cheats on
//! (`docs/rules.md#mindcraft`).
//!
//! `answer` finds the code in an answer, `js` holds what the code is given, `host` is the world behind it, which it
//! reaches through `bindings`. `hints` tells authors of code that built nothing why. `recording` turns changes of the
//! world into events, and `naming` makes errors name the function that is meant.

mod answer;
mod bindings;
mod hints;
mod host;
mod modules;
mod naming;
mod recording;

pub use host::{AFTERWARDS_MS, MAX_NOTES, NOTE_CHARS};

use std::cell::RefCell;
use std::rc::Rc;

use rquickjs::context::EvalOptions;
use rquickjs::{CatchResultExt as _, CaughtError, Ctx, Function, Module, Object, Persistent, Value};

use super::in_file;
use super::job::{Answer, Job, TurnInput};
use super::memory::PeakMemory;
use super::sandbox::{self, FILE, Fire, Sandbox, Watch, cpu_ms, told};
use super::{ActionLimits, CodeError, Dropped, LimitReached, Replayed, null_noted, without_null};
use answer::Reading;
use host::{Host, Told};
use plumbline_engine::intake::text::why_no_answer;
use plumbline_engine::text::counted;
use recording::{apply, record, state_of, world_of};

/// Greatest number of errors that a turn tells.
pub const MAX_ERRORS: usize = 20;

/// Stack of the engine, in bytes: models write recursive functions.
pub const STACK_BYTES: usize = 4 << 20;

/// The JavaScript of the profile, by the name under which `main.js` finds it.
const PARTS: [(&str, &str); 5] = [
    ("vec3", include_str!("js/vec3.js")),
    ("data", include_str!("js/data.js")),
    ("bot", include_str!("js/bot.js")),
    ("skills", include_str!("js/skills.js")),
    ("world", include_str!("js/world.js")),
];

/// An engine with everything that code is given, made before the code is there.
pub struct Prepared {
    // What belongs to the engine is dropped before it.
    given: Persistent<Object<'static>>,
    fire: Fire,
    host: Rc<RefCell<Host>>,
    sandbox: Sandbox,
}

impl Prepared {
    /// Makes an engine for a first file.
    ///
    /// # Errors
    /// Returns an error if the engine cannot be made.
    pub fn new(limits: &ActionLimits) -> Result<Self, CodeError> {
        Self::with(Rc::new(RefCell::new(Host::default())), limits)
    }

    fn with(host: Rc<RefCell<Host>>, limits: &ActionLimits) -> Result<Self, CodeError> {
        let sandbox = Sandbox::new(&ActionLimits { stack_bytes: STACK_BYTES, ..*limits })?;
        sandbox.runtime().set_loader(modules::Names, modules::Provided);
        let (given, fire) = sandbox.context.with(|ctx| {
            let failed = |error| told(CaughtError::from_error(&ctx, error));
            let given = given(&ctx, &host, &sandbox.watch).map_err(failed)?;
            let fire: Function<'_> = given.get("fire").map_err(failed)?;
            Ok::<_, CodeError>((Persistent::save(&ctx, given), Persistent::save(&ctx, fire)))
        })?;
        Ok(Self { given, fire, host, sandbox })
    }
}

/// Replays the turns of a job in one world. `first` is the engine of the first file.
pub fn run(job: &Job, limits: &ActionLimits, peak: &PeakMemory, first: Prepared) -> Answer {
    let end_cpu_ms = cpu_ms() + limits.cpu_ms;
    let host = Rc::clone(&first.host);
    let mut first = Some(first);
    host.borrow_mut().world = world_of(job.start.as_ref(), limits);
    host.borrow_mut().held = job.start.as_ref().and_then(|start| start.held.clone());
    let mut turns = Vec::with_capacity(job.turns.len());
    let mut seen = 0;
    for turn in &job.turns {
        let mut replayed = match turn {
            TurnInput::Events(events) => {
                apply(&mut host.borrow_mut().world, events);
                Replayed::default()
            }
            TurnInput::Code(files) => run_files(files, &host, limits, end_cpu_ms, peak, &mut first),
        };
        let mut host = host.borrow_mut();
        if matches!(turn, TurnInput::Code(_)) {
            record(&host.world.changes()[seen..], &mut replayed);
        }
        seen = host.world.changes().len();
        let Told { notes, dropped, log, .. } = std::mem::take(&mut host.told);
        replayed.notes.extend(notes);
        replayed.log.extend(log);
        let told = |(reason, count)| Dropped { reason: answer::with_suggestion(reason), count };
        replayed.dropped = dropped.into_iter().map(told).collect();
        let is_stopped = replayed.stopped.is_some();
        turns.push(replayed);
        if is_stopped {
            break;
        }
    }
    let end = state_of(&host.borrow());
    Answer { turns, end: Some(end), ..Answer::default() }
}

/// Runs the files of a turn one after another, each in an engine of its own and all in one world. An error ends its
/// file only.
fn run_files(
    files: &[String],
    host: &Rc<RefCell<Host>>,
    limits: &ActionLimits,
    end_cpu_ms: u64,
    peak: &PeakMemory,
    first: &mut Option<Prepared>,
) -> Replayed {
    let mut replayed = Replayed { unreadable: true, ..Replayed::default() };
    let mut errors: Vec<CodeError> = Vec::new();
    let at_first = host.borrow().world.changes().len();
    for (sent, number) in files.iter().zip(1..) {
        let before = host.borrow().world.changes().len();
        let notes_before = host.borrow().told.notes.len();
        let ended = match first.take().map_or_else(|| Prepared::with(Rc::clone(host), limits), Ok) {
            Ok(prepared) => run_file(sent, prepared, limits, end_cpu_ms, peak),
            Err(error) => Ended { errors: vec![error], ..Ended::default() },
        };
        host.borrow_mut().world.settle();
        let is_full = host.borrow().world.is_full();
        replayed.unreadable &= ended.unreadable;
        let file = (files.len() > 1).then_some(number);
        if file.is_some() {
            for note in host.borrow_mut().told.notes.iter_mut().skip(notes_before) {
                *note = in_file(number, note);
            }
        }
        let events = Some(host.borrow().world.changes().len() - at_first);
        errors.extend(ended.errors.into_iter().map(|error| CodeError { file, events, ..error }));
        if let Some(limit) = ended.stopped.or(is_full.then_some("events")) {
            let built = host.borrow().world.changes().len() - before;
            replayed.stopped = Some(LimitReached::of(limit, limits, &counted(built, "event")));
            break;
        }
    }
    if errors.len() > MAX_ERRORS {
        let more = counted(errors.len() - MAX_ERRORS, "further error");
        host.borrow_mut().note(&format!("{more} left out"));
    }
    errors.truncate(MAX_ERRORS);
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

fn run_file(sent: &str, prepared: Prepared, limits: &ActionLimits, end_cpu_ms: u64, peak: &PeakMemory) -> Ended {
    // What belongs to the engine is dropped before it, in the reverse order of these lines.
    let sandbox = prepared.sandbox;
    let (host, fire) = (prepared.host, prepared.fire);
    let given = prepared.given;
    let Reading { code, notes, mut if_it_fails } = answer::read(sent);
    for note in notes.iter().map(String::as_str).chain(null_noted(&code)) {
        host.borrow_mut().note(note);
    }
    let code = without_null(&code);
    let changes = host.borrow().world.changes().len();
    host.borrow_mut().done_at_ms = None;
    host.borrow_mut().missing = None;
    let mut ended = Ended::default();
    sandbox.watch.borrow_mut().end_cpu_ms = Some(end_cpu_ms);
    let started = sandbox.context.with(|ctx| {
        let failed = |error| told(CaughtError::from_error(&ctx, error));
        let given = given.clone().restore(&ctx).map_err(failed)?;
        let begin: Function<'_> = given.get("begin").map_err(failed)?;
        let now_ms = host.borrow().world.now_ms() as f64;
        begin.call::<_, ()>((now_ms,)).map_err(failed)?;
        start(&ctx, &given, &code, &host)
    });
    match started {
        Ok(()) => ended.errors.extend(sandbox.drive(&fire)),
        Err(error) => {
            ended.unreadable = !sandbox.is_stopped();
            let has_code =
                ["```", "skills.", "bot.", "=>", "function", ";", "("].iter().any(|word| sent.contains(word));
            let message = if has_code { error.message } else { "there is no code in the answer".to_owned() };
            if_it_fails = if_it_fails.filter(|_| has_code);
            ended.errors.push(CodeError { message, ..error });
            if let Some(why) = why_no_answer(sent).filter(|_| !has_code) {
                host.borrow_mut().note(&why);
            }
            if ended.unreadable && answer::is_json(&code) {
                host.borrow_mut().note(answer::JSON_IS_NO_CODE);
            } else if ended.unreadable && code.contains("```") {
                host.borrow_mut().note("everything from the first code fence to the last is code, also what stands between fences, as in mindcraft");
            }
        }
    }
    let is_idle = || host.borrow().world.changes().len() == changes && sandbox.watch.borrow().unheard.is_empty();
    if !ended.unreadable && ended.errors.is_empty() && is_idle() && !sandbox.is_stopped() {
        let is_called = sandbox.context.with(|ctx| {
            let given = given.restore(&ctx)?;
            call_unused(&ctx, &given, &code, &host)
        });
        if matches!(is_called, Ok(true)) {
            host.borrow_mut().done_at_ms = None;
            ended.errors.extend(sandbox.drive(&fire));
        }
        if is_idle() && !sandbox.is_stopped() {
            let is_json = answer::is_json(&code);
            let why = if is_json { answer::JSON_IS_NO_CODE.to_owned() } else { hints::idle(&code) };
            host.borrow_mut().note(&why);
        }
    }
    // The word "json" after a fence is read as "on", so a list in that fence fails where an object does nothing.
    let has_failed = !ended.errors.is_empty() || !sandbox.watch.borrow().unheard.is_empty();
    if !ended.unreadable && has_failed && answer::is_json(&code) {
        host.borrow_mut().note(answer::JSON_IS_NO_CODE);
    }
    let own = host.borrow().world.bytes();
    if sandbox.ran_out(limits, peak, own, ended.errors.first()) {
        sandbox.watch.borrow_mut().stopped.get_or_insert("memory");
    }
    let Watch { stopped, unheard, .. } = sandbox.watch.take();
    ended.stopped = stopped;
    ended.errors.extend(unheard.into_iter().map(|(_, error)| error));
    if stopped.is_some() {
        ended.errors.clear();
    } else if ended.errors.is_empty() && host.borrow().done_at_ms.is_none() {
        let message = "the code waits for something that never happens, so what follows was not run".to_owned();
        ended.errors.push(CodeError { message, line: None, column: None, file: None, events: None, is_own: false });
    }
    if let Some(told) = hints::second_parameter(&code, &ended.errors) {
        host.borrow_mut().note(&told);
    }
    let is_explained = !ended.errors.is_empty() && is_idle() && (ended.unreadable || sent.contains("```"));
    if let Some(told) = if_it_fails.filter(|_| is_explained) {
        host.borrow_mut().note(&told);
    }
    for error in &mut ended.errors {
        naming::name(error, &code, host.borrow().missing.as_ref());
        naming::suggest(error);
        naming::show_character(error, &code);
        // Columns are those of the rewritten code.
        error.column = None;
    }
    ended
}

/// Makes what the code is given, and sets its global names.
fn given<'js>(ctx: &Ctx<'js>, host: &Rc<RefCell<Host>>, watch: &Rc<RefCell<Watch>>) -> rquickjs::Result<Object<'js>> {
    let object = bindings::object(ctx, host, watch)?;
    let heard: Value<'js> = object.get("passTime")?;
    let clock = sandbox::clock(ctx, heard)?;
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
    // Defining a function runs nothing but what code does to break out of it, which is the code's own business.
    let defined = |text: String| ctx.eval_with_options::<Function<'js>, _>(text, strict()).catch(ctx);
    let run: Function<'js> = given.get("run").map_err(failed)?;
    let rewritten = answer::rewritten(code);
    let note_on_else = || {
        if let Some(line) = answer::else_of_check(code) {
            host.borrow_mut().note(&format!(
                "mindcraft adds a check after each line that ends with a semicolon, so the else in line {line} belongs to that \
                 check, and its branch runs in any case: put braces around both branches"
            ));
        }
    };
    for (code, is_rewritten) in [(rewritten.as_str(), true), (code, false)] {
        let expression = code.trim_end().trim_end_matches(';').trim_end();
        if let Ok(make) = defined(format!("(async function () {{ return ({expression}\n) }})")) {
            if is_rewritten {
                note_on_else();
            }
            return run.call::<_, ()>((make, true, code.contains("Code finished."))).map_err(failed);
        }
    }
    let body = |code: &str| format!("(async (bot) => {{{code}\n}})");
    let refused = match defined(body(&rewritten)) {
        Ok(make) => {
            note_on_else();
            return run.call::<_, ()>((make, false, false)).map_err(failed);
        }
        Err(error) => error,
    };
    if let Ok(make) = defined(body(code)) {
        let note =
            "mindcraft would have failed on this code: it adds a check after each line that ends with a semicolon";
        host.borrow_mut().note(note);
        return run.call::<_, ()>((make, false, false)).map_err(failed);
    }
    match Module::declare(ctx.clone(), FILE, code).catch(ctx) {
        Ok(module) => {
            let evaluated = module.eval().catch(ctx);
            let (module, promise) = evaluated.map_err(told)?;
            host.borrow_mut().note("the code was run as a module, which mindcraft refuses");
            let exports = module.namespace().map_err(failed)?;
            let run_module: Function<'js> = given.get("runModule").map_err(failed)?;
            run_module.call::<_, ()>((promise, exports)).map_err(failed)
        }
        Err(error) => {
            let of_module = told(error);
            // A module has no wrapper, so its errors are in the right place, but it does not allow `return`.
            let is_about_return = of_module.message.contains("return");
            Err(at_the_end(if is_about_return { told(refused) } else { of_module }, code))
        }
    }
}

/// Moves an error behind the last line of the code to that line: something is left open there.
fn at_the_end(error: CodeError, code: &str) -> CodeError {
    let lines = code.trim_end().lines().count();
    let is_behind = error.line.is_some_and(|line| line as usize > lines);
    if code.trim().is_empty() || !is_behind {
        return error;
    }
    let message = "SyntaxError: the code ends before everything that it opens is closed".to_owned();
    CodeError { message, line: u32::try_from(lines).ok(), ..error }
}

/// Calls what the code only defined: what it exports, or the function that is its last value. Returns whether there was
/// one.
fn call_unused<'js>(
    ctx: &Ctx<'js>,
    given: &Object<'js>,
    code: &str,
    host: &Rc<RefCell<Host>>,
) -> rquickjs::Result<bool> {
    let was_called: Function<'js> = given.get("wasCalled")?;
    if was_called.call(())? {
        return Ok(false);
    }
    let call: Function<'js> = given.get("callUnused")?;
    let module: Object<'js> = given.get("module")?;
    if call.call((module.get::<_, Value<'js>>("exports")?,))? {
        return Ok(true);
    }
    if !code.contains("=>") && !code.contains("function") {
        return Ok(false);
    }
    // The code runs again, only for its last value, so nothing that it tells counts.
    let told = host.borrow().told.clone();
    let value = ctx.eval_with_options::<Value<'js>, _>(code, strict());
    host.borrow_mut().told = told;
    let Ok(value) = value else {
        ctx.catch();
        return Ok(false);
    };
    call.call((value,))
}

#[cfg(test)]
mod tests;

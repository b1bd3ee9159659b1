//! The profile `published`: what a script places and removes is recorded as the published pipeline records it, against
//! stand-ins that see only air (`docs/rules.md#formats`).

mod integers;
mod script;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use rquickjs::context::EvalOptions;
use rquickjs::function::{Func, Opt, This};
use rquickjs::{CaughtError, Ctx, Function, Object, Persistent, Value};

use super::memory::PeakMemory;
use super::sandbox::{self, FILE, Sandbox, Watch, cpu_ms, is_parse_error, told};
use super::{ActionLimits, CodeError, Dropped, LimitReached, RecordedEvent, Replayed, null_noted, without_null};
use plumbline_engine::text::counted;
use plumbline_engine::voxel::cell;
use script::{Script, functions_of, nothing_recorded};

const PRELUDE: &str = include_str!("prelude.js");

/// Record of a script so far, and why it was stopped.
#[derive(Default)]
struct Recorder {
    /// Whether the script provided a main function, which was then called.
    has_main: bool,
    /// Names of functions that a script without a main function defines.
    functions: Vec<String>,
    /// Whether the script could not be parsed.
    unreadable: bool,
    palette: Vec<String>,
    index: BTreeMap<String, u32>,
    events: Vec<RecordedEvent>,
    dropped: BTreeMap<&'static str, u64>,
    /// Whether the script recorded more events than it may.
    is_full: bool,
}

impl Recorder {
    fn drop_call(&mut self, reason: &'static str) {
        *self.dropped.entry(reason).or_default() += 1;
    }

    fn record(&mut self, limits: &ActionLimits, material: Option<String>, cell: [Option<i64>; 3]) {
        let [Some(x), Some(y), Some(z)] = cell else { return self.drop_call("a coordinate is not an integer") };
        let most = i64::from(cell::MAX_HORIZONTAL);
        let is_in_world = (-most..=most).contains(&x)
            && (-most..=most).contains(&z)
            && (i64::from(cell::MIN_Y)..=i64::from(cell::MAX_Y)).contains(&y);
        if !is_in_world {
            return self.drop_call("the cell is out of range");
        }
        let material = match material {
            None => None,
            Some(name) if name.chars().count() > limits.material_chars => {
                return self.drop_call("the material's name is too long");
            }
            Some(name) if name.chars().any(char::is_control) => {
                return self.drop_call("the material's name has control characters");
            }
            Some(name) => match self.index.get(&name) {
                Some(index) => Some(*index),
                None if self.palette.len() >= limits.materials => {
                    return self.drop_call("too many different materials");
                }
                None => {
                    let index = u32::try_from(self.palette.len()).unwrap_or(u32::MAX);
                    self.palette.push(name.clone());
                    self.index.insert(name, index);
                    Some(index)
                }
            },
        };
        if self.events.len() >= limits.events {
            self.is_full = true;
            return;
        }
        self.events.push(RecordedEvent { cell: [x as i32, y as i32, z as i32], material });
    }
}

/// Runs a script to completion: its main function, then promises and timers until none is left.
pub fn run(code: &str, limits: &ActionLimits, peak: &PeakMemory) -> Replayed {
    let recorder = Rc::new(RefCell::new(Recorder::default()));
    let script = Script::of(&without_null(code));
    let sandbox = match Sandbox::new(limits) {
        Ok(sandbox) => sandbox,
        Err(error) => return Replayed { error: Some(error), ..Replayed::default() },
    };
    sandbox.watch.borrow_mut().end_cpu_ms = Some(cpu_ms() + limits.cpu_ms);
    let error = run_in(&sandbox, &script, limits, &recorder);
    let recorder = recorder.take();
    if sandbox.ran_out(limits, peak, recorder.bytes(), error.as_ref()) {
        sandbox.watch.borrow_mut().stopped.get_or_insert("memory");
    }
    let Watch { stopped, unheard, .. } = sandbox.watch.take();
    let events = recorder.events.len();
    let stopped = stopped.map(|limit| LimitReached::of(limit, limits, &counted(events, "event")));
    let dropped =
        recorder.dropped.into_iter().map(|(reason, count)| Dropped { reason: reason.to_owned(), count }).collect();
    let error_or_unheard = error.is_some() || !unheard.is_empty();
    let mut notes = if recorder.unreadable {
        script.hints(script.text.contains("await") && is_body_of_async(&sandbox, &script))
    } else {
        Vec::new()
    };
    notes.extend(null_noted(code).map(str::to_owned));
    if events == 0 && !error_or_unheard && stopped.is_none() {
        notes.push(nothing_recorded(recorder.has_main, &recorder.functions));
    }
    let unheard = unheard.into_iter().next().map(|(_, error)| error);
    Replayed {
        palette: recorder.palette,
        events: recorder.events,
        dropped,
        // Stopping at a limit is not an error of the script.
        error: if stopped.is_some() { None } else { error.or(unheard) },
        stopped,
        notes,
        unreadable: recorder.unreadable,
        ..Replayed::default()
    }
}

/// Time for reading a script once more as a body, in milliseconds.
const READ_AGAIN_MS: u64 = 50;

/// Returns whether a script that could not be read can be read as the body of an async function. What it did is known by
/// then, so it does not matter if a text that ends the function runs.
fn is_body_of_async(sandbox: &Sandbox, script: &Script) -> bool {
    sandbox.watch.borrow_mut().end_cpu_ms = Some(cpu_ms() + READ_AGAIN_MS);
    let body = format!("(async () => {{\n{}\n}})", script.text);
    sandbox.context.with(|ctx| {
        let is_read = ctx.eval::<Value<'_>, _>(body).is_ok();
        // An exception that nobody takes would stay.
        ctx.catch();
        is_read
    })
}

impl Recorder {
    /// Returns the memory that events and names take, which are stored outside of the engine.
    fn bytes(&self) -> usize {
        self.events.capacity() * size_of::<RecordedEvent>() + self.palette.iter().map(String::len).sum::<usize>()
    }
}

fn run_in(
    sandbox: &Sandbox,
    script: &Script,
    limits: &ActionLimits,
    recorder: &Rc<RefCell<Recorder>>,
) -> Option<CodeError> {
    let begun = sandbox.context.with(|ctx| match begin(&ctx, script, limits, recorder, &sandbox.watch) {
        Ok(fire) => Ok(Persistent::save(&ctx, fire)),
        Err(error) => Err(error),
    });
    match begun {
        Ok(fire) => sandbox.drive(&fire),
        Err((Some(fire), error)) => {
            sandbox.drive(&fire);
            Some(error)
        }
        Err((None, error)) => Some(error),
    }
}

/// Function that fires timers; if the script failed at once, the error, with that function if there is one.
type Begun<'js> = Result<Function<'js>, (Option<Persistent<Function<'static>>>, CodeError)>;

fn begin<'js>(
    ctx: &Ctx<'js>,
    script: &Script,
    limits: &ActionLimits,
    recorder: &Rc<RefCell<Recorder>>,
    watch: &Rc<RefCell<Watch>>,
) -> Begun<'js> {
    let fail = |error: rquickjs::Error| (None, told(CaughtError::from_error(ctx, error)));
    let (recording, watch, limits) = (Rc::clone(recorder), Rc::clone(watch), *limits);
    let record =
        Func::from(move |is_placed: bool, name: Value<'_>, x: Opt<Value<'_>>, y: Opt<Value<'_>>, z: Opt<Value<'_>>| {
            let cell = [coordinate(&x), coordinate(&y), coordinate(&z)];
            let Ok(mut recorder) = recording.try_borrow_mut() else { return };
            match is_placed.then(|| material(&name)) {
                None => recorder.record(&limits, None, cell),
                Some(Some(name)) => recorder.record(&limits, Some(name), cell),
                Some(None) => recorder.drop_call("the material is not a name"),
            }
            if recorder.is_full {
                watch.borrow_mut().stopped.get_or_insert("events");
            }
        });
    let prelude: Function<'js> = ctx.eval(PRELUDE).map_err(fail)?;
    let clock = sandbox::clock(ctx, ctx.eval("() => {}").map_err(fail)?).map_err(fail)?;
    let fire: Function<'js> = clock.get("fire").map_err(fail)?;
    let given: Object<'js> = prelude.call((record, clock)).map_err(fail)?;
    let run = || -> rquickjs::Result<()> {
        let mut options = EvalOptions::default();
        options.strict = false;
        options.filename = Some(FILE.to_owned());
        let value: Value<'js> = ctx.eval_with_options(script.text.as_str(), options)?;
        let module: Object<'js> = given.get("module")?;
        let bot: Value<'js> = given.get("bot")?;
        for candidate in [value, module.get("exports")?] {
            // If it returns a promise that is rejected and not handled, that is reported like any other.
            if let Some(main) = candidate.as_function() {
                recorder.borrow_mut().has_main = true;
                main.call::<_, Value<'js>>((bot,))?;
                return Ok(());
            }
            if let Some(object) = candidate.as_object()
                && let Some(main) = object.get::<_, Value<'js>>("default")?.into_function()
            {
                recorder.borrow_mut().has_main = true;
                main.call::<_, Value<'js>>((This(object.clone()), bot))?;
                return Ok(());
            }
        }
        if recorder.borrow().events.is_empty() {
            let functions = functions_of(ctx, &script.text);
            recorder.borrow_mut().functions = functions;
        }
        Ok(())
    };
    match run() {
        Ok(()) => Ok(fire),
        Err(error) => {
            let caught = CaughtError::from_error(ctx, error);
            recorder.borrow_mut().unreadable = is_parse_error(&caught);
            let told = told(caught);
            Err((Some(Persistent::save(ctx, fire)), told))
        }
    }
}

/// Reads a coordinate from a number or its text, without calling into the script's own objects.
fn coordinate(value: &Opt<Value<'_>>) -> Option<i64> {
    let value = value.0.as_ref()?;
    if let Some(number) = value.as_number() {
        return integers::of_number(number);
    }
    integers::of_text(&value.as_string()?.to_string().ok()?)
}

/// Reads a material's name; a missing one gets the name that the published pipeline gives it.
fn material(value: &Value<'_>) -> Option<String> {
    if value.is_undefined() {
        return Some("unknown".to_owned());
    }
    if value.is_null() {
        return Some("None".to_owned());
    }
    if let Some(number) = value.as_number() {
        return Some(number.to_string());
    }
    value.as_string()?.to_string().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actions::ACTION_LIMITS;

    fn ran(code: &str) -> Replayed {
        run(code, &ACTION_LIMITS, &PeakMemory::unknown())
    }

    fn error_of(code: &str) -> Option<String> {
        ran(code).error.map(|error| error.message)
    }

    #[test]
    fn a_rejection_that_is_handled_later_leaves_the_others() {
        let handled = |which: &str| {
            format!(
                "(async () => {{ const a = Promise.reject(new Error('first')), b = Promise.reject(new Error('second'));
                   await skills.wait(bot, 1); {which}.catch(() => {{}}); }})"
            )
        };
        assert_eq!(error_of(&handled("a")).as_deref(), Some("Error: second"));
        assert_eq!(error_of(&handled("b")).as_deref(), Some("Error: first"));
        assert_eq!(error_of(&handled("a.catch(() => {}); b")), None);
    }

    #[test]
    fn exported_expressions_are_called_and_declarations_only_defined() {
        let place = "{ skills.placeBlock(bot, 'stone', 1, 0, 0); }";
        for (head, end) in [("async (bot) =>", ""), ("(bot) =>", ""), ("(function (bot)", ")")] {
            let done = ran(&format!("export default {head} {place}{end}"));
            assert_eq!((done.events.len(), done.error), (1, None), "{head}");
        }
        for head in ["function build(bot)", "async function build(bot)"] {
            let done = ran(&format!("export default {head} {place}"));
            assert_eq!((done.events.len(), done.error), (0, None), "{head}");
            assert!(done.notes.iter().any(|note| note.contains("build(bot)")), "{:?}", done.notes);
        }
        let done = ran(&format!("export default function (bot) {place}"));
        assert!(done.unreadable && done.notes.iter().any(|note| note.contains("without a name")), "{done:?}");
        let done = ran(&format!("// export default\nexport default (bot) => {place}"));
        assert!(done.unreadable, "only the first is taken out: {done:?}");
        let error = ran("export default (bot) => { nothing() }").error.unwrap();
        assert_eq!((error.line, error.column), (Some(1), Some(27)), "{error:?}");
        let done = ran("import fs from 'fs'; export default (bot) => {}");
        assert!(done.unreadable && done.notes.iter().any(|note| note.contains("not as a module")), "{done:?}");
    }

    #[test]
    fn deep_recursion_is_an_error_and_no_limit_on_memory() {
        let too_deep = Some("RangeError: Maximum call stack size exceeded");
        for code in [
            "const f = () => f() + 1; f()",
            "(async (bot) => { const f = async () => { await f(); }; await f(); })",
            "eval('['.repeat(500000))",
        ] {
            let done = ran(code);
            assert_eq!(
                (done.error.as_ref().map(|error| error.message.as_str()), done.stopped),
                (too_deep, None),
                "{code}"
            );
        }
    }

    #[test]
    fn the_hint_on_await_is_given_where_it_helps() {
        let is_hinted = |code: &str| {
            let done = run(code, &ACTION_LIMITS, &PeakMemory::unknown());
            assert!(done.unreadable && done.events.is_empty(), "{code}: {done:?}");
            done.notes.iter().any(|note| note.contains("async functions"))
        };
        assert!(is_hinted("await skills.placeBlock(bot, 'stone', 0, 0, 0);"));
        assert!(is_hinted("async function build(bot) {}\nawait build(bot);"));
        for code in [
            "for (let y = 0; y < 5; y++ { await skills.placeBlock(bot, 'stone', 0, y, 0); }",
            "for (let y = 0; y &lt; 5; y++) { await skills.placeBlock(bot, 'stone', 0, y, 0); }",
            "const n: number = 5; await skills.placeBlock(bot, 'stone', 0, 0, 0);",
            // A text that ends the function is not stopped by its time alone.
            "}); while (true) {} (async () => { await",
        ] {
            assert!(!is_hinted(code), "{code}");
        }
    }
}

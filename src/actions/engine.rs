//! Runs action code in QuickJS under the limits that the engine can enforce; the operating system enforces the others.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::rc::Rc;

use rquickjs::context::{EvalOptions, intrinsic};
use rquickjs::function::{Func, Opt, This};
use rquickjs::{CaughtError, Context, Ctx, Function, Object, Runtime, Value};
use rustix::time::{ClockId, clock_gettime};

use super::memory::PeakMemory;
use super::script::{Script, functions_of, nothing_recorded};
use super::{ActionLimits, CodeError, Dropped, LimitReached, RecordedEvent, Replayed, integers};
use plumbline_engine::text::counted;
use plumbline_engine::voxel::cell;

const PRELUDE: &str = include_str!("prelude.js");
/// File name of the code in stack traces.
const FILE: &str = "action.js";
/// Stack size of the engine, in bytes.
const STACK_BYTES: usize = 512 << 10;

type Intrinsics = (
    intrinsic::Date,
    intrinsic::Eval,
    intrinsic::RegExpCompiler,
    intrinsic::RegExp,
    intrinsic::Json,
    intrinsic::Proxy,
    intrinsic::MapSet,
    intrinsic::TypedArrays,
    intrinsic::Promise,
);

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
    /// Errors of rejected promises that have no handler so far, each with the identity of its promise.
    unheard: Vec<(u64, CodeError)>,
    stopped: Option<&'static str>,
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
            self.stopped.get_or_insert("events");
            return;
        }
        self.events.push(RecordedEvent { cell: [x as i32, y as i32, z as i32], material });
    }
}

/// Returns the processor time that this process has used, in milliseconds.
fn cpu_ms() -> u64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as u64 * 1_000 + time.tv_nsec as u64 / 1_000_000
}

/// Runs a script to completion: its main function, then promises and timers until none is left.
pub fn run(code: &str, limits: &ActionLimits, peak: &PeakMemory) -> Replayed {
    let recorder = Rc::new(RefCell::new(Recorder::default()));
    let script = Script::of(code);
    let error = run_with(&script, limits, &recorder);
    let mut recorder = recorder.take();
    if recorder.ran_out(limits, peak, error.as_ref()) {
        recorder.stopped.get_or_insert("memory");
    }
    let events = recorder.events.len();
    let detail = |what: String| format!("{what}; {} recorded before", counted(events, "event"));
    let stopped = recorder.stopped.map(|limit| LimitReached {
        limit: limit.to_owned(),
        detail: detail(match limit {
            "events" => format!("more than {} events", limits.events),
            "memory" => format!("more than {} bytes of memory", limits.memory_bytes),
            _ => format!("more than {} ms of processor time", limits.cpu_ms),
        }),
    });
    let dropped =
        recorder.dropped.into_iter().map(|(reason, count)| Dropped { reason: reason.to_owned(), count }).collect();
    let error_or_unheard = error.is_some() || !recorder.unheard.is_empty();
    let mut notes = if recorder.unreadable { script.hints() } else { Vec::new() };
    if events == 0 && !error_or_unheard && stopped.is_none() {
        notes.push(nothing_recorded(recorder.has_main, &recorder.functions));
    }
    let unheard = recorder.unheard.into_iter().next().map(|(_, error)| error);
    Replayed {
        palette: recorder.palette,
        events: recorder.events,
        dropped,
        // Stopping at a limit is not an error of the script.
        error: if stopped.is_some() { None } else { error.or(unheard) },
        stopped,
        notes,
        unreadable: recorder.unreadable,
    }
}

impl Recorder {
    /// Returns whether memory ran out, even if the script caught the error and went on: what it did next depends on how
    /// much memory there was.
    fn ran_out(&self, limits: &ActionLimits, peak: &PeakMemory, error: Option<&CodeError>) -> bool {
        // Events and names are stored outside the engine.
        let own =
            self.events.capacity() * size_of::<RecordedEvent>() + self.palette.iter().map(String::len).sum::<usize>();
        let grown = (peak.grown_by() as usize).saturating_sub(own);
        let most = limits.memory_bytes;
        let is_so = |error: &CodeError| match error.message.as_str() {
            "InternalError: out of memory" => true,
            // The engine throws null if there is no memory left for the error.
            "thrown: null" => grown >= most / 4,
            _ => false,
        };
        error.into_iter().chain(self.unheard.iter().map(|(_, error)| error)).any(is_so) || grown >= most - most / 10
    }
}

fn run_with(script: &Script, limits: &ActionLimits, recorder: &Rc<RefCell<Recorder>>) -> Option<CodeError> {
    let internal = |what: &str| Some(CodeError { message: format!("InternalError: {what}"), line: None, column: None });
    let Ok(runtime) = Runtime::new() else { return internal("no engine") };
    runtime.set_memory_limit(limits.memory_bytes);
    runtime.set_max_stack_size(STACK_BYTES);
    let (watched, end) = (Rc::clone(recorder), cpu_ms() + limits.cpu_ms);
    // Once stopped, the handler keeps interrupting: an interrupt inside a promise is just another rejection.
    runtime.set_interrupt_handler(Some(Box::new(move || {
        let Ok(mut recorder) = watched.try_borrow_mut() else { return false };
        if recorder.stopped.is_none() && cpu_ms() >= end {
            recorder.stopped = Some("time");
        }
        recorder.stopped.is_some()
    })));
    let heard = Rc::clone(recorder);
    runtime.set_host_promise_rejection_tracker(Some(Box::new(move |_ctx, promise, reason, is_handled| {
        let (identity, told) = (identity(&promise), told(CaughtError::Value(reason)));
        if let Ok(mut recorder) = heard.try_borrow_mut() {
            if !is_handled {
                recorder.unheard.push((identity, told));
            } else if let Some(at) = recorder.unheard.iter().rposition(|(of, _)| *of == identity) {
                // A promise that is gone may have had the same identity before, but nothing can handle that one now.
                recorder.unheard.remove(at);
            }
        }
    })));
    let Ok(context) = Context::custom::<Intrinsics>(&runtime) else { return internal("no context") };
    let is_stopped = || recorder.borrow().stopped.is_some();
    let fire = context.with(|ctx| match begin(&ctx, script, limits, recorder) {
        Ok(fire) => Ok(rquickjs::Persistent::save(&ctx, fire)),
        Err(error) => Err(error),
    });
    let (fire, mut error) = match fire {
        Ok(fire) => (fire, None),
        Err((fire, error)) => (fire?, Some(error)),
    };
    loop {
        while !is_stopped() && matches!(runtime.execute_pending_job(), Ok(true) | Err(_)) && runtime.is_job_pending() {}
        if is_stopped() {
            break;
        }
        let fired = context.with(|ctx| {
            let fire = fire.clone().restore(&ctx).map_err(|e| told(CaughtError::Error(e)))?;
            fire.call::<_, bool>(()).map_err(|e| told(CaughtError::from_error(&ctx, e)))
        });
        match fired {
            Ok(true) => {}
            Ok(false) if runtime.is_job_pending() => {}
            Ok(false) => break,
            Err(thrown) => error = error.or(Some(thrown)),
        }
    }
    error
}

/// Function that fires timers; if the script failed at once, the error, with that function if there is one.
type Begun<'js> = Result<Function<'js>, (Option<rquickjs::Persistent<Function<'static>>>, CodeError)>;

fn begin<'js>(ctx: &Ctx<'js>, script: &Script, limits: &ActionLimits, recorder: &Rc<RefCell<Recorder>>) -> Begun<'js> {
    let fail = |error: rquickjs::Error| (None, told(CaughtError::from_error(ctx, error)));
    let (recording, limits) = (Rc::clone(recorder), *limits);
    let record =
        Func::from(move |is_placed: bool, name: Value<'_>, x: Opt<Value<'_>>, y: Opt<Value<'_>>, z: Opt<Value<'_>>| {
            let cell = [coordinate(&x), coordinate(&y), coordinate(&z)];
            let Ok(mut recorder) = recording.try_borrow_mut() else { return };
            match is_placed.then(|| material(&name)) {
                None => recorder.record(&limits, None, cell),
                Some(Some(name)) => recorder.record(&limits, Some(name), cell),
                Some(None) => recorder.drop_call("the material is not a name"),
            }
        });
    let prelude: Function<'js> = ctx.eval(PRELUDE).map_err(fail)?;
    let given: Object<'js> = prelude.call((record,)).map_err(fail)?;
    let fire: Function<'js> = given.get("fire").map_err(fail)?;
    let run = || -> rquickjs::Result<()> {
        let mut options = EvalOptions::default();
        options.strict = false;
        options.filename = Some(FILE.to_owned());
        let value: Value<'js> = ctx.eval_with_options(script.text.as_str(), options)?;
        let module: Object<'js> = given.get("module")?;
        let bot: Value<'js> = given.get("bot")?;
        let exported: Option<Value<'js>> = script.exported.as_ref().map(|name| ctx.globals().get(name)).transpose()?;
        for candidate in exported.into_iter().chain([value, module.get("exports")?]) {
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
            Err((Some(rquickjs::Persistent::save(ctx, fire)), told))
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

/// Returns whether an error means that the code is not JavaScript: nothing had been entered yet, not even the script
/// itself.
fn is_parse_error(error: &CaughtError<'_>) -> bool {
    let CaughtError::Exception(exception) = error else { return false };
    let text = |name: &str| exception.get::<_, String>(name).unwrap_or_default();
    text("name") == "SyntaxError" && !text("stack").contains('(')
}

/// Returns a number that tells an object from all others that live at the same time.
fn identity(object: &Value<'_>) -> u64 {
    // The hash of an object is that of its address, which is not accessible itself.
    let mut hasher = DefaultHasher::new();
    object.hash(&mut hasher);
    hasher.finish()
}

/// Converts an error into its message and its location in the code.
fn told(error: CaughtError<'_>) -> CodeError {
    const MOST: usize = 1_000;
    let (message, stack) = match error {
        CaughtError::Exception(exception) => {
            let name = exception.get::<_, String>("name").unwrap_or_else(|_| "Error".to_owned());
            let message = exception.get::<_, String>("message").unwrap_or_default();
            (format!("{name}: {message}"), exception.get::<_, String>("stack").unwrap_or_default())
        }
        CaughtError::Value(value) => match value.as_exception().cloned() {
            Some(exception) => return told(CaughtError::Exception(exception)),
            None => match value.as_string().and_then(|text| text.to_string().ok()) {
                Some(text) => (format!("thrown: {text}"), String::new()),
                None => (format!("thrown: {}", value.type_name()), String::new()),
            },
        },
        CaughtError::Error(error) => (error.to_string(), String::new()),
    };
    // The first location in the code itself: `… (action.js:12:34)`.
    let place = stack.split(&format!("{FILE}:")).nth(1).unwrap_or_default();
    let mut numbers = place.split(|c: char| !c.is_ascii_digit()).map(|digits| digits.parse::<u32>().ok());
    let (line, column) = (numbers.next().flatten(), numbers.next().flatten());
    CodeError { message: message.chars().take(MOST).collect(), line, column: column.filter(|_| line.is_some()) }
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
    fn an_exported_function_is_called_with_a_name_or_without() {
        let place = "{ skills.placeBlock(bot, 'stone', 1, 0, 0); }";
        for head in ["function (bot)", "function build(bot)", "async function(bot)", "async (bot) =>", "(bot) =>"] {
            let done = ran(&format!("export default {head} {place}"));
            assert_eq!((done.events.len(), done.error), (1, None), "{head}");
        }
        let error = ran("export default function (bot) { nothing() }").error.unwrap();
        assert_eq!((error.line, error.column), (Some(1), Some(33)), "{error:?}");
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
}

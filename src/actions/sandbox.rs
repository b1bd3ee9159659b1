//! QuickJS under the limits that an engine can enforce; the operating system enforces the others.

use std::cell::RefCell;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::rc::Rc;

use rquickjs::context::intrinsic;
use rquickjs::{CaughtError, Context, Ctx, Function, Object, Persistent, Runtime, Value};
use rustix::time::{ClockId, clock_gettime};

use super::memory::PeakMemory;
use super::{ActionLimits, CodeError};

/// File name of code in stack traces.
pub const FILE: &str = "action.js";
/// Greatest number of rejections without a handler that are kept.
const MAX_UNHEARD: usize = 500;
/// Greatest length of an error's message, in characters.
const MESSAGE_CHARS: usize = 1_000;

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

/// What happens while a script runs.
#[derive(Debug, Default)]
pub struct Watch {
    /// Processor time of this process at which the script is stopped, in milliseconds; none as long as no script runs.
    pub end_cpu_ms: Option<u64>,
    /// Limit at which the script was stopped.
    pub stopped: Option<&'static str>,
    /// Errors of rejected promises that have no handler so far, each with the identity of its promise.
    pub unheard: Vec<(u64, CodeError)>,
}

/// An engine for one script.
pub struct Sandbox {
    /// The engine's context.
    pub context: Context,
    /// What happened so far.
    pub watch: Rc<RefCell<Watch>>,
    runtime: Runtime,
}

/// Function that fires the next timer.
pub type Fire = Persistent<Function<'static>>;

/// Returns the processor time that this process has used, in milliseconds.
pub fn cpu_ms() -> u64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as u64 * 1_000 + time.tv_nsec as u64 / 1_000_000
}

impl Sandbox {
    /// Creates an engine that stops a script once the process has used the processor time that its watch names.
    ///
    /// # Errors
    /// Returns an error if the engine cannot be created.
    pub fn new(limits: &ActionLimits) -> Result<Self, CodeError> {
        let watch = Rc::new(RefCell::new(Watch::default()));
        let runtime = Runtime::new().map_err(|_| internal("no engine"))?;
        runtime.set_memory_limit(limits.memory_bytes);
        runtime.set_max_stack_size(limits.stack_bytes);
        let watched = Rc::clone(&watch);
        // Once stopped, the handler keeps interrupting: an interrupt inside a promise is just another rejection.
        runtime.set_interrupt_handler(Some(Box::new(move || {
            let Ok(mut watch) = watched.try_borrow_mut() else { return false };
            if watch.stopped.is_none() && watch.end_cpu_ms.is_some_and(|end| cpu_ms() >= end) {
                watch.stopped = Some("time");
            }
            watch.stopped.is_some()
        })));
        let heard = Rc::clone(&watch);
        runtime.set_host_promise_rejection_tracker(Some(Box::new(move |_ctx, promise, reason, is_handled| {
            let (identity, told) = (identity(&promise), told(CaughtError::Value(reason)));
            if let Ok(mut watch) = heard.try_borrow_mut() {
                if !is_handled {
                    if watch.unheard.len() < MAX_UNHEARD {
                        watch.unheard.push((identity, told));
                    }
                } else if let Some(at) = watch.unheard.iter().rposition(|(of, _)| *of == identity) {
                    // A promise that is gone may have had the same identity before, but nothing can handle that one
                    // now.
                    watch.unheard.remove(at);
                }
            }
        })));
        let context = Context::custom::<Intrinsics>(&runtime).map_err(|_| internal("no context"))?;
        Ok(Self { context, watch, runtime })
    }

    /// Returns the engine's runtime.
    pub fn runtime(&self) -> &Runtime {
        &self.runtime
    }

    /// Returns whether the script was stopped at a limit.
    pub fn is_stopped(&self) -> bool {
        self.watch.borrow().stopped.is_some()
    }

    /// Runs promises and timers until none is left or the script is stopped. Returns the first error of a timer.
    pub fn drive(&self, fire: &Fire) -> Option<CodeError> {
        let mut error = None;
        loop {
            while !self.is_stopped()
                && matches!(self.runtime.execute_pending_job(), Ok(true) | Err(_))
                && self.runtime.is_job_pending()
            {}
            if self.is_stopped() {
                break;
            }
            let fired = self.context.with(|ctx| {
                let fire = fire.clone().restore(&ctx).map_err(|e| told(CaughtError::Error(e)))?;
                fire.call::<_, bool>(()).map_err(|e| told(CaughtError::from_error(&ctx, e)))
            });
            match fired {
                Ok(true) => {}
                Ok(false) if self.runtime.is_job_pending() => {}
                Ok(false) => break,
                Err(thrown) => error = error.or(Some(thrown)),
            }
        }
        error
    }

    /// Returns whether memory ran out, even if the script caught the error and went on: what it did next depends on how
    /// much memory there was. `own_bytes` were used outside of the engine.
    pub fn ran_out(
        &self,
        limits: &ActionLimits,
        peak: &PeakMemory,
        own_bytes: usize,
        error: Option<&CodeError>,
    ) -> bool {
        let grown = (peak.grown_by() as usize).saturating_sub(own_bytes);
        let most = limits.memory_bytes;
        let is_so = |error: &CodeError| match error.message.as_str() {
            "InternalError: out of memory" => true,
            // The engine throws null if there is no memory left for the error.
            "thrown: null" => grown >= most / 4,
            _ => false,
        };
        error.into_iter().chain(self.watch.borrow().unheard.iter().map(|(_, error)| error)).any(is_so)
            || grown >= most - most / 10
    }
}

/// Describes a failure of the engine itself.
pub fn internal(what: &str) -> CodeError {
    CodeError {
        message: format!("InternalError: {what}"),
        line: None,
        column: None,
        file: None,
        events: None,
        is_own: false,
    }
}

/// Makes the clock of a script: an object with `fire`, `begin` and `wait`. `heard` is called with every time at which a
/// timer fires.
pub fn clock<'js>(ctx: &Ctx<'js>, heard: Value<'js>) -> rquickjs::Result<Object<'js>> {
    let make: Function<'js> = ctx.eval(include_str!("clock.js"))?;
    make.call((heard,))
}

/// Returns whether an error means that the code is not JavaScript: nothing had been entered yet, not even the script
/// itself.
pub fn is_parse_error(error: &CaughtError<'_>) -> bool {
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
pub fn told(error: CaughtError<'_>) -> CodeError {
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
    let is_own = stack.lines().next().is_some_and(|first| first.contains(FILE));
    // The first location in the code itself: `… (action.js:12:34)`.
    let place = stack.split(&format!("{FILE}:")).nth(1).unwrap_or_default();
    let mut numbers = place.split(|c: char| !c.is_ascii_digit()).map(|digits| digits.parse::<u32>().ok());
    let (line, column) = (numbers.next().flatten().filter(|line| *line > 0), numbers.next().flatten());
    CodeError {
        message: message.chars().take(MESSAGE_CHARS).collect(),
        line,
        column: column.filter(|_| line.is_some()),
        file: None,
        events: None,
        is_own,
    }
}

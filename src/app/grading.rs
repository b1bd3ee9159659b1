//! The single executor of gradings: enforces deadlines, stops on request, and catches panics, for the queue and for
//! requests.

use std::panic::{AssertUnwindSafe, catch_unwind};

use plumbline_engine::elasticity::{Control, Stopped};

/// Reason why a computation of the engine has no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unfinished {
    /// It was asked to stop, or reached its deadline.
    Stopped,
    /// It panicked: a failure of ours.
    Panicked,
}

/// Cores that a computation may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cores {
    /// The core that it runs on.
    One,
    /// The core that it runs on, and idle threads of the same pool.
    Idle,
}

/// Runs a computation of the engine on this thread until it is done, panics, or `is_over` says that it must end.
///
/// # Errors
/// Returns the reason if there is no result.
pub fn execute<T>(
    cores: Cores,
    is_over: &(dyn Fn() -> bool + Sync),
    compute: impl FnOnce(&Control<'_>) -> Result<T, Stopped>,
) -> Result<T, Unfinished> {
    let control = match cores {
        Cores::One => Control::until(is_over),
        Cores::Idle => Control { join: Some(&on_idle_threads), ..Control::until(is_over) },
    };
    // A grading that panics must not affect others.
    match catch_unwind(AssertUnwindSafe(|| compute(&control))) {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(Stopped)) => Err(Unfinished::Stopped),
        Err(_panic) => Err(Unfinished::Panicked),
    }
}

/// Runs two parts of a computation on idle threads of the pool that it runs in.
fn on_idle_threads(a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
    rayon::join(a, b);
}

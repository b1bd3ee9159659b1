//! Threads that yield to others.

/// Lets other threads of the process go before this one: its niceness, from 0 to 19.
pub fn yield_to_others(niceness: i32) {
    if let Err(error) = rustix::process::setpriority_process(None, niceness) {
        tracing::debug!(%error, "a thread has the same priority as others");
    }
}

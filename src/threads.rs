//! Priorities of threads.

/// Lets other threads of the process go before this one, by giving it a niceness from 0 to 19.
pub fn yield_to_others(niceness: i32) {
    if let Err(error) = rustix::process::setpriority_process(None, niceness) {
        tracing::debug!(%error, "could not lower the priority of a thread");
    }
}

//! Crash points at which a test has the process killed: before and after each commit. They do nothing in a release
//! build.

/// Kills the process with SIGKILL if the environment asks for it at this crash point, as in
/// `PLUMBLINE_TEST_KILL="before record"`. A number at the end means the nth time that the point is reached.
#[cfg(debug_assertions)]
pub(super) fn pass(side: &str, what: &str) {
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicU64, Ordering};

    static ASKED: LazyLock<Option<(String, u64)>> = LazyLock::new(|| {
        let asked = std::env::var("PLUMBLINE_TEST_KILL").ok()?;
        let numbered = asked.rsplit_once(' ').and_then(|(moment, n)| Some((moment.to_owned(), n.parse().ok()?)));
        Some(numbered.unwrap_or((asked, 1)))
    });
    static SEEN: AtomicU64 = AtomicU64::new(0);
    let Some((moment, time)) = &*ASKED else { return };
    if *moment == format!("{side} {what}") && SEEN.fetch_add(1, Ordering::Relaxed) + 1 == *time {
        // If killing fails, the test sees that the process is still alive.
        let _ = rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::KILL);
    }
}

/// Does nothing in a release build.
#[cfg(not(debug_assertions))]
pub(super) const fn pass(_side: &str, _what: &str) {}

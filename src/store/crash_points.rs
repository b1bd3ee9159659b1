//! Moments at which a test has the process killed: before and after each commit. Nothing in a release build.

/// Ends the process with SIGKILL where the environment asks for it at this moment, as in
/// `PLUMBLINE_TEST_KILL="before record"`; with a number in the end, when it comes by for that time.
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
        // Should it fail, the test sees that the process lives.
        let _ = rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::KILL);
    }
}

/// Nothing.
#[cfg(not(debug_assertions))]
pub(super) const fn pass(_side: &str, _what: &str) {}

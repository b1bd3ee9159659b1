//! The process of a service: logs, signals, and an orderly end.

use std::io::Write as _;
use std::process::ExitCode;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tokio::signal::unix::{SignalKind, signal};
use tokio::task::JoinHandle;

use crate::startup::{Config, RunningService};
use crate::telemetry::{self, LogFormat};

/// Returns the number of processors that the process may use.
pub fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

/// Writes a line to standard error. A service runs on where nobody can read it, as on a full disk.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Runs the work of a command on this thread.
///
/// # Errors
/// Returns the error of the work, or one if the runtime cannot be made.
pub fn block_on<T>(work: impl Future<Output = anyhow::Result<T>>) -> anyhow::Result<T> {
    tokio::runtime::Builder::new_current_thread().enable_all().build()?.block_on(work)
}

/// Runs a service until the process is asked to stop. Calls `begin` once it has started; the task that it returns ends
/// with the service.
///
/// # Errors
/// Returns an error if the service cannot start, or if `begin` fails.
pub fn run_until_stopped(
    config: &Config,
    log_format: LogFormat,
    begin: impl AsyncFnOnce(&RunningService) -> anyhow::Result<Option<JoinHandle<()>>>,
) -> anyhow::Result<ExitCode> {
    // Kept to the end: dropping the guard writes the remaining log lines.
    let _logs = telemetry::init_logs(log_format, "info");
    let metrics = telemetry::init_metrics()?;
    raise_open_files();
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        // From here on, signals are recorded, even while the service starts.
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        // `nohup` asks to go on.
        let mut hangup = if ignores_hangup() { None } else { Some(signal(SignalKind::hangup())?) };
        let service = RunningService::start(config, metrics).await?;
        let beside = begin(&service).await?;
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
            _ = async { hangup.as_mut().expect("the branch is off without it").recv().await }, if hangup.is_some() => {}
        }
        tracing::info!("stopping");
        if let Some(beside) = beside {
            beside.abort();
        }
        service.shut_down().await;
        Ok(ExitCode::SUCCESS)
    })
}

/// Returns whether the process was started with SIGHUP ignored.
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    // SIGHUP is the first signal.
    mask.is_some_and(|mask| mask & 1 != 0)
}

/// Raises the limit on open files to the maximum that the system allows. Each connection is an open file, and the usual
/// soft limit of 1,024 is lower than the number of connections that the service accepts.
fn raise_open_files() {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit { current: limit.maximum, maximum: limit.maximum };
    if let Err(error) = setrlimit(Resource::Nofile, raised) {
        tracing::warn!(%error, "could not raise the limit on open files");
    }
}

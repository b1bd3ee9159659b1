//! `plumbline serve`: the service, from one file.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tokio::signal::unix::{SignalKind, signal};

use crate::app::access::Openness;
use crate::app::limits::LIMITS;
use crate::http::HttpSettings;
use crate::http::middleware::rates::RateSettings;
use crate::startup::{Config, RunningService};
use crate::telemetry::{self, LogFormat};

/// Arguments of `serve`; each can be given in the environment too.
#[derive(Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of its own")]
pub struct ServeArgs {
    /// Where to listen.
    #[arg(long, env = "PLUMBLINE_LISTEN", value_name = "HOST:PORT", default_value = "127.0.0.1:7586")]
    listen: String,
    /// Where to listen for metrics and administration, which then are not on the first address.
    #[arg(long, env = "PLUMBLINE_ADMIN_LISTEN", value_name = "HOST:PORT")]
    admin_listen: Option<String>,
    /// Database file; made where it is missing.
    #[arg(long, env = "PLUMBLINE_DATABASE", default_value = "plumbline.db")]
    database: PathBuf,
    /// Submissions graded at the same time; by default one per processor.
    #[arg(long, env = "PLUMBLINE_WORKERS", value_parser = clap::value_parser!(u16).range(1..=1024))]
    workers: Option<u16>,
    /// Seconds after which the job of a worker that gives no sign of life is taken again.
    #[arg(long, env = "PLUMBLINE_LEASE_SECONDS", default_value_t = 15, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    lease_seconds: u64,
    /// Seconds between two times at which entries of open epochs are completed and receipts of hidden evaluation are published, at full
    /// multiples of it. The longer, the less can be learnt of how long answers took to grade.
    #[arg(long, env = "PLUMBLINE_HIDDEN_PUBLISH_SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    hidden_publish_seconds: u64,
    /// MiB of memory for results of /v1/grade, kept for the same log and task; 0 keeps none.
    #[arg(long, env = "PLUMBLINE_GRADE_CACHE_MIB", default_value_t = LIMITS.grade_cache_bytes >> 20, value_name = "MIB")]
    grade_cache_mib: usize,
    /// Requests a second with one key; 0: no limit.
    #[arg(long, env = "PLUMBLINE_RATE_PER_KEY", default_value_t = LIMITS.requests_per_second_per_key, value_name = "N")]
    rate_per_key: u32,
    /// Requests a second from one address without a key; 0: no limit. The defaults are more than two cores can answer: set
    /// them lower where strangers ask.
    #[arg(long, env = "PLUMBLINE_RATE_PER_ADDRESS", default_value_t = LIMITS.requests_per_second_per_address, value_name = "N")]
    rate_per_address: u32,
    /// Connections open at once from one address; more are closed. Lower it where strangers connect without a proxy in between.
    #[arg(long, env = "PLUMBLINE_CONNECTIONS_PER_ADDRESS", default_value_t = LIMITS.connections_per_address, value_name = "N")]
    connections_per_address: usize,
    /// Take the address of a client from the last entry of X-Forwarded-For, which the proxy in front writes.
    #[arg(long, env = "PLUMBLINE_BEHIND_PROXY")]
    behind_proxy: bool,
    /// Percent of a suite that a run must have answered, or skipped on purpose, to be compared on its board; others are listed apart.
    #[arg(long, env = "PLUMBLINE_BOARD_COVERAGE", default_value_t = 100, value_name = "PERCENT", value_parser = clap::value_parser!(u8).range(0..=100))]
    board_coverage: u8,
    /// How log lines are written.
    #[arg(long, env = "PLUMBLINE_LOG_FORMAT", value_enum, default_value_t = LogFormat::Text)]
    pub log_format: LogFormat,
    /// Let everybody write without a key: for a laptop, not for a network.
    #[arg(long, env = "PLUMBLINE_OPEN")]
    open: bool,
    /// Let everybody grade within a request without a key, of which nothing is stored: for trainers that can send no header. Everything
    /// else needs a key.
    #[arg(long, env = "PLUMBLINE_OPEN_GRADE")]
    open_grade: bool,
    /// Post three demo agents of different skill through the API, so that the board has rows.
    #[arg(long)]
    demo: bool,
}

/// Lets the process open as many files as the system allows it: a connection is one, and the usual first limit of 1,024
/// is less than the connections that the service takes.
fn raise_open_files() {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit { current: limit.maximum, maximum: limit.maximum };
    if let Err(error) = setrlimit(Resource::Nofile, raised) {
        tracing::warn!(%error, "could not raise the number of open files");
    }
}

/// Says where the service is and what it needs.
fn greet(args: &ServeArgs, app: &RunningService) {
    eprintln!("plumbline is at http://{}/ (API reference: /docs/); Ctrl-C stops it", app.address);
    if let Some(address) = app.admin_address {
        eprintln!("metrics and administration are at http://{address}/");
    }
    for notice in &app.notices {
        eprintln!("NOTE: {notice}");
    }
    if args.open {
        eprintln!("it is open: whoever reaches it may write, without a key");
        return;
    }
    if args.open_grade {
        eprintln!("whoever reaches it may grade (/v1/grade, /verify, /get_reward), without a key");
    }
    eprintln!("writing needs a key: plumbline keys create --name YOU --database {}", args.database.display());
}

/// Runs the command until the process is asked to stop.
///
/// # Errors
/// Where the service cannot start.
pub fn run(args: &ServeArgs) -> anyhow::Result<ExitCode> {
    // Kept to the end: what is still to be written then is written when it goes.
    let _logs = telemetry::init_logs(args.log_format, "info");
    let metrics = telemetry::init_metrics()?;
    raise_open_files();
    let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let config = Config {
        listen: args.listen.clone(),
        admin_listen: args.admin_listen.clone(),
        database: args.database.clone(),
        workers: args.workers.map_or(processors, usize::from),
        lease: Duration::from_secs(args.lease_seconds),
        hidden_publish: Duration::from_secs(args.hidden_publish_seconds),
        http: HttpSettings {
            grade_cache_bytes: args.grade_cache_mib << 20,
            open: match (args.open, args.open_grade) {
                (true, _) => Openness::Open,
                (false, true) => Openness::Grading,
                (false, false) => Openness::Keyed,
            },
            has_admin_listener: args.admin_listen.is_some(),
            least_coverage: f64::from(args.board_coverage) / 100.0,
            rates: RateSettings {
                per_key: args.rate_per_key,
                per_address: args.rate_per_address,
                is_behind_proxy: args.behind_proxy,
                connections_per_address: args.connections_per_address,
            },
        },
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        // From here on a signal is remembered, also while starting.
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let app = RunningService::start(&config, metrics).await?;
        // Whoever reads JSON reads the same in the log.
        if args.log_format == LogFormat::Text {
            greet(args, &app);
        }
        let mut demo = None;
        if args.demo {
            let key = if args.open { None } else { Some(app.demo_key().await?) };
            demo = Some(tokio::spawn(super::demo::run(format!("http://{}", app.address), key)));
        }
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        tracing::info!("stopping");
        if let Some(demo) = demo {
            demo.abort();
        }
        app.shut_down().await;
        Ok(ExitCode::SUCCESS)
    })
}

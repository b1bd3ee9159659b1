//! `plumbline work`: grades submissions, and serves nothing but probes and metrics.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::bail;
use clap::Args;

use super::database::{BlobArgs, DatabaseArgs, NoticeArgs};
use super::process::{processors, run_until_stopped, say};
use super::serve::MAX_PUBLISH_SECONDS;
use crate::app::access::Openness;
use crate::app::limits::LIMITS;
use crate::app::operator::Operator;
use crate::app::webhooks::WebhookSettings;
use crate::http::middleware::rates::RateSettings;
use crate::http::role::Role;
use crate::startup::{Config, ServiceSettings};
use crate::telemetry::LogFormat;

/// Arguments of `work`; each can also be set in the environment.
#[derive(Debug, Args)]
pub struct WorkArgs {
    /// Address to serve /healthz, /readyz and /metrics on.
    #[arg(long, env = "PLUMBLINE_WORK_LISTEN", value_name = "HOST:PORT", default_value = "127.0.0.1:7587")]
    listen: String,
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(flatten)]
    notices: NoticeArgs,
    #[command(flatten)]
    blobs: BlobArgs,
    /// Number of submissions graded at the same time; by default, one per processor; from 1 to 1,024.
    #[arg(long, env = "PLUMBLINE_WORKERS", value_parser = clap::value_parser!(u16).range(1..=1024))]
    workers: Option<u16>,
    /// Seconds after which a job is taken over from a worker that gives no sign of life, from 1 to 86,400.
    #[arg(long, env = "PLUMBLINE_LEASE_SECONDS", default_value_t = 15, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    lease_seconds: u64,
    /// Interval in seconds at which results of hidden evaluation are published; the same on all nodes.
    #[arg(long, env = "PLUMBLINE_HIDDEN_PUBLISH_SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=MAX_PUBLISH_SECONDS))]
    hidden_publish_seconds: u64,
    /// Format of log lines.
    #[arg(long, env = "PLUMBLINE_LOG_FORMAT", value_enum, default_value_t = LogFormat::Text)]
    pub log_format: LogFormat,
}

/// Runs the command until the process is asked to stop.
///
/// # Errors
/// Returns an error if the workers cannot start.
pub fn run(args: &WorkArgs) -> anyhow::Result<ExitCode> {
    if let Some(file) = args.database.database.file().filter(|file| !file.exists()) {
        bail!("there is no database {}; `plumbline serve` makes one, and `work` grades beside it", file.display());
    }
    let config = Config {
        listen: args.listen.clone(),
        admin_listen: None,
        database: args.database.database.clone(),
        secrets: args.database.secrets.clone(),
        blobs: args.blobs.blobs.clone(),
        role: Role::WorkOnly,
        workers: args.workers.map_or_else(processors, usize::from),
        cores: 1,
        follows_notices: !args.notices.no_notices,
        new_receipt_key: false,
        lease: Duration::from_secs(args.lease_seconds),
        hidden_publish: Duration::from_secs(args.hidden_publish_seconds),
        beacon_url: None,
        witnesses: Vec::new(),
        webhooks: WebhookSettings::default(),
        operator: Operator::default(),
        settings: ServiceSettings {
            grade_cache_bytes: 0,
            open: Openness::Keyed,
            least_coverage: 1.0,
            rates: RateSettings {
                per_key: LIMITS.requests_per_second_per_key,
                per_address: LIMITS.requests_per_second_per_address,
                is_behind_proxy: false,
                connections_per_address: LIMITS.connections_per_address,
            },
        },
    };
    run_until_stopped(&config, args.log_format, async |app| {
        if args.log_format == LogFormat::Text {
            say(&format!(
                "plumbline is at http://{}/ and grades submissions of {}; it serves probes and metrics",
                app.address, config.database
            ));
        }
        Ok(None)
    })
}

//! `plumbline serve`: runs the service.

use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use clap::builder::BoolishValueParser;

use super::database::{BlobArgs, DatabaseArgs, NoticeArgs};
use super::process::{processors, run_until_stopped, say};
use super::witness::witness_key;
use crate::app::access::Openness;
use crate::app::limits::LIMITS;
use crate::app::operator::{Contact, Operator};
use crate::app::webhooks::WebhookSettings;
use crate::http::middleware::rates::RateSettings;
use crate::http::role::Role;
use crate::startup::{Config, RunningService, ServiceSettings};
use crate::store::location::Location;
use crate::telemetry::LogFormat;
use plumbline_engine::hidden::tlog::cosignature::Witness;

/// Longest interval at which receipts of hidden evaluation are published, in seconds.
pub(super) const MAX_PUBLISH_SECONDS: u64 = 86_400;

/// Arguments of `serve`; each but `--demo` can also be set in the environment.
#[derive(Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of its own")]
pub struct ServeArgs {
    /// Address to listen on.
    #[arg(long, env = "PLUMBLINE_LISTEN", value_name = "HOST:PORT", default_value = "127.0.0.1:7586")]
    listen: String,
    /// Separate address for metrics and administration, which are then not served on the main address.
    #[arg(long, env = "PLUMBLINE_ADMIN_LISTEN", value_name = "HOST:PORT")]
    admin_listen: Option<String>,
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(flatten)]
    notices: NoticeArgs,
    #[command(flatten)]
    blobs: BlobArgs,
    /// Number of submissions graded at the same time; by default, one per processor; at most 1,024. With 0, other nodes
    /// grade (`plumbline work`).
    #[arg(long, env = "PLUMBLINE_WORKERS", value_parser = clap::value_parser!(u16).range(0..=1024))]
    workers: Option<u16>,
    /// Only grade within requests, without a database, also if one is named: for trainers behind a load balancer.
    /// Serves /v1/grade, /v1/grade:structure, /v1/grade:batch, /v1/replay, the trainers' routes and the catalogue, and
    /// asks for no key.
    #[arg(long, env = "PLUMBLINE_GRADE_ONLY", value_parser = BoolishValueParser::new(), conflicts_with = "demo")]
    grade_only: bool,
    /// Sign receipts with the key in the folder of secrets, or with a new one if it holds none, although receipts of
    /// this database were signed with another, which is lost. The log of receipts notes the change.
    #[arg(long)]
    new_receipt_key: bool,
    /// Seconds after which a job is taken over from a worker that gives no sign of life, from 1 to 86,400.
    #[arg(long, env = "PLUMBLINE_LEASE_SECONDS", default_value_t = 15, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    lease_seconds: u64,
    /// Interval in seconds at which entries of open epochs are completed and receipts of hidden evaluation are
    /// published, at full multiples of the interval. A longer interval reveals less about how long answers took to
    /// grade.
    #[arg(long, env = "PLUMBLINE_HIDDEN_PUBLISH_SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=MAX_PUBLISH_SECONDS))]
    hidden_publish_seconds: u64,
    /// Server of the public randomness beacon, such as <https://api.drand.sh>, from which the rounds that epochs are
    /// bound to are fetched. Without it, `plumbline epochs beacon` or anybody with `POST /v1/epochs/NAME/beacon` brings
    /// them.
    #[arg(long, env = "PLUMBLINE_BEACON_URL", value_name = "URL", value_parser = web_address)]
    beacon_url: Option<String>,
    /// Key of a witness of the transparency log, as `plumbline witness --name` prints it, whose cosignatures are taken
    /// and shown. May be given more than once.
    #[arg(long = "witness", env = "PLUMBLINE_WITNESSES", value_delimiter = ',', value_name = "KEY", value_parser = witness_key)]
    witnesses: Vec<Witness>,
    /// Memory in MiB to cache results of /v1/grade for the same log and task; 0 disables the cache.
    #[arg(long, env = "PLUMBLINE_GRADE_CACHE_MIB", default_value_t = LIMITS.grade_cache_bytes >> 20, value_name = "MIB")]
    grade_cache_mib: usize,
    /// Requests per second allowed with one key; 0 means no limit.
    #[arg(long, env = "PLUMBLINE_RATE_PER_KEY", default_value_t = LIMITS.requests_per_second_per_key, value_name = "N")]
    rate_per_key: u32,
    /// Requests per second allowed from one address without a key; 0 means no limit. The defaults are more than two
    /// cores can answer: lower them if the service is open to strangers.
    #[arg(long, env = "PLUMBLINE_RATE_PER_ADDRESS", default_value_t = LIMITS.requests_per_second_per_address, value_name = "N")]
    rate_per_address: u32,
    /// Connections allowed at once from one address; more are closed. 0 means no limit. Lower it if strangers connect
    /// without a proxy in front.
    #[arg(long, env = "PLUMBLINE_CONNECTIONS_PER_ADDRESS", default_value_t = LIMITS.connections_per_address, value_name = "N")]
    connections_per_address: usize,
    /// Take the client address from the last entry of X-Forwarded-For, which the proxy in front writes.
    #[arg(long, env = "PLUMBLINE_BEHIND_PROXY", value_parser = BoolishValueParser::new())]
    behind_proxy: bool,
    /// Percentage of a suite that a run must answer, or skip on purpose, to be compared on its board; other runs are
    /// listed apart.
    #[arg(long, env = "PLUMBLINE_BOARD_COVERAGE", default_value_t = 100, value_name = "PERCENT", value_parser = clap::value_parser!(u8).range(0..=100))]
    board_coverage: u8,
    /// Allow webhooks to lead to private addresses, such as this machine or its network, and to use http.
    #[arg(long, env = "PLUMBLINE_WEBHOOKS_TO_PRIVATE_ADDRESSES", value_parser = BoolishValueParser::new())]
    webhooks_to_private_addresses: bool,
    /// Pauses in seconds between the attempts to deliver a message to a webhook.
    #[arg(long, env = "PLUMBLINE_WEBHOOK_RETRY_SECONDS", value_delimiter = ',', value_name = "SECONDS,…", default_value = WebhookSettings::RETRY_TEXT)]
    webhook_retry_seconds: Vec<u64>,
    /// Who runs this service, as its pages tell readers: a person or an institution.
    #[arg(long, env = "PLUMBLINE_OPERATOR", value_name = "NAME")]
    operator: Option<String>,
    /// Email address, or address of a page, where readers reach the operator.
    #[arg(long, env = "PLUMBLINE_CONTACT", value_name = "ADDRESS", value_parser = Contact::read)]
    contact: Option<Contact>,
    /// Format of log lines.
    #[arg(long, env = "PLUMBLINE_LOG_FORMAT", value_enum, default_value_t = LogFormat::Text)]
    pub log_format: LogFormat,
    /// Allow everyone to write without a key: for a laptop, not for a network.
    #[arg(long, env = "PLUMBLINE_OPEN", value_parser = BoolishValueParser::new())]
    open: bool,
    /// Allow everyone to grade within a request, which stores nothing, without a key: for trainers that cannot send a
    /// header. All writing still needs a key.
    #[arg(long, env = "PLUMBLINE_OPEN_GRADE", value_parser = BoolishValueParser::new())]
    open_grade: bool,
    /// Post runs of three demo agents of different skill through the API, so that the boards have rows.
    #[arg(long)]
    demo: bool,
}

/// Prints the addresses of the service, and who needs a key.
fn greet(args: &ServeArgs, app: &RunningService) {
    say(&format!("plumbline is at http://{}/ (API reference: /docs/); Ctrl-C stops it", app.address));
    if let Some(address) = app.admin_address {
        say(&format!("metrics and administration are at http://{address}/"));
    }
    if args.grade_only {
        return;
    }
    if args.open {
        say("the service is open: anyone who can reach it may write without a key");
        return;
    }
    if args.open_grade {
        say("anyone who can reach it may grade (/v1/grade, /verify, /get_reward) without a key");
    }
    say(&format!("writing needs a key: plumbline keys create --name YOU --database {}", args.database.database));
}

/// Runs the command until the process is asked to stop.
///
/// # Errors
/// Returns an error if the service cannot start.
pub fn run(args: &ServeArgs) -> anyhow::Result<ExitCode> {
    let config = Config {
        listen: args.listen.clone(),
        admin_listen: args.admin_listen.clone(),
        role: if args.grade_only { Role::GradeOnly } else { Role::Whole },
        database: if args.grade_only { Location::Memory } else { args.database.database.clone() },
        secrets: args.database.secrets.clone(),
        blobs: args.blobs.blobs.clone(),
        workers: args.workers.map_or_else(processors, usize::from),
        cores: processors(),
        follows_notices: !args.notices.no_notices,
        new_receipt_key: args.new_receipt_key,
        lease: Duration::from_secs(args.lease_seconds),
        hidden_publish: Duration::from_secs(args.hidden_publish_seconds),
        beacon_url: args.beacon_url.clone(),
        witnesses: args.witnesses.clone(),
        webhooks: WebhookSettings {
            allows_private: args.webhooks_to_private_addresses,
            retries: args.webhook_retry_seconds.iter().copied().map(Duration::from_secs).collect(),
        },
        operator: Operator {
            name: args.operator.clone().filter(|name| !name.trim().is_empty()),
            contact: args.contact.clone(),
        },
        settings: ServiceSettings {
            grade_cache_bytes: args.grade_cache_mib << 20,
            open: match (args.open, args.open_grade || args.grade_only) {
                (true, _) => Openness::Open,
                (false, true) => Openness::Grading,
                (false, false) => Openness::Keyed,
            },
            least_coverage: f64::from(args.board_coverage) / 100.0,
            rates: RateSettings {
                per_key: args.rate_per_key,
                per_address: args.rate_per_address,
                is_behind_proxy: args.behind_proxy,
                connections_per_address: args.connections_per_address,
            },
        },
    };
    run_until_stopped(&config, args.log_format, async |app| {
        // JSON logs carry the same information in their own lines.
        if args.log_format == LogFormat::Text {
            greet(args, app);
        }
        if !args.demo {
            return Ok(None);
        }
        let key = if args.open { None } else { Some(app.demo_key().await?) };
        Ok(Some(tokio::spawn(super::demo::run(format!("http://{}", app.address), key))))
    })
}

/// Checks that a text is the address of a web server.
fn web_address(text: &str) -> Result<String, String> {
    let address =
        reqwest::Url::parse(text).ok().filter(|url| matches!(url.scheme(), "http" | "https") && url.has_host());
    address.map(|_| text.to_owned()).ok_or_else(|| "expected an address such as https://api.drand.sh".to_owned())
}

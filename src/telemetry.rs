//! Logs and metrics of the process.

use std::io::{IsTerminal as _, Write as _};

use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use tracing_appender::non_blocking::{NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;

/// Bucket bounds of the duration histograms, in seconds.
const SECONDS: &[f64] = &[0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];

/// Format of log lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// Text for people.
    Text,
    /// One JSON object per line, including panics and startup errors.
    Json,
}

/// Starts writing log lines to standard error from a dedicated thread. No request waits for the reader of the log: if
/// nobody reads, lines are lost, not requests. `RUST_LOG` overrides the filter; `RUST_LOG=info,plumbline::request=warn`
/// omits the line of each request. Dropping the guard writes the remaining lines.
pub fn init_logs(format: LogFormat, default_filter: &str) -> WorkerGuard {
    let asked = std::env::var(EnvFilter::DEFAULT_ENV).ok().filter(|filter| !filter.is_empty());
    let asked = asked.as_deref().map(EnvFilter::try_new).transpose();
    let (asked, fault) = asked.map_or_else(|error| (None, Some(error)), |filter| (filter, None));
    let filter = asked.unwrap_or_else(|| EnvFilter::new(default_filter));
    let is_off = filter.max_level_hint() == Some(LevelFilter::OFF);
    let (writer, guard) = NonBlockingBuilder::default().lossy(true).finish(std::io::stderr());
    let builder = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(writer)
        .with_ansi(std::io::stderr().is_terminal());
    // A second call, as in tests, keeps the first subscriber.
    let _ = match format {
        LogFormat::Text => builder.try_init(),
        LogFormat::Json => builder.json().flatten_event(true).try_init(),
    };
    if let Some(error) = fault {
        tracing::warn!(%error, "RUST_LOG is not a valid filter and is ignored; a filter has the form info,plumbline::request=warn");
    }
    if !is_off && !tracing::enabled!(tracing::Level::ERROR) {
        let message = "RUST_LOG hides errors of the service; a filter has the form info,plumbline::request=warn";
        let line = match format {
            LogFormat::Text => message.to_owned(),
            LogFormat::Json => serde_json::json!({ "level": "WARN", "message": message }).to_string(),
        };
        // The log would not take it, and nobody may read standard error.
        let _ = writeln!(std::io::stderr(), "{line}");
    }
    if format == LogFormat::Json {
        std::panic::set_hook(Box::new(|panic| {
            tracing::error!(
                place = panic.location().map(ToString::to_string),
                "{}",
                panic.payload_as_str().unwrap_or("panic")
            );
        }));
    }
    guard
}

/// Starts collecting metrics for the whole process and returns the handle that renders them.
///
/// # Errors
/// Returns an error if the process already collects metrics.
pub fn init_metrics() -> anyhow::Result<PrometheusHandle> {
    let builder = PrometheusBuilder::new().set_buckets_for_metric(Matcher::Suffix("_seconds".to_owned()), SECONDS)?;
    Ok(builder.install_recorder()?)
}

/// Counters that exist from the beginning. A counter that appears with its first event hides that event from whoever
/// watches its increase.
const FROM_ZERO: [&str; 6] = [
    "plumbline_graded_total",
    "plumbline_grader_errors_total",
    "plumbline_corrupt_rows_total",
    "plumbline_grade_refused_total",
    "plumbline_connections_refused_total",
    "plumbline_stress_fields_computed_total",
];

/// Describes every metric for readers, sets the constant `plumbline_build_info`, and begins the counters.
pub fn describe_metrics() {
    use metrics::{describe_counter, describe_gauge, describe_histogram};
    describe_counter!("plumbline_http_requests_total", "HTTP requests, by method, route and status");
    describe_histogram!(
        "plumbline_http_request_seconds",
        "Time from request to response in seconds, by route; without entries, instances and episodes, which may be hidden"
    );
    describe_counter!("plumbline_webhook_attempts_total", "Attempts to deliver to webhooks, by outcome");
    describe_counter!("plumbline_graded_total", "Submissions graded by the workers of this process");
    describe_histogram!("plumbline_grading_seconds", "Time that workers took to grade a submission, in seconds");
    describe_histogram!("plumbline_grade_seconds", "Time that grading within a request took, in seconds");
    describe_counter!("plumbline_grade_cache_total", "Grading requests, by whether the result was cached");
    describe_gauge!("plumbline_grade_cache_bytes", "Memory of cached results of grading requests, in bytes");
    describe_counter!("plumbline_grade_refused_total", "Grading requests refused because too many were waiting");
    describe_counter!(
        "plumbline_stress_fields_computed_total",
        "Stress fields computed because they were not in the cache"
    );
    describe_counter!("plumbline_connections_refused_total", "Connections closed because their address had too many");
    describe_counter!("plumbline_rate_limited_total", "Requests refused by rate limits, by what was counted");
    describe_counter!(
        "plumbline_corrupt_rows_total",
        "Stored rows and objects that could not be read back, but for answers to hidden instances"
    );
    describe_gauge!("plumbline_database_up", "1 if the database answered when the metrics were asked for, else 0");
    describe_gauge!("plumbline_ready", "1 if the node is ready as /readyz says, else 0, as when nothing can be stored");
    describe_gauge!("plumbline_lacks", "Number of things that a ready node lacks, as /readyz names them");
    describe_gauge!("plumbline_submissions_not_ended", "Submissions queued or being graded");
    describe_gauge!(
        "plumbline_oldest_submission_not_ended_seconds",
        "Age of the oldest submission queued or being graded, in seconds"
    );
    describe_gauge!("plumbline_workers", "Workers of this process");
    describe_gauge!("plumbline_workers_busy", "Workers that are grading");
    describe_counter!("plumbline_grader_errors_total", "Submissions that ended in a failure of the service");
    describe_histogram!("plumbline_accepted_together", "Submissions stored together in one transaction");
    describe_gauge!("plumbline_database_bytes", "Size of the database file and its write-ahead log, in bytes");
    describe_gauge!("plumbline_build_info", "Always 1; the labels hold the versions of the program and of its checks");
    let labels = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("checks_version", plumbline_engine::checks::CHECKS_VERSION.to_string()),
    ];
    metrics::gauge!("plumbline_build_info", &labels).set(1.0);
    for name in FROM_ZERO {
        metrics::counter!(name).increment(0);
    }
}

//! Logs and metrics of the process.

use std::io::IsTerminal as _;

use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use tracing_appender::non_blocking::{NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::EnvFilter;

/// Bounds of the duration histograms, in seconds.
const SECONDS: &[f64] = &[0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];

/// How log lines are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// For people.
    Text,
    /// One JSON object a line, panics and errors at the start too.
    Json,
}

/// Sends log lines to standard error, from a thread of its own: no request waits for whoever reads them, and where nobody does,
/// lines are lost and not requests. `RUST_LOG` overrides the filter; `RUST_LOG=info,plumbline::request=warn` leaves out the line of each
/// request. What is still to be written is written when the guard is dropped.
pub fn init_logs(format: LogFormat, default_filter: &str) -> WorkerGuard {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default_filter));
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

/// Collects metrics from here on, for the whole process, and gives the handle that renders them.
///
/// # Errors
/// Where the process collects metrics already.
pub fn init_metrics() -> anyhow::Result<PrometheusHandle> {
    let builder = PrometheusBuilder::new().set_buckets_for_metric(Matcher::Suffix("_seconds".to_owned()), SECONDS)?;
    Ok(builder.install_recorder()?)
}

/// What each metric says, for whoever reads them, and the one that never changes.
pub fn describe_metrics() {
    use metrics::{describe_counter, describe_gauge, describe_histogram};
    describe_counter!("plumbline_http_requests_total", "Requests, by method, route and status");
    describe_histogram!("plumbline_http_request_seconds", "Seconds from request to answer, by route");
    describe_counter!("plumbline_graded_total", "Submissions graded by the workers of this process");
    describe_histogram!("plumbline_grading_seconds", "Seconds that workers took to grade a submission");
    describe_histogram!("plumbline_grade_seconds", "Seconds that grading within a request took");
    describe_counter!("plumbline_grade_cache_total", "Requests to grade, by whether the result was kept from before");
    describe_gauge!("plumbline_grade_cache_bytes", "Memory of results kept for requests to grade, in bytes");
    describe_counter!("plumbline_grade_refused_total", "Requests to grade that were refused because too many waited");
    describe_counter!(
        "plumbline_stress_fields_computed_total",
        "Stress fields computed because nobody had asked for them lately"
    );
    describe_counter!("plumbline_connections_refused_total", "Connections closed because their address had too many");
    describe_counter!("plumbline_rate_limited_total", "Requests refused for their rate, by what was counted");
    describe_counter!("plumbline_corrupt_rows_total", "Stored rows that did not read back");
    describe_gauge!("plumbline_submissions_not_ended", "Submissions queued or being graded");
    describe_gauge!("plumbline_oldest_submission_not_ended_seconds", "Age of the oldest of them, in seconds");
    describe_gauge!("plumbline_workers", "Workers of this process");
    describe_gauge!("plumbline_workers_busy", "Workers that are grading");
    describe_counter!("plumbline_grader_errors_total", "Submissions that ended by a failure of ours");
    describe_histogram!("plumbline_accepted_together", "Submissions that were stored in one transaction");
    describe_gauge!("plumbline_database_bytes", "Size of the database file and its write-ahead log, in bytes");
    describe_gauge!("plumbline_build_info", "Always 1; the labels tell version and rules of the program");
    let labels = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("checks_version", plumbline_engine::checks::CHECKS_VERSION.to_string()),
    ];
    metrics::gauge!("plumbline_build_info", &labels).set(1.0);
}

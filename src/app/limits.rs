//! Every limit of the service, in one place: enforced where named, and served at `/v1/limits`.

use serde::Serialize;

use crate::actions::ACTION_LIMITS;
use crate::store::jobs::MAX_ATTEMPTS;
use plumbline_engine::checks::evidence::{MAX_CHARS, MAX_ITEMS};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::LogLimits;
use plumbline_engine::intake::text::WASTE_BYTES;
use plumbline_engine::voxel::cell;
use plumbline_engine::voxel::terrain::MAX_EXTENT;

/// The limits. Sizes are of the decompressed body.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
pub struct Limits {
    /// Bytes of a request body, after decompression.
    pub body_bytes: usize,
    /// Bytes of all bodies being read at the same time; a request beyond it is asked to come back (503).
    pub bodies_in_memory_bytes: usize,
    /// Levels of nested arrays and objects in a run's metadata; elsewhere nothing nests deeper than the formats say.
    pub json_depth: u32,
    /// Submissions in one NDJSON body.
    pub ndjson_lines: usize,
    /// Turns of a log.
    pub turns: usize,
    /// Events of a log, over all turns.
    pub events: usize,
    /// Blocks that stand after any turn.
    pub blocks: usize,
    /// The same for tasks with a stress check, and for stress fields.
    pub blocks_with_stress: usize,
    /// Stress fields computed at the same time for `/v1/submissions/{id}/stress`; more wait.
    pub stress_fields_at_once: usize,
    /// Stress fields computed at the same time for one sender: a key's owner, or an address.
    pub stress_fields_per_sender: usize,
    /// Requests that wait for one of them at the same time; more are asked to come back (503).
    pub stress_fields_waiting: usize,
    /// Of these, requests of one sender.
    pub stress_fields_waiting_per_sender: usize,
    /// Bytes of memory for stress fields that were computed.
    pub stress_cache_bytes: usize,
    /// Seconds that such a request waits before it is asked to come back (503).
    pub stress_wait_seconds: u64,
    /// Seconds that one of them may take.
    pub stress_seconds: u64,
    /// Distinct materials of a log.
    pub materials: usize,
    /// Characters of a material name.
    pub material_chars: usize,
    /// Greatest absolute x and z.
    pub horizontal: i32,
    /// Least y.
    pub min_y: i32,
    /// Greatest y.
    pub max_y: i32,
    /// Characters of an agent's name.
    pub agent_chars: usize,
    /// Bytes of a run's metadata as JSON.
    pub metadata_bytes: usize,
    /// Bytes of an `Idempotency-Key`.
    pub idempotency_key_bytes: usize,
    /// Items of a page.
    pub page_items: u32,
    /// Faults listed in one problem; all are counted.
    pub faults_listed: usize,
    /// Bytes of a body of plain data up to which all its faults are told; of a larger one the first.
    pub all_faults_bytes: usize,
    /// Parameters of a query string that are looked at.
    pub query_parameters: usize,
    /// Different numbers of the rows for `/aggregate_metrics`.
    pub metric_names: usize,
    /// Bytes of a model's text that are read in vain in search of JSON, or 16 times the text where that is more; then it is given up.
    pub answer_search_bytes: usize,
    /// Seconds for the headers of a request to arrive.
    pub header_seconds: u64,
    /// Seconds from the headers of a request to the beginning of its answer.
    pub request_seconds: u64,
    /// Requests a second with one key, unless `serve` says otherwise; 0: no limit.
    pub requests_per_second_per_key: u32,
    /// Requests a second from one address without a key, unless `serve` says otherwise; 0: no limit.
    pub requests_per_second_per_address: u32,
    /// Streams of `/v1/events` open at the same time; more are asked to come back (429).
    pub event_streams: usize,
    /// Of these, streams of one sender.
    pub event_streams_per_sender: usize,
    /// Connections open at the same time; more wait.
    pub connections: usize,
    /// Of these, connections from one address, unless `serve` says otherwise; more are closed at once.
    pub connections_per_address: usize,
    /// Seconds for which a client may take nothing of its answer; then the connection is closed.
    pub write_seconds: u64,
    /// Logs in one body for `/v1/grade:batch`.
    pub grade_batch_logs: usize,
    /// Checks in a turn of a task that a request to grade brings.
    pub grade_inline_checks: usize,
    /// Checks in all turns of such a task.
    pub grade_inline_checks_in_all: usize,
    /// Items of a list in the arguments of its checks.
    pub grade_inline_list_items: usize,
    /// Bytes of such a task as JSON.
    pub grade_inline_bytes: usize,
    /// Bodies for `/v1/grade:batch` worked on at the same time; more are asked to come back (429).
    pub grade_batches: usize,
    /// Of these, bodies of one sender.
    pub grade_batches_per_sender: usize,
    /// Seconds that logs of a batch wait for their turn before they end with status 504.
    pub grade_batch_wait_seconds: u64,
    /// Logs for `/v1/grade` graded or waiting at the same time; more are asked to come back (429).
    pub grades_waiting: usize,
    /// Of these, logs of one sender.
    pub grades_waiting_per_sender: usize,
    /// Milliseconds that grading a log for `/v1/grade` may take, where the request does not say.
    pub grade_default_deadline_ms: u64,
    /// The most that a request may say.
    pub grade_max_deadline_ms: u64,
    /// Bytes of memory for results of `/v1/grade` that are kept for the same log and task, unless `serve` says otherwise.
    pub grade_cache_bytes: usize,
    /// Bytes of the action code of a turn.
    pub action_code_bytes: usize,
    /// Milliseconds on the processor that it may take.
    pub action_cpu_ms: u64,
    /// Milliseconds after which its process is ended, whatever it does.
    pub action_wall_ms: u64,
    /// Bytes of memory for its objects.
    pub action_memory_bytes: usize,
    /// Events that the action code of one body may record, over all submissions.
    pub action_body_events: usize,
    /// Requests whose action code runs or waits; more are asked to come back (429).
    pub action_requests: usize,
    /// Of these, requests of one sender.
    pub action_requests_per_sender: usize,
    /// Runs of an entry to an epoch.
    pub entry_runs: u32,
    /// Least characters of the nonce that draws a run.
    pub nonce_min_chars: usize,
    /// Most characters of it.
    pub nonce_max_chars: usize,
    /// Extent along an axis, and height, in blocks, up to which strict checks of rooms and ways look at a build; a larger one
    /// fails them.
    pub strict_extent: i64,
    /// Items of a list, and cells, that a check's finding shows; longer lists are cut, and the finding says so.
    pub finding_items: usize,
    /// Characters of a text in a finding.
    pub finding_chars: usize,
    /// Seconds that one grading may take: several times what the largest build that is allowed takes.
    pub grading_seconds: u64,
    /// Times that grading is begun before a submission ends as `grader_error`.
    pub grading_attempts: i64,
}

/// The limits in force.
pub const LIMITS: Limits = Limits {
    body_bytes: 32 << 20,
    bodies_in_memory_bytes: 512 << 20,
    json_depth: 126,
    ndjson_lines: 1_000,
    turns: 64,
    events: ACTION_LIMITS.events,
    blocks: 100_000,
    blocks_with_stress: 50_000,
    stress_fields_at_once: 2,
    stress_fields_per_sender: 1,
    stress_fields_waiting: 64,
    stress_fields_waiting_per_sender: 8,
    stress_cache_bytes: 64 << 20,
    stress_wait_seconds: 5,
    stress_seconds: 50,
    materials: ACTION_LIMITS.materials,
    material_chars: ACTION_LIMITS.material_chars,
    horizontal: cell::MAX_HORIZONTAL,
    min_y: cell::MIN_Y,
    max_y: cell::MAX_Y,
    agent_chars: 100,
    metadata_bytes: 16 << 10,
    idempotency_key_bytes: 200,
    page_items: 1_000,
    faults_listed: Faults::KEPT,
    all_faults_bytes: 64 << 10,
    query_parameters: 200,
    metric_names: 1_000,
    answer_search_bytes: WASTE_BYTES,
    header_seconds: 10,
    request_seconds: 60,
    requests_per_second_per_key: 100_000,
    requests_per_second_per_address: 100_000,
    event_streams: 1_000,
    event_streams_per_sender: 100,
    connections: 18_000,
    connections_per_address: 16_500,
    write_seconds: 30,
    grade_batch_logs: 10_000,
    grade_inline_checks: 64,
    grade_inline_checks_in_all: 1_024,
    grade_inline_list_items: 64,
    grade_inline_bytes: 1 << 20,
    grade_batches: 64,
    grade_batches_per_sender: 16,
    grade_batch_wait_seconds: 60,
    grades_waiting: 20_000,
    grades_waiting_per_sender: 16_384,
    grade_default_deadline_ms: 10_000,
    grade_max_deadline_ms: 50_000,
    grade_cache_bytes: 64 << 20,
    action_code_bytes: ACTION_LIMITS.code_bytes,
    action_cpu_ms: ACTION_LIMITS.cpu_ms,
    action_wall_ms: ACTION_LIMITS.wall_ms,
    action_memory_bytes: ACTION_LIMITS.memory_bytes,
    action_body_events: 2_000_000,
    action_requests: 256,
    action_requests_per_sender: 64,
    entry_runs: 16,
    nonce_min_chars: 16,
    nonce_max_chars: 128,
    strict_extent: MAX_EXTENT,
    finding_items: MAX_ITEMS,
    finding_chars: MAX_CHARS,
    grading_seconds: 600,
    grading_attempts: MAX_ATTEMPTS,
};

impl Limits {
    /// The part that reading a log needs.
    #[must_use]
    pub const fn log(&self) -> LogLimits {
        LogLimits {
            max_turns: self.turns,
            max_events: self.events,
            max_materials: self.materials,
            max_material_chars: self.material_chars,
        }
    }
}

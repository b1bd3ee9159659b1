//! Every limit of the service, in one place: enforced where named, and served at `/v1/limits`.

use serde::Serialize;

use crate::actions::ACTION_LIMITS;
use crate::store::jobs::MAX_ATTEMPTS;
use crate::voxel::log_reader::LogLimits;
use crate::voxel::terrain::MAX_EXTENT;
use crate::voxel::{Faults, cell};

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
    /// Requests that wait for one of them at the same time; more are asked to come back (503).
    pub stress_fields_waiting: usize,
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
    /// Connections open at the same time; more wait.
    pub connections: usize,
    /// Logs in one body for `/v1/grade:batch`.
    pub grade_batch_logs: usize,
    /// Checks in a turn of a task that a request to grade brings.
    pub grade_inline_checks: usize,
    /// Bodies for `/v1/grade:batch` worked on at the same time; more are asked to come back (429).
    pub grade_batches: usize,
    /// Logs for `/v1/grade` graded or waiting at the same time; more are asked to come back (429).
    pub grades_waiting: usize,
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
    /// Runs of an entry to an epoch.
    pub entry_runs: u32,
    /// Least characters of the nonce that draws a run.
    pub nonce_min_chars: usize,
    /// Most characters of it.
    pub nonce_max_chars: usize,
    /// Extent along an axis, and height, in blocks, up to which strict checks of rooms and ways look at a build; a larger one
    /// fails them.
    pub strict_extent: i64,
    /// Seconds that one grading may take.
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
    stress_fields_waiting: 64,
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
    header_seconds: 10,
    request_seconds: 60,
    requests_per_second_per_key: 100_000,
    requests_per_second_per_address: 100_000,
    event_streams: 1_000,
    connections: 18_000,
    grade_batch_logs: 10_000,
    grade_inline_checks: 64,
    grade_batches: 16,
    grades_waiting: 16_384,
    grade_default_deadline_ms: 10_000,
    grade_max_deadline_ms: 50_000,
    grade_cache_bytes: 64 << 20,
    action_code_bytes: ACTION_LIMITS.code_bytes,
    action_cpu_ms: ACTION_LIMITS.cpu_ms,
    action_wall_ms: ACTION_LIMITS.wall_ms,
    action_memory_bytes: ACTION_LIMITS.memory_bytes,
    action_body_events: 2_000_000,
    action_requests: 256,
    entry_runs: 16,
    nonce_min_chars: 16,
    nonce_max_chars: 128,
    strict_extent: MAX_EXTENT,
    grading_seconds: 3_600,
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

//! The limits by name, each with its unit.

use serde::Serialize;

use plumbline_engine::intake::LogLimits;

/// Limits of the service. Sizes are those of the decompressed body.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
pub struct Limits {
    /// Bytes of a request body after decompression.
    pub body_bytes: usize,
    /// Bytes of bodies of 64 KiB and more in memory at the same time; a request beyond that is refused with 503.
    pub bodies_in_memory_bytes: usize,
    /// Bytes of a form of the pages, and of a note with cosignatures.
    pub form_bytes: usize,
    /// Levels of nested arrays and objects in a run's metadata; elsewhere the format bounds the depth.
    pub json_depth: u32,
    /// Values in a body of a trainer that has no shape of its own: a request of NeMo Gym, the labels of `OpenRLHF`. An
    /// object counts as 8 more, each of its members as 2, an array as 2.
    pub free_json_values: usize,
    /// Bytes of memory for the values of such bodies, of all requests that are read or wait for grading at the same time;
    /// others wait.
    pub free_json_in_memory_bytes: usize,
    /// The same for the requests of one sender: the owner of a key, or an address.
    pub free_json_in_memory_bytes_per_sender: usize,
    /// Values in metadata, in a card, in a task that a request brings, and in a label as text.
    pub free_json_member_values: usize,
    /// Characters in the identifier of a task.
    pub task_chars: usize,
    /// Characters in the name of a suite.
    pub suite_chars: usize,
    /// Submissions in one NDJSON body.
    pub ndjson_lines: usize,
    /// Turns in a log.
    pub turns: usize,
    /// Events in a log, over all turns.
    pub events: usize,
    /// Blocks present after any turn.
    pub blocks: usize,
    /// Blocks present after any turn of a task with a stress check, or in a structure whose stress field is computed.
    pub blocks_with_stress: usize,
    /// The same for what a model's answer or action code built, where a request waits for the grade: its sender does not
    /// choose how long that takes.
    pub grade_blocks_with_stress: usize,
    /// Stress fields computed at the same time for `/v1/submissions/{id}/stress`; further requests wait.
    pub stress_fields_at_once: usize,
    /// Stress fields computed at the same time for one sender: the owner of a key, or an address.
    pub stress_fields_per_sender: usize,
    /// Requests that wait for a stress field at the same time; further ones are refused with 503 and may be retried.
    pub stress_fields_waiting: usize,
    /// Requests of one sender that wait for a stress field at the same time.
    pub stress_fields_waiting_per_sender: usize,
    /// Bytes of memory for the cache of stress fields.
    pub stress_cache_bytes: usize,
    /// Seconds that a request waits for its stress field to begin; then it is refused with 503 and may be retried.
    pub stress_wait_seconds: u64,
    /// Seconds that computing a stress field may take.
    pub stress_seconds: u64,
    /// Distinct materials in a log.
    pub materials: usize,
    /// Characters in a material name.
    pub material_chars: usize,
    /// Greatest absolute value of x and z.
    pub horizontal: i32,
    /// Least y.
    pub min_y: i32,
    /// Greatest y.
    pub max_y: i32,
    /// Characters in the name of an owner or of a member.
    pub owner_chars: usize,
    /// Days that a key may be valid.
    pub key_days: i64,
    /// Characters in the reason for an action on a board's row.
    pub reason_chars: usize,
    /// Characters in an agent's name.
    pub agent_chars: usize,
    /// Bytes of a run's metadata as JSON.
    pub metadata_bytes: usize,
    /// Bytes of the system prompt in a card.
    pub card_prompt_bytes: usize,
    /// Versions of a card.
    pub card_versions: i64,
    /// Members of an owner.
    pub team_members: i64,
    /// Live keys of an owner itself, and of each of its members.
    pub live_keys: i64,
    /// Webhooks of an owner.
    pub webhooks: i64,
    /// Characters in the URL of a webhook.
    pub webhook_url_chars: usize,
    /// Pending deliveries of a webhook; further events wait.
    pub webhook_pending: i64,
    /// Seconds in which an endpoint must answer a message.
    pub webhook_seconds: u64,
    /// Days for which deliveries that were made are kept.
    pub webhook_delivered_days: i64,
    /// Days for which deliveries that were given up are kept.
    pub webhook_dead_days: i64,
    /// Days that a run may be under embargo.
    pub embargo_days: i64,
    /// Bytes in an `Idempotency-Key`.
    pub idempotency_key_bytes: usize,
    /// Items on a page.
    pub page_items: u32,
    /// Faults listed in one problem; all of them are counted.
    pub faults_listed: usize,
    /// Bytes of a body of plain data up to which all its faults are reported; for a larger body only the first is.
    pub all_faults_bytes: usize,
    /// Parameters of a query string that are examined.
    pub query_parameters: usize,
    /// Distinct numeric fields of the rows for `/aggregate_metrics`.
    pub metric_names: usize,
    /// Bytes of a model's text that are read without success in the search for JSON, or 16 times the text if that is
    /// more; then the search ends.
    pub answer_search_bytes: usize,
    /// Bytes of the path and the query of a request.
    pub path_bytes: usize,
    /// Bytes of the request line and the headers that a request may have in any case; twice as many are refused.
    pub head_bytes: usize,
    /// Headers of a request.
    pub headers: usize,
    /// Seconds in which the headers of a request must arrive.
    pub header_seconds: u64,
    /// Seconds from the headers of a request to the beginning of its response.
    pub request_seconds: u64,
    /// Requests per second with one key, unless `serve` sets another limit; 0 means no limit.
    pub requests_per_second_per_key: u32,
    /// Requests per second from one address without a key, unless `serve` sets another limit; 0 means no limit.
    pub requests_per_second_per_address: u32,
    /// Streams of `/v1/events` open at the same time; further ones are refused with 429 and may be retried.
    pub event_streams: usize,
    /// Streams of `/v1/events` that one sender has open at the same time.
    pub event_streams_per_sender: usize,
    /// Connections open at the same time; further ones wait.
    pub connections: usize,
    /// Connections from one address open at the same time, unless `serve` sets another limit; further ones are closed
    /// at once. 0 means no limit.
    pub connections_per_address: usize,
    /// Seconds for which a client may read nothing of its response; then the connection is closed.
    pub write_seconds: u64,
    /// Logs in a body for `/v1/grade:batch`.
    pub grade_batch_logs: usize,
    /// Checks in a turn of an inline task, which a request to grade brings with it.
    pub grade_inline_checks: usize,
    /// Checks in all turns of an inline task.
    pub grade_inline_checks_in_all: usize,
    /// Items of a list in the arguments of a check of an inline task.
    pub grade_inline_list_items: usize,
    /// Bytes of an inline task as JSON.
    pub grade_inline_bytes: usize,
    /// Batches for `/v1/grade:batch` processed at the same time; further ones are refused with 429 and may be retried.
    pub grade_batches: usize,
    /// Batches of one sender processed at the same time.
    pub grade_batches_per_sender: usize,
    /// Seconds that a log of a batch waits in a lane to be graded; then it ends with status 504.
    pub grade_batch_wait_seconds: u64,
    /// Logs for `/v1/grade` graded or waiting at the same time; further ones are refused with 429 and may be retried.
    pub grades_waiting: usize,
    /// Logs of one sender graded or waiting at the same time.
    pub grades_waiting_per_sender: usize,
    /// Milliseconds that grading a log for `/v1/grade` may take if the request sets no deadline.
    pub grade_default_deadline_ms: u64,
    /// Longest deadline that a request may set, in milliseconds.
    pub grade_max_deadline_ms: u64,
    /// Seconds for which action code of a request to grade may wait and run, but for batches; then it is refused with 503.
    pub grade_code_seconds: u64,
    /// Seconds from the beginning of a request for a reward until its log is graded; then it is refused with 503.
    pub grade_seconds: u64,
    /// Least weight above 0 of a criterion in a reward.
    pub reward_weight_min: f64,
    /// Greatest weight of a criterion in a reward.
    pub reward_weight_max: f64,
    /// Bytes of memory for the cache of results of `/v1/grade`, by log and task, unless `serve` sets another limit.
    pub grade_cache_bytes: usize,
    /// Bytes in the action code of a turn, without what a model thought.
    pub action_code_bytes: usize,
    /// Bytes in the action code of a turn, with what a model thought.
    pub action_text_bytes: usize,
    /// Files of action code in a turn.
    pub action_files: usize,
    /// Milliseconds of processor time that all files of a log may use together under `published`, where each runs on its
    /// own.
    pub action_files_cpu_ms: u64,
    /// Lines that the log of a turn's action code keeps.
    pub action_log_lines: usize,
    /// Bytes that the log of a turn's action code keeps.
    pub action_log_bytes: usize,
    /// Virtual milliseconds that action code may wait for, under the profile `mindcraft`.
    pub action_virtual_ms: u64,
    /// Virtual milliseconds for which timers go on after action code has ended.
    pub action_timers_ms: u64,
    /// Errors of a turn's action code that are told; how many more there were is a note.
    pub action_errors: usize,
    /// Notes on a turn's action code, and reasons of calls without effect, that are told.
    pub action_notes: usize,
    /// Characters of such a note or reason.
    pub action_note_chars: usize,
    /// Bytes of the stack of action code under the profile `published`.
    pub action_stack_bytes: usize,
    /// Bytes of the stack of action code under the profile `mindcraft`.
    pub action_stack_bytes_mindcraft: usize,
    /// Blocks that a search of action code reaches.
    pub action_search_blocks: u32,
    /// Blocks that a search of action code finds.
    pub action_search_found: usize,
    /// Characters of a command.
    pub action_command_chars: usize,
    /// Blocks that one `/fill` or `/clone` may change, unless the code sets the game rule.
    pub action_fill_blocks: usize,
    /// Blocks that one `/fill` or `/clone` may visit, whatever the game rule says.
    pub action_fill_visited: i64,
    /// Bytes of a response of `/v1/replay`, about; what was recorded beyond it is an error.
    pub replay_bytes: usize,
    /// Episodes that one owner has open at the same time.
    pub episodes_per_owner: i64,
    /// Seconds after which an episode takes no more steps.
    pub episode_seconds: i64,
    /// Days for which an episode is kept after that.
    pub episode_kept_days: i64,
    /// Steps of an episode.
    pub episode_steps: i64,
    /// Bytes that the state of an episode takes as JSON.
    pub episode_bytes: usize,
    /// Events that the answer to a step lists.
    pub episode_events: usize,
    /// Cells of a box of an episode's world that is shown.
    pub episode_view_cells: u64,
    /// Blocks that a picture shows; of a larger build the first ones.
    pub picture_blocks: usize,
    /// Blocks that a thumbnail, and the picture of a whole build on a page, shows.
    pub page_picture_blocks: usize,
    /// Pixels of the longer side of a picture.
    pub picture_pixels: u32,
    /// Bytes of a structure file after decompression.
    pub structure_bytes: u64,
    /// Cells in the box of a structure file of a format that lists every cell.
    pub structure_cells: u64,
    /// Values in a structure file, each a number, text, list or compound.
    pub structure_values: usize,
    /// Structure files in a body, over all its turns and lines.
    pub structures_in_body: usize,
    /// Cells along an axis of a `.schem` file that is read.
    pub structure_axis_cells: u64,
    /// Cells along an axis of a structure file that is written in a format that lists every cell.
    pub structure_axis_cells_written: u64,
    /// Bytes of a block's name with its state in a structure file.
    pub structure_name_bytes: usize,
    /// Levels of nested lists and compounds in a structure file.
    pub structure_depth: usize,
    /// Texts in a structure file, such as names and properties of its palette, and members of a compound.
    pub structure_texts: usize,
    /// Structure files and pictures made or read at the same time; further ones wait.
    pub structures_at_once: usize,
    /// Milliseconds of processor time that action code may take.
    pub action_cpu_ms: u64,
    /// Milliseconds after which the process that runs action code is ended in any case.
    pub action_wall_ms: u64,
    /// Bytes of memory for the objects of action code.
    pub action_memory_bytes: usize,
    /// Events that the action code of one body may record, over all submissions.
    pub action_body_events: usize,
    /// Requests whose action code runs or waits at the same time; further ones are refused with 429 and may be retried.
    pub action_requests: usize,
    /// Requests of one sender whose action code runs or waits at the same time.
    pub action_requests_per_sender: usize,
    /// Runs in an entry to an epoch.
    pub entry_runs: u32,
    /// Least characters in the nonce that draws a run.
    pub nonce_min_chars: usize,
    /// Most characters in the nonce that draws a run.
    pub nonce_max_chars: usize,
    /// Extent along an axis, and height, in blocks, up to which strict checks of rooms and ways examine a build; a
    /// larger build fails them.
    pub strict_extent: i64,
    /// Items of a list, and cells, that the finding of a check shows; longer lists are truncated, and the finding says
    /// so.
    pub finding_items: usize,
    /// Characters of a text in a finding.
    pub finding_chars: usize,
    /// Seconds that one grading may take: several times what the largest allowed build takes.
    pub grading_seconds: u64,
    /// Attempts to grade a submission before it ends as `grader_error`.
    pub grading_attempts: i64,
    /// Bytes that must be free on the disk of a database file; with less, `/readyz` says that the node is not ready.
    pub disk_room_bytes: u64,
}

impl Limits {
    /// Returns the limits that reading a log needs.
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

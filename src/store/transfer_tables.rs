//! Exported and imported tables: one list of tables and columns for both directions.

/// Representation of a column in a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Text,
    Number,
    Flag,
    /// JSON, stored as text.
    Json,
    /// JSON, stored compressed.
    Packed,
    /// Bytes, written in Base64.
    Bytes,
}

/// Kind of exported rows: a table, written to a file of lines.
#[derive(Debug)]
pub struct Kind {
    /// Name of the file, without extension.
    pub name: &'static str,
    pub(super) table: &'static str,
    /// Columns: name in the table, name in a line, and representation.
    pub(super) columns: &'static [(&'static str, &'static str, Form)],
    /// Rest of the query: which rows, in which order.
    pub(super) rest: &'static str,
    /// Whether a row that already exists is left as it is.
    pub(super) may_be_there: bool,
}

/// Query for the submissions that are exported.
pub(super) const PUBLIC: &str = "SELECT id FROM submissions WHERE instance_id IS NULL";

/// All kinds, each after the kinds that it refers to.
pub const KINDS: &[Kind] = &[
    Kind {
        name: "suites",
        table: "suites",
        columns: &[
            ("id", "id", Form::Text),
            ("name", "name", Form::Text),
            ("version", "version", Form::Number),
            ("task_count", "tasks", Form::Number),
            ("content_hash", "content_hash", Form::Text),
            ("created_at_ms", "created_at_ms", Form::Number),
            ("preamble", "preamble", Form::Text),
        ],
        rest: "WHERE task_count > 0 ORDER BY id",
        may_be_there: true,
    },
    Kind {
        name: "tasks",
        table: "tasks",
        columns: &[
            ("hash", "hash", Form::Text),
            ("id", "id", Form::Text),
            ("family", "family", Form::Text),
            ("body", "task", Form::Json),
        ],
        rest: "WHERE hash IN (SELECT task_hash FROM suite_tasks) ORDER BY hash",
        may_be_there: true,
    },
    Kind {
        name: "suite-tasks",
        table: "suite_tasks",
        columns: &[
            ("suite_id", "suite", Form::Text),
            ("number", "number", Form::Number),
            ("task_hash", "task_hash", Form::Text),
        ],
        rest: "ORDER BY suite_id, number",
        may_be_there: true,
    },
    Kind {
        name: "runs",
        table: "runs",
        columns: &[
            ("id", "id", Form::Text),
            ("agent", "agent", Form::Text),
            ("suite_id", "suite", Form::Text),
            ("owner", "owner", Form::Text),
            ("provenance", "provenance", Form::Text),
            ("metadata", "metadata", Form::Json),
            ("state", "state", Form::Text),
            ("pending", "pending", Form::Number),
            ("graded", "graded", Form::Number),
            ("grader_errors", "grader_errors", Form::Number),
            ("created_at_ms", "created_at_ms", Form::Number),
            ("finished_at_ms", "finished_at_ms", Form::Number),
            ("deleted_at_ms", "deleted_at_ms", Form::Number),
            ("summary", "summary", Form::Json),
            ("profile", "profile", Form::Text),
            ("track", "track", Form::Text),
        ],
        rest: "ORDER BY id",
        may_be_there: false,
    },
    Kind {
        name: "cards",
        table: "cards",
        columns: &[
            ("id", "id", Form::Text),
            ("run_id", "run", Form::Text),
            ("version", "version", Form::Number),
            ("card", "card", Form::Json),
            ("system_prompt", "system_prompt", Form::Text),
            ("actor", "actor", Form::Text),
            ("created_at_ms", "created_at_ms", Form::Number),
        ],
        rest: "WHERE run_id IS NOT NULL ORDER BY id",
        may_be_there: false,
    },
    Kind {
        name: "embargoes",
        table: "embargoes",
        columns: &[
            ("run_id", "run", Form::Text),
            ("alias", "alias", Form::Text),
            ("agent", "agent", Form::Text),
            ("metadata", "metadata", Form::Json),
            ("until_ms", "until_ms", Form::Number),
            ("lifted_at_ms", "lifted_at_ms", Form::Number),
        ],
        rest: "ORDER BY run_id",
        may_be_there: false,
    },
    Kind {
        name: "skipped-tasks",
        table: "skipped_tasks",
        columns: &[("run_id", "run", Form::Text), ("task_number", "number", Form::Number)],
        rest: "ORDER BY run_id, task_number",
        may_be_there: false,
    },
    Kind {
        name: "submissions",
        table: "submissions",
        columns: &[
            ("id", "id", Form::Text),
            ("run_id", "run", Form::Text),
            ("suite_id", "suite", Form::Text),
            ("task_number", "number", Form::Number),
            ("task_hash", "task_hash", Form::Text),
            ("owner", "owner", Form::Text),
            ("log_hash", "log_hash", Form::Text),
            ("log_bytes", "log_bytes", Form::Number),
            ("turns", "turns", Form::Number),
            ("events", "events", Form::Number),
            ("state", "state", Form::Text),
            ("error", "error", Form::Text),
            ("superseded", "superseded", Form::Flag),
            ("superseded_by", "superseded_by", Form::Text),
            ("created_at_ms", "created_at_ms", Form::Number),
            ("ended_at_ms", "ended_at_ms", Form::Number),
            ("replays", "action_code", Form::Json),
            ("profile", "profile", Form::Text),
            ("log", "log", Form::Packed),
        ],
        rest: "WHERE instance_id IS NULL ORDER BY id",
        may_be_there: false,
    },
    Kind {
        name: "reports",
        table: "reports",
        columns: &[
            ("submission_id", "submission", Form::Text),
            ("attempt", "attempt", Form::Number),
            ("checks_version", "checks_version", Form::Number),
            ("grader", "grader", Form::Text),
            ("overall", "overall", Form::Flag),
            ("accuracy", "accuracy", Form::Flag),
            ("scores", "scores", Form::Json),
            ("graded_at_ms", "graded_at_ms", Form::Number),
            ("grading_us", "grading_us", Form::Number),
            ("fingerprint", "fingerprint", Form::Bytes),
            ("body", "report", Form::Packed),
        ],
        rest: "WHERE submission_id IN (PUBLIC) ORDER BY submission_id, attempt",
        may_be_there: false,
    },
    Kind {
        name: "results",
        table: "results",
        columns: &[
            ("id", "id", Form::Number),
            ("run_id", "run", Form::Text),
            ("since_ms", "since_ms", Form::Number),
            ("summary", "summary", Form::Json),
            ("outcomes", "outcomes", Form::Bytes),
            ("fingerprint", "fingerprint", Form::Bytes),
        ],
        rest: "ORDER BY id",
        may_be_there: false,
    },
    Kind {
        name: "board-actions",
        table: "board_actions",
        columns: &[
            ("id", "id", Form::Number),
            ("run_id", "run", Form::Text),
            ("action", "action", Form::Text),
            ("actor", "actor", Form::Text),
            ("reason", "reason", Form::Text),
            ("at_ms", "at_ms", Form::Number),
        ],
        rest: "ORDER BY id",
        may_be_there: false,
    },
    Kind {
        name: "quotas",
        table: "quotas",
        columns: &[
            ("owner", "owner", Form::Text),
            ("granted", "granted", Form::Number),
            ("used_before", "used_before_first_grant", Form::Number),
            ("reserved", "reserved", Form::Number),
            ("charged", "charged", Form::Number),
        ],
        rest: "ORDER BY owner",
        may_be_there: false,
    },
    Kind {
        name: "quota-entries",
        table: "quota_entries",
        columns: &[
            ("id", "id", Form::Number),
            ("owner", "owner", Form::Text),
            ("submission_id", "submission", Form::Text),
            ("kind", "kind", Form::Text),
            ("units", "units", Form::Number),
            ("reason", "reason", Form::Text),
            ("at_ms", "at_ms", Form::Number),
        ],
        rest: "WHERE submission_id IS NULL OR submission_id IN (PUBLIC) ORDER BY id",
        may_be_there: false,
    },
];

//! Failures of use cases: one list of kinds, each with its name and title.
//!
//! There are two families. A failure of the caller names the location of the fault, so that the caller can fix it. A
//! failure of ours is logged once with its cause; the caller learns only that the same request may be sent again. Only
//! `http/problem.rs` turns a failure into a response.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::store::StoreError;
use plumbline_engine::intake::{Fault, Faults};
use plumbline_engine::text::counted;

/// Result of a use case.
pub type AppResult<T> = Result<T, AppError>;

/// A fault of a request, at its location.
#[derive(Debug, Clone, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FaultBody {
    /// Line of an NDJSON body, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// JSON pointer (RFC 6901) to the value; empty for the whole body and for a parameter.
    #[schema(example = "/turns/0/events/3/x")]
    pub pointer: String,
    /// Name of the query parameter, if the fault is in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameter: Option<String>,
    /// Description of the fault.
    #[schema(example = "1.5 is not an integer")]
    pub detail: String,
}

impl FaultBody {
    /// Creates the fault of a query parameter.
    pub fn of_parameter(name: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { line: None, pointer: String::new(), parameter: Some(name.into()), detail: detail.into() }
    }
}

impl From<Fault> for FaultBody {
    fn from(fault: Fault) -> Self {
        Self { line: fault.line, pointer: fault.pointer, parameter: None, detail: fault.detail }
    }
}

/// Creates the list of kinds: variant, name in the problem type, title.
macro_rules! kinds {
    ($( $variant:ident = $name:literal, $title:literal; )*) => {
        /// Kind of a failure.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[expect(missing_docs, reason = "name and title say what each variant is")]
        pub enum Kind {
            $( $variant, )*
            /// The request conflicts with the current state; the name says how.
            Conflict(&'static str),
        }

        impl Kind {
            /// All kinds but conflicts, which are named where they arise. `docs/errors.md` describes them all.
            pub const ALL: &[Self] = &[$( Self::$variant, )*];

            /// Returns the stable name, as in `urn:plumbline:problem:NAME`.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $( Self::$variant => $name, )*
                    Self::Conflict(name) => name,
                }
            }

            /// Returns the title for people.
            #[must_use]
            pub const fn title(self) -> &'static str {
                match self {
                    $( Self::$variant => $title, )*
                    Self::Conflict(_) => "Conflict",
                }
            }
        }
    };
}

kinds! {
    BadRequest = "bad-request", "Bad request";
    MalformedBody = "malformed-body", "The body cannot be read as JSON";
    UnreadableBody = "unreadable-body", "The body could not be read";
    InvalidQuery = "invalid-query", "The query string has faults";
    Unauthorized = "unauthorized", "Unauthorized";
    Forbidden = "forbidden", "Forbidden";
    QuotaUsedUp = "quota-used-up", "The quota is used up";
    NotFound = "not-found", "Not found";
    MethodNotAllowed = "method-not-allowed", "Method not allowed";
    RequestTimeout = "timeout", "Timeout";
    BodyTooLarge = "body-too-large", "The body is too large";
    UnsupportedMediaType = "unsupported-media-type", "Unsupported media type";
    InvalidBody = "invalid-body", "The body has faults";
    IdempotencyKeyReused = "idempotency-key-reused", "Idempotency-Key reused";
    TooLong = "too-long", "Too long";
    TooManyBlocks = "too-many-blocks", "Too many blocks";
    TooManyRequests = "too-many-requests", "Too many requests";
    RateLimited = "rate-limited", "Too many requests";
    Internal = "internal", "Internal error";
    Damaged = "damaged", "Stored data is damaged";
    Busy = "busy", "Busy";
    Stopping = "stopping", "Stopping";
    NotReady = "not-ready", "Not ready";
    Deadline = "deadline", "Deadline passed";
}

/// Failure of a use case.
#[derive(Debug, Clone)]
pub struct AppError(Box<Failure>);

impl fmt::Display for AppError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.detail())?;
        self.faults().iter().try_for_each(|fault| write!(f, "; {}: {}", fault.pointer, fault.detail))
    }
}

impl std::error::Error for AppError {}

#[derive(Debug, Clone)]
struct Failure {
    kind: Kind,
    detail: String,
    faults: Vec<FaultBody>,
    retry_after_s: Option<u32>,
    has_null_reward: bool,
}

impl AppError {
    /// Creates a failure of a kind; `detail` describes this occurrence.
    pub fn new(kind: Kind, detail: impl Into<String>) -> Self {
        let detail = detail.into();
        Self(Box::new(Failure { kind, detail, faults: Vec::new(), retry_after_s: None, has_null_reward: false }))
    }

    /// Creates the failure for something that does not exist.
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(Kind::NotFound, detail)
    }

    /// Creates a conflict with the current state; `name` is the stable name of its kind.
    pub fn conflict(name: &'static str, detail: impl Into<String>) -> Self {
        Self::new(Kind::Conflict(name), detail)
    }

    /// Creates the failure of a body, or a line of it, that is not JSON; `faults` holds all its faults.
    pub fn malformed(faults: Faults) -> Self {
        let detail = faults.list().iter().map(ToString::to_string).next().unwrap_or_default();
        Self::new(Kind::MalformedBody, detail).with_faults(faults)
    }

    /// Creates the failure of a body that is valid JSON but has faults.
    #[must_use]
    pub fn faulty(faults: Faults) -> Self {
        Self::new(Kind::InvalidBody, counted(faults.total(), "fault")).with_faults(faults)
    }

    /// Creates the failure of a query string; each fault names its parameter.
    #[must_use]
    pub fn invalid_query(faults: Vec<FaultBody>) -> Self {
        let told: Vec<String> = faults
            .iter()
            .map(|fault| format!("{}: {}", fault.parameter.as_deref().unwrap_or_default(), fault.detail))
            .collect();
        Self::new(Kind::InvalidQuery, told.join("; ")).with_fault_list(faults)
    }

    /// Creates the failure of a query string with one wrong parameter.
    pub fn wrong_parameter(name: &str, detail: impl Into<String>) -> Self {
        Self::invalid_query(vec![FaultBody::of_parameter(name, detail)])
    }

    /// Creates the refusal of an NDJSON body where one document is expected.
    pub fn not_ndjson(detail: &str) -> Self {
        Self::new(Kind::UnsupportedMediaType, format!("expected one JSON document, not NDJSON; {detail}"))
    }

    /// Creates the refusal of a request for which no slot is free; it is refused at once instead of waiting.
    pub fn too_many(detail: impl Into<String>) -> Self {
        Self::new(Kind::TooManyRequests, detail).retry_after(1)
    }

    /// Creates a failure of ours, and logs its cause.
    pub fn internal(cause: &dyn fmt::Display) -> Self {
        tracing::error!(%cause, "request failed");
        Self::new(Kind::Internal, "The service failed. The request may be sent again.").retry_after(1)
    }

    /// Creates the failure that data which the service stored cannot be read, and logs where it is and why.
    pub fn damaged(place: &'static str, cause: impl fmt::Display) -> Self {
        StoreError::corrupt(place, cause).into()
    }

    /// Adds the faults that caused the failure.
    #[must_use]
    pub fn with_faults(self, faults: Faults) -> Self {
        self.with_fault_list(faults.into_list().into_iter().map(FaultBody::from).collect())
    }

    /// Adds a list of faults.
    #[must_use]
    pub fn with_fault_list(mut self, faults: Vec<FaultBody>) -> Self {
        self.0.faults = faults;
        self
    }

    /// States that the same request may succeed after this many seconds.
    #[must_use]
    pub fn retry_after(mut self, seconds: u32) -> Self {
        self.0.retry_after_s = Some(seconds);
        self
    }

    /// Prefixes the location of each fault with a JSON pointer.
    #[must_use]
    pub fn at(mut self, pointer: &str) -> Self {
        for fault in &mut self.0.faults {
            fault.pointer = format!("{pointer}{}", fault.pointer);
        }
        self
    }

    /// Creates the failure for a request that depends on a clock that has just jumped.
    #[must_use]
    pub fn clock_in_doubt() -> Self {
        let detail = "the service's clock has jumped and is not believed yet; send the request again";
        Self::new(Kind::NotReady, detail).retry_after(60)
    }

    /// Replaces prefixes of pointers: internal names by the names that the caller uses.
    #[must_use]
    pub fn named(mut self, names: &[(&str, &str)]) -> Self {
        for fault in &mut self.0.faults {
            for (inner, outer) in names {
                if let Some(rest) = fault.pointer.strip_prefix(inner) {
                    fault.pointer = format!("{outer}{rest}");
                    break;
                }
            }
        }
        self
    }

    /// States with `"reward": null` that there is no reward.
    #[must_use]
    pub fn without_reward(mut self) -> Self {
        self.0.has_null_reward = true;
        self
    }

    /// Does the same as [`Self::without_reward`] if the sender is not at fault: the failure was ours, or the load was
    /// too high.
    #[must_use]
    pub fn without_reward_where_ours(self) -> Self {
        if self.is_ours() { self.without_reward() } else { self }
    }

    /// Returns the kind of the failure.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        self.0.kind
    }

    /// Returns the description of this occurrence.
    #[must_use]
    pub fn detail(&self) -> &str {
        &self.0.detail
    }

    /// Returns the faults that caused the failure.
    #[must_use]
    pub fn faults(&self) -> &[FaultBody] {
        &self.0.faults
    }

    /// Returns the number of seconds after which the same request may succeed.
    #[must_use]
    pub const fn retry_after_s(&self) -> Option<u32> {
        self.0.retry_after_s
    }

    /// Returns whether the same request may succeed later.
    #[must_use]
    pub const fn is_retryable(&self) -> bool {
        self.0.retry_after_s.is_some()
    }

    /// Returns whether the sender is not at fault: the service failed, or had too much to do.
    #[must_use]
    pub const fn is_ours(&self) -> bool {
        self.is_retryable() || matches!(self.0.kind, Kind::Damaged)
    }

    /// Returns whether the response states that there is no reward.
    #[must_use]
    pub const fn has_null_reward(&self) -> bool {
        self.0.has_null_reward
    }
}

impl From<StoreError> for AppError {
    fn from(error: StoreError) -> Self {
        if error.is_busy() {
            tracing::warn!(%error, "the database is busy");
            return Self::new(Kind::Busy, "The database is busy, or cannot be reached. The request may be sent again.")
                .retry_after(1);
        }
        if error.is_full() {
            tracing::error!(%error, "the disk of the database is full");
            let detail = "The disk of the database is full; nothing was stored. The request may be sent again once there is room.";
            return Self::new(Kind::Busy, detail).retry_after(10);
        }
        if let StoreError::Blobs { .. } = error {
            tracing::warn!(%error, "refused");
            let detail = "The place of large logs and reports does not answer. The request may be sent again.";
            return Self::new(Kind::Busy, detail).retry_after(1);
        }
        if let StoreError::LostFile(_) = error {
            tracing::error!(%error, "refused");
            let detail = "The database file is not where it was, so nothing can be stored. Tell the operator: the service's log \
                          says what to do.";
            return Self::new(Kind::NotReady, detail).retry_after(10);
        }
        if let StoreError::NoSecrets(_) = error {
            tracing::warn!(%error, "refused");
            let detail = "this node lacks the secrets that this needs; send the request again, to another node";
            return Self::new(Kind::NotReady, detail).retry_after(1);
        }
        if error.is_damage() {
            tracing::error!(%error, "stored data is damaged");
            metrics::counter!("plumbline_corrupt_rows_total").increment(1);
            let detail = "Data that the service stored is damaged, and sending the request again changes nothing. Tell the operator: \
                          the service's log says what is damaged.";
            return Self::new(Kind::Damaged, detail);
        }
        Self::internal(&error)
    }
}

//! Problems: every error answer, as RFC 9457 `application/problem+json`.
//!
//! Errors are converted here and only here. What went wrong inside is logged once with its cause; the client is told
//! that it was ours and may try again, never more.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};

use super::rates::Left;
use crate::store::StoreError;
use plumbline_engine::intake::{Fault, Faults};

/// Media type of problems.
pub const PROBLEM_JSON: &str = "application/problem+json";

/// One fault of a request.
#[derive(Debug, Clone, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FaultBody {
    /// Line of an NDJSON body, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// JSON pointer (RFC 6901) to the value; empty for the whole body, and for a parameter.
    #[schema(example = "/turns/0/events/3/x")]
    pub pointer: String,
    /// Parameter of the query string, where it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameter: Option<String>,
    /// What is wrong with it.
    #[schema(example = "1.5 is not an integer")]
    pub detail: String,
}

/// An error answer (RFC 9457).
#[derive(Debug, Clone, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Problem {
    /// Kind of problem; stable, for programs.
    #[serde(rename = "type")]
    #[schema(example = "urn:plumbline:problem:invalid-body")]
    pub kind: String,
    /// The kind in words.
    #[schema(example = "The body has faults")]
    pub title: String,
    /// The HTTP status.
    #[schema(minimum = 400, maximum = 599, example = 422)]
    pub status: u16,
    /// This occurrence in words.
    #[schema(example = "2 faults")]
    pub detail: String,
    /// All faults of the body, up to the number in `/v1/limits`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultBody>,
    /// Whether the same request may succeed later: the failure was ours, or there was too much to do.
    #[serde(default)]
    pub retryable: bool,
    /// Of requests for a reward that failed through no fault of theirs: null.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<f64>)]
    pub reward: Option<serde_json::Value>,
}

/// A handler's error.
#[derive(Debug)]
pub struct ApiError {
    problem: Box<Problem>,
    retry_after_s: Option<u32>,
    left: Option<Left>,
}

/// Result of a handler.
pub type ApiResult<T> = Result<T, ApiError>;

impl ApiError {
    /// A problem of this kind.
    pub fn new(status: StatusCode, kind: &str, title: &str, detail: impl Into<String>) -> Self {
        Self {
            problem: Box::new(Problem {
                kind: format!("urn:plumbline:problem:{kind}"),
                title: title.to_owned(),
                status: status.as_u16(),
                detail: detail.into(),
                faults: Vec::new(),
                retryable: false,
                reward: None,
            }),
            retry_after_s: None,
            left: None,
        }
    }

    /// 404: there is nothing of this name.
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", "Not found", detail)
    }

    /// 409: it is in another state.
    pub fn conflict(kind: &str, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, kind, "Conflict", detail)
    }

    /// 400: the body, or a line of it, cannot be read as JSON. The faults tell where, and all else that is wrong.
    pub fn malformed(faults: Faults) -> Self {
        let detail = faults.list().iter().map(ToString::to_string).next().unwrap_or_default();
        let title = "The body cannot be read as JSON";
        Self::new(StatusCode::BAD_REQUEST, "malformed-body", title, detail).with_faults(faults)
    }

    /// 422: the body is JSON, and parts of it are wrong.
    #[must_use]
    pub fn faulty(faults: Faults) -> Self {
        let detail = match faults.total() {
            1 => "1 fault".to_owned(),
            total => format!("{total} faults"),
        };
        let mut error = Self::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid-body", "The body has faults", detail);
        error.problem.faults = faults.into_list().into_iter().map(FaultBody::from).collect();
        error
    }

    /// With the faults that it comes from.
    #[must_use]
    pub fn with_faults(mut self, faults: Faults) -> Self {
        self.problem.faults = faults.into_list().into_iter().map(FaultBody::from).collect();
        self
    }

    /// The same, as they are told.
    #[must_use]
    pub fn with_fault_list(mut self, faults: Vec<FaultBody>) -> Self {
        self.problem.faults = faults;
        self
    }

    /// With a `Retry-After` header.
    #[must_use]
    pub fn retry_after(mut self, seconds: u32) -> Self {
        self.retry_after_s = Some(seconds);
        self.problem.retryable = true;
        self
    }

    /// With what the client may still send.
    #[must_use]
    pub const fn with_left(mut self, left: Left) -> Self {
        self.left = Some(left);
        self
    }

    /// With its faults placed below this pointer.
    #[must_use]
    pub fn at(mut self, pointer: &str) -> Self {
        for fault in &mut self.problem.faults {
            fault.pointer = format!("{pointer}{}", fault.pointer);
        }
        self
    }

    /// With pointers that begin with one name beginning with another, as the caller knows it.
    #[must_use]
    pub fn named(mut self, names: &[(&str, &str)]) -> Self {
        for fault in &mut self.problem.faults {
            for (inner, outer) in names {
                if let Some(rest) = fault.pointer.strip_prefix(inner) {
                    fault.pointer = format!("{outer}{rest}");
                    break;
                }
            }
        }
        self
    }

    /// With a reward that says that there is none.
    #[must_use]
    pub fn without_reward(mut self) -> Self {
        self.problem.reward = Some(serde_json::Value::Null);
        self
    }

    /// The same where the failure was ours, or there was too much to do.
    #[must_use]
    pub fn without_reward_where_ours(self) -> Self {
        if self.problem.retryable { self.without_reward() } else { self }
    }

    /// 415: the body is NDJSON where one document is wanted.
    pub fn not_ndjson(detail: &str) -> Self {
        let detail = format!("expected one JSON document, not NDJSON; {detail}");
        Self::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported-media-type", "Unsupported media type", detail)
    }

    /// 429: there is too much to do; said early, instead of letting the client wait.
    pub fn too_many(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::TOO_MANY_REQUESTS, "too-many-requests", "Too many requests", detail).retry_after(1)
    }

    /// The problem, to look at.
    #[must_use]
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// The problem itself, for answers that hold several.
    #[must_use]
    pub fn into_problem(self) -> Problem {
        *self.problem
    }

    /// 500: a failure of ours, logged here with its cause.
    pub fn internal(cause: &dyn std::fmt::Display) -> Self {
        tracing::error!(%cause, "request failed");
        let detail = "The service failed. The request may be sent again.";
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "internal", "Internal error", detail).retry_after(1)
    }
}

impl From<Fault> for FaultBody {
    fn from(fault: Fault) -> Self {
        Self { line: fault.line, pointer: fault.pointer, parameter: None, detail: fault.detail }
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        if error.is_busy() {
            tracing::warn!(%error, "the database is busy");
            let detail = "The database is busy. The request may be sent again.";
            return Self::new(StatusCode::SERVICE_UNAVAILABLE, "busy", "Busy", detail).retry_after(1);
        }
        Self::internal(&error)
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.problem.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_vec(&self.problem).unwrap_or_default();
        let mut response = (status, body).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
        if self.problem.status == StatusCode::UNAUTHORIZED.as_u16() {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        if let Some(left) = self.left {
            left.tell(headers);
        }
        if let Some(seconds) = self.retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

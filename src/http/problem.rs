//! Problems: every error response, as RFC 9457 `application/problem+json`.
//!
//! Only this module turns failures into responses.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};

use crate::app::error::{AppError, FaultBody, Kind};

/// Media type of problems.
pub const PROBLEM_JSON: &str = "application/problem+json";

/// An error response (RFC 9457).
#[derive(Debug, Clone, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Problem {
    /// Kind of problem; stable, for programs.
    #[serde(rename = "type")]
    #[schema(example = "urn:plumbline:problem:invalid-body")]
    pub kind: String,
    /// Title of the kind, for people.
    #[schema(example = "The body has faults")]
    pub title: String,
    /// HTTP status.
    #[schema(minimum = 400, maximum = 599, example = 422)]
    pub status: u16,
    /// Description of this occurrence.
    #[schema(example = "2 faults")]
    pub detail: String,
    /// Faults of the request, up to the number in `/v1/limits`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultBody>,
    /// Whether the same request may succeed later, because the service failed or had too much to do.
    #[serde(default)]
    pub retryable: bool,
    /// Null if a request for a reward failed through no fault of its sender; otherwise absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<f64>)]
    pub reward: Option<serde_json::Value>,
}

/// Returns the HTTP status of a kind of failure.
#[must_use]
pub const fn status_of(kind: Kind) -> StatusCode {
    match kind {
        Kind::BadRequest | Kind::MalformedBody | Kind::UnreadableBody | Kind::InvalidQuery => StatusCode::BAD_REQUEST,
        Kind::Unauthorized => StatusCode::UNAUTHORIZED,
        Kind::Forbidden | Kind::QuotaUsedUp => StatusCode::FORBIDDEN,
        Kind::NotFound => StatusCode::NOT_FOUND,
        Kind::MethodNotAllowed => StatusCode::METHOD_NOT_ALLOWED,
        Kind::RequestTimeout => StatusCode::REQUEST_TIMEOUT,
        Kind::Conflict(_) => StatusCode::CONFLICT,
        Kind::BodyTooLarge => StatusCode::PAYLOAD_TOO_LARGE,
        Kind::UnsupportedMediaType => StatusCode::UNSUPPORTED_MEDIA_TYPE,
        Kind::InvalidBody | Kind::IdempotencyKeyReused | Kind::TooLong | Kind::TooManyBlocks => {
            StatusCode::UNPROCESSABLE_ENTITY
        }
        Kind::TooManyRequests | Kind::RateLimited => StatusCode::TOO_MANY_REQUESTS,
        Kind::Internal | Kind::Damaged => StatusCode::INTERNAL_SERVER_ERROR,
        Kind::Busy | Kind::Stopping | Kind::NotReady => StatusCode::SERVICE_UNAVAILABLE,
        Kind::Deadline => StatusCode::GATEWAY_TIMEOUT,
    }
}

impl Problem {
    /// Builds the response, with the headers that its status requires.
    pub fn respond(&self, retry_after_s: Option<u32>) -> Response {
        let status = StatusCode::from_u16(self.status).expect("problems have statuses of HTTP");
        let body = serde_json::to_vec(self).expect("a problem holds strings and numbers");
        let mut response = (status, body).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        if let Some(seconds) = retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

impl From<AppError> for Problem {
    fn from(error: AppError) -> Self {
        let kind = error.kind();
        Self {
            kind: format!("urn:plumbline:problem:{}", kind.name()),
            title: kind.title().to_owned(),
            status: status_of(kind).as_u16(),
            detail: error.detail().to_owned(),
            faults: error.faults().to_vec(),
            retryable: error.is_retryable(),
            reward: error.has_null_reward().then_some(serde_json::Value::Null),
        }
    }
}

impl IntoResponse for AppError {
    fn into_response(self) -> Response {
        let retry_after_s = self.retry_after_s();
        Problem::from(self).respond(retry_after_s)
    }
}

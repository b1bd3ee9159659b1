//! Submissions and their reports.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};

use super::schema::{AcceptedAnswer, AcceptedBody, AcceptedList, NewSubmissionBody, Validated, ValidatedList};
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::submissions::accept::{Acceptance, accept, validate};
use crate::app::submissions::posted::Format;
use crate::http::extract::body::JsonBody;
use crate::http::extract::idempotency;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::keys::Scope;

/// Post what an agent did for a task: events per turn. The answer comes when it is durable; grading follows.
///
/// With `Content-Type: application/x-ndjson`, one submission a line: all are accepted in one transaction, or none.
/// Within a run a task is answered once; posting the same log again gives the same submission.
#[utoipa::path(
    post, path = "/v1/submissions", operation_id = "create_submission", tag = "submissions", summary = "Post a submission",
    params(("Idempotency-Key" = Option<String>, Header, description = "The same request with the same key is carried out once, for 24 hours: its answer is repeated")),
    request_body(content((NewSubmissionBody = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 202, description = "Accepted; for NDJSON a list in the order of the lines", body = AcceptedAnswer,
         headers(("Location" = String, description = "The submission; only for a JSON body")),
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000001", "repeated": false })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The task was answered otherwise, or the run takes no more", body = Problem,
         content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Neither JSON nor NDJSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Faults, all of them", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much action code waits; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn create_submission(
    State(state): State<AppState>,
    caller: Caller,
    headers: HeaderMap,
    body: JsonBody,
) -> AppResult<Response> {
    caller.require(Scope::Submit)?;
    let underway = state.in_flight.begin(&headers, &caller, "create_submission", &body.bytes)?;
    let once = underway.as_ref().map(|underway| underway.once.clone());
    let JsonBody { bytes, format, share: _share } = body;
    let Acceptance { submissions, is_replayed } = accept(&state, &caller, bytes, format, once).await?;
    let mut response = accepted_answer(submissions.into_iter().map(AcceptedBody::from).collect(), format);
    if is_replayed {
        response.headers_mut().extend([idempotency::REPLAYED]);
    }
    Ok(response)
}

fn accepted_answer(accepted: Vec<AcceptedBody>, format: Format) -> Response {
    if format == Format::NdJson {
        return (StatusCode::ACCEPTED, Json(AcceptedList { submissions: accepted })).into_response();
    }
    let one = accepted.into_iter().next().expect("a JSON body without faults holds one submission");
    let mut headers = HeaderMap::new();
    headers.insert(header::LOCATION, location(&one.id));
    (StatusCode::ACCEPTED, headers, Json(one)).into_response()
}

/// Check a submission, or many, without submitting: everything that posting checks, with all faults at once. Nothing is
/// stored or graded, and it costs nothing.
#[utoipa::path(
    post, path = "/v1/validate", operation_id = "validate_submission", tag = "submissions",
    summary = "Check a submission without submitting",
    request_body(content((NewSubmissionBody = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 200, description = "All of it would be accepted", body = ValidatedList,
         example = json!({ "submissions": [{ "suite": "mineceraft@2", "number": 113, "turns": 1, "events": 25,
                                            "log_hash": "9f86d081884c7d65…", "repeated": false }] })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The task was answered otherwise, or the run takes no more", body = Problem,
         content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Neither JSON nor NDJSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Faults, all of them", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much action code waits; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn validate_submission(
    State(state): State<AppState>,
    caller: Caller,
    body: JsonBody,
) -> AppResult<Json<ValidatedList>> {
    let JsonBody { bytes, format, share: _share } = body;
    let valid = validate(&state, &caller, bytes, format).await?;
    let submissions = valid.iter().map(|(new, accepted)| Validated::of(new, accepted.repeated)).collect();
    Ok(Json(ValidatedList { submissions }))
}

/// The address of a submission.
fn location(id: &str) -> HeaderValue {
    HeaderValue::from_str(&format!("/v1/submissions/{id}")).expect("an id is a UUID")
}

//! Creating and validating submissions.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};

use super::body::{AcceptedAnswer, AcceptedBody, AcceptedList, Validated, ValidatedList};
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::submissions::accept::{Acceptance, accept, validate};
use crate::app::submissions::posted::{Format, NewSubmissionBody};
use crate::http::extract::body::JsonBody;
use crate::http::extract::idempotency;
use crate::http::state::AppState;
use crate::store::keys::Scope;

/// Accepts an agent's work on a task.
///
/// The body has the events of each turn. The response is sent once the submission is durable; grading follows.
///
/// With `Content-Type: application/x-ndjson`, the body has one submission per line: either all are accepted, in one
/// transaction, or none. A run answers each task once; posting the same log again returns the same submission.
#[utoipa::path(
    post, path = "/v1/submissions", operation_id = "create_submission", tag = "submissions", summary = "Post a submission",
    params(("Idempotency-Key" = Option<String>, Header, description = "A request that is repeated with the same key within 24 hours is carried out only once, and its response is repeated")),
    request_body(content((NewSubmissionBody = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 202, description = "Accepted; for NDJSON, a list in the order of the lines", body = AcceptedAnswer,
         headers(("Location" = String, description = "URL of the submission; only for a JSON body")),
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000001", "repeated": false })),
        (status = 409, description = "The task was answered otherwise, or the run takes no more"),
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

/// Checks one or many submissions without submitting them.
///
/// Everything that posting checks is checked, and all faults are reported at once. Nothing is stored or graded, and no
/// quota is used.
#[utoipa::path(
    post, path = "/v1/validate", operation_id = "validate_submission", tag = "submissions",
    summary = "Check a submission without submitting it",
    request_body(content((NewSubmissionBody = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 200, description = "All submissions would be accepted", body = ValidatedList,
         example = json!({ "submissions": [{ "suite": "mineceraft@4", "number": 113, "turns": 1, "events": 25,
                                            "log_hash": "9f86d081884c7d65…", "repeated": false }] })),
        (status = 409, description = "The task was answered otherwise, or the run takes no more"),
    )
)]
pub async fn validate_submission(
    State(state): State<AppState>,
    caller: Caller,
    body: JsonBody,
) -> AppResult<Json<ValidatedList>> {
    let JsonBody { bytes, format, share: _share } = body;
    let valid = validate(&state, &caller, bytes, format).await?;
    let submissions = valid.iter().map(|(new, accepted)| Validated::of(new, accepted)).collect();
    Ok(Json(ValidatedList { submissions }))
}

/// Returns the URL path of a submission.
fn location(id: &str) -> HeaderValue {
    HeaderValue::from_str(&format!("/v1/submissions/{id}")).expect("an id is a UUID")
}

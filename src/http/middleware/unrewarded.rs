//! Adds `"reward": null` to refusals of reward requests that are not the sender's fault, even if no handler was
//! reached, for example while the database is unreachable.

use axum::body::{Body, to_bytes};
use axum::http::{StatusCode, header};
use axum::response::Response;

use crate::http::problem::PROBLEM_JSON;

/// Ends of the paths of requests for a reward. A new adapter belongs here, and into `GRADING` in `role.rs`.
const REWARD_PATHS: [&str; 5] = ["/v1/grade", "/v1/grade:structure", "/v1/grade:batch", "/verify", "/get_reward"];

/// Greatest size of a problem document, in bytes.
const MAX_PROBLEM_BYTES: usize = 1 << 20;

/// Returns whether a path is that of a request for a reward.
pub(super) fn is_reward_request(path: &str) -> bool {
    REWARD_PATHS.iter().any(|end| path.ends_with(end))
}

/// Adds `"reward": null` to a problem document of ours, or of too much load, that lacks it.
pub(super) async fn with_null_reward(response: Response) -> Response {
    let status = response.status();
    let is_ours =
        status.is_server_error() || [StatusCode::TOO_MANY_REQUESTS, StatusCode::REQUEST_TIMEOUT].contains(&status);
    let is_problem = response.headers().get(header::CONTENT_TYPE).is_some_and(|kind| kind == PROBLEM_JSON);
    if !is_ours || !is_problem {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    let Ok(bytes) = to_bytes(body, MAX_PROBLEM_BYTES).await else {
        return Response::from_parts(parts, Body::empty());
    };
    let mut problem = bytes.to_vec();
    if !bytes.windows(REWARD.len()).any(|window| window == REWARD) && problem.pop_if(|last| *last == b'}').is_some() {
        problem.extend_from_slice(b",\"reward\":null}");
        parts.headers.remove(header::CONTENT_LENGTH);
    }
    Response::from_parts(parts, Body::from(problem))
}

/// Name of the member, as a problem document has it.
const REWARD: &[u8] = b"\"reward\":";

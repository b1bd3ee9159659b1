//! The public list that siblings are drawn from.

use axum::body::Bytes;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;

use crate::app::error::AppResult;
use crate::app::hidden::siblings::siblings;
use crate::http::extract::conditional::has_tag;
use crate::http::extract::params::Params;
use plumbline_engine::hidden::GENERATOR_VERSION;

/// Query of the list of siblings.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SiblingsQuery {
    /// Version of the generator, as in an epoch's commitment; the latest by default.
    #[param(minimum = 1)]
    generator_version: Option<u32>,
}

/// Lists the public siblings.
///
/// Siblings are the specifications from which official runs draw a sibling for each hidden instance, one per line:
/// prompts, parameters and checks. The list is the same for all epochs of a version, and anybody may train on it; the
/// epoch's commitment has its root.
#[utoipa::path(
    get, path = "/v1/siblings", operation_id = "list_siblings", tag = "hidden evaluation", summary = "List public siblings",
    params(SiblingsQuery),
    responses(
        (status = 200, description = "One JSON object per line, with leaf and task", body = String, content_type = "application/x-ndjson",
         example = "{\"leaf\":0,\"task\":{\"id\":\"slabs/sibling-00000\",\"turns\":[{\"prompt\":\"Build a slab …\"}]}}\n"),
        (status = 304, description = "Not changed"),
        (status = 404, description = "No such version of the generator draws siblings"),
    )
)]
pub async fn list_siblings(Params(query): Params<SiblingsQuery>, headers: HeaderMap) -> AppResult<Response> {
    let version = query.generator_version.unwrap_or(GENERATOR_VERSION);
    // Fails if there is no such version.
    let list = siblings(version).await?;
    let etag = format!("\"{}\"", list.list().root);
    let kept = [
        (header::CONTENT_TYPE, "application/x-ndjson".to_owned()),
        (header::CACHE_CONTROL, "public, max-age=86400".to_owned()),
        (header::ETAG, etag.clone()),
    ];
    if has_tag(&headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, kept).into_response());
    }
    Ok((kept, Bytes::from_static(list.lines().as_bytes())).into_response())
}

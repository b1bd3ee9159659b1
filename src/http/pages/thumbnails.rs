//! Pictures of builds as PNG, small ones for pages and larger ones for previews of messengers, drawn once and kept.

use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;

use super::html::PageResult;
use super::submission::picture_of;
use crate::app::catalogue::tasks::example;
use crate::app::error::{AppError, AppResult};
use crate::app::runs::read::answer;
use crate::app::submissions::read::{log, stored};
use crate::http::extract::caller::Reader;
use crate::http::extract::conditional::Document;
use crate::http::state::AppState;
use crate::pictures::raster::png;
use plumbline_engine::voxel::BlockLog;
use plumbline_engine::voxel::replay::Replay;

/// Longer side of a thumbnail, in pixels: twice that on the page, for sharp screens.
pub const THUMBNAIL: u32 = 320;
/// Longer side of a preview for messengers, in pixels.
pub const PREVIEW: u32 = 1_200;

/// Serves a picture of the build of a submission.
///
/// # Errors
/// Returns a 404 error if the submission does not exist.
pub async fn of_submission<const SIDE: u32>(
    State(state): State<AppState>,
    Reader(who): Reader,
    asked: HeaderMap,
    Path(id): Path<String>,
) -> PageResult {
    let id = stored(&state, &id).await?.id;
    let read = async || {
        let json = log(&state, &id).await?;
        BlockLog::from_canonical_json(&json).map_err(|error| AppError::internal(&error))
    };
    Ok(drawn::<SIDE>(&state, &who, &asked, format!("submission {id}"), read).await?)
}

/// Serves a picture of a run's build for a task.
///
/// # Errors
/// Returns a 404 error if the run has no submission for the task.
pub async fn of_run<const SIDE: u32>(
    state: State<AppState>,
    reader: Reader,
    asked: HeaderMap,
    Path((run, number)): Path<(String, u32)>,
) -> PageResult {
    let row = answer(&state, &run, number).await?;
    let mut response = of_submission::<SIDE>(state, reader, asked, Path(row.id)).await?;
    // Until the run has ended, another submission may take the place of this one.
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("public, no-cache"));
    Ok(response)
}

/// Serves a picture of the reference build of a task.
///
/// # Errors
/// Returns a 404 error if the suite or the task does not exist, or no builder can build it.
pub async fn of_task<const SIDE: u32>(
    State(state): State<AppState>,
    Reader(who): Reader,
    asked: HeaderMap,
    Path((suite, number)): Path<(String, u32)>,
) -> PageResult {
    let suite = state.suite(&suite).await?.suite.id();
    let read = async || example(&state, &suite, number).await;
    Ok(drawn::<SIDE>(&state, &who, &asked, format!("task {suite} {number}"), read).await?)
}

/// Returns the picture of a build; draws it if nobody has asked for it lately.
async fn drawn<const SIDE: u32>(
    state: &AppState,
    who: &Arc<str>,
    asked: &HeaderMap,
    what: String,
    read: impl AsyncFnOnce() -> AppResult<BlockLog>,
) -> AppResult<Response> {
    // Another version of the program may draw otherwise.
    let name = format!("thumbnail {} {SIDE} {what}", env!("CARGO_PKG_VERSION"));
    if let Some(response) = state.documents.known(asked, &name) {
        return Ok(kept_for_a_day(response));
    }
    let slot = state.file_slots.take(who).await;
    let log = read().await?;
    let drawing = tokio::task::spawn_blocking(move || {
        // Held until the work ends, also if the sender no longer waits.
        let _slot = slot;
        let svg = Replay::new(&log).last().map(|end| picture_of(&end)).unwrap_or_default();
        png(&svg, SIDE)
    });
    let drawn = drawing.await.map_err(|error| AppError::internal(&error))?;
    let bytes = drawn.map_err(|error| AppError::internal(&error))?.into();
    Ok(kept_for_a_day(state.documents.keep(asked, name, &Document { kind: "image/png", bytes })))
}

/// What a submission or a version of a suite holds never changes.
fn kept_for_a_day(mut response: Response) -> Response {
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("public, max-age=86400"));
    response
}

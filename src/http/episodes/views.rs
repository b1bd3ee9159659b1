//! The world of an episode, as blocks and as a picture.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;

use crate::app::access::Caller;
use crate::app::episodes::body::Region;
use crate::app::episodes::state::Episode;
use crate::app::episodes::view::{View, picture, seen};
use crate::app::error::{AppError, AppResult};
use crate::http::extract::params::{Params, position};
use crate::http::state::AppState;
use crate::pictures::isometric::Corner;

/// Media type of bytes of any kind.
const BYTES: &str = "application/octet-stream";

/// Query parameters of a box.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ViewQuery {
    /// One corner: `x,y,z`.
    #[param(example = "-2,-1,-2")]
    from: String,
    /// The opposite corner: `x,y,z`.
    #[param(example = "6,4,6")]
    to: String,
}

/// Returns the blocks of a box of the world.
///
/// The ground is included.
#[utoipa::path(
    get, path = "/v1/episodes/{id}/view", operation_id = "view_episode", tag = "episodes", summary = "View a box of the world",
    params(("id" = String, Path, description = "The episode's id"), ViewQuery),
    responses(
        (status = 200, description = "The blocks; cells that are not listed are air", body = View,
         example = json!({ "from": [0, -1, 0], "to": [1, 0, 0], "palette": ["grass_block", "stone"],
                           "rows": [[0, -1, 0, 0], [1, -1, 0, 0], [0, 0, 0, 1]] })),
        (status = 401, description = "No key"),
        (status = 403, description = "It is another owner's"),
    ),
    security(("key" = []))
)]
pub async fn view_episode(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    Params(query): Params<ViewQuery>,
) -> AppResult<Json<View>> {
    let (from, to) = (position("from", &query.from)?, position("to", &query.to)?);
    let region = Region::between(from, to).map_err(|why| AppError::wrong_parameter("to", why))?;
    let episode = Episode::of_caller(&state, &caller, &id).await?;
    Ok(Json(seen(&episode.stored.world, region)))
}

/// Bytes of a picture.
#[derive(Debug, utoipa::ToSchema)]
#[schema(value_type = String, format = Binary)]
pub struct PictureFile(pub Vec<u8>);

/// Query parameters of a picture.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PictureQuery {
    /// Corner from which the build is seen; `south-east` by default.
    #[param(inline)]
    #[serde(default)]
    from: Corner,
}

/// Draws what was built.
///
/// The picture shows it from above and from a corner, for agents that see. From the south-east, x grows to the lower
/// right and z to the lower left.
#[utoipa::path(
    get, path = "/v1/episodes/{id}/picture", operation_id = "picture_episode", tag = "episodes", summary = "Draw what was built",
    params(("id" = String, Path, description = "The episode's id"), PictureQuery),
    responses(
        (status = 200, description = "The picture, as `image/png` unless only `application/octet-stream` is accepted",
         content((PictureFile = "image/png", example = json!("(bytes)")),
                 (PictureFile = "application/octet-stream", example = json!("(bytes)")))),
        (status = 401, description = "No key"),
        (status = 403, description = "It is another owner's"),
    ),
    security(("key" = []))
)]
pub async fn picture_episode(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    Params(query): Params<PictureQuery>,
    headers: HeaderMap,
) -> AppResult<Response> {
    let slot = state.file_slots.take(caller.who()).await;
    let episode = Episode::of_caller(&state, &caller, &id).await?;
    let drawing = tokio::task::spawn_blocking(move || {
        // Held until the work ends, also if the sender no longer waits.
        let _slot = slot;
        picture(&episode.stored.world, query.from)
    });
    let file = drawing.await.map_err(|error| AppError::internal(&error))??;
    // Generated clients know bytes by this name.
    let is_plain = headers.get(header::ACCEPT).is_some_and(|accepted| accepted == BYTES);
    let kind = HeaderValue::from_static(if is_plain { BYTES } else { "image/png" });
    Ok(([(header::CONTENT_TYPE, kind)], file).into_response())
}

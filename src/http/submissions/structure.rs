//! Builds of submissions as structure files.

use axum::extract::{Path, State};
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;

use crate::app::error::{AppError, AppResult};
use crate::app::submissions::read;
use crate::formats::FileFormat;
use crate::http::extract::caller::Reader;
use crate::http::extract::params::Params;
use crate::http::state::AppState;

/// Header with the position of the least corner of the build in a file.
const CORNER_HEADER: HeaderName = HeaderName::from_static("x-plumbline-corner");

/// Bytes of a structure file: `.nbt`, `.schem` or `.litematic`.
#[derive(Debug, utoipa::ToSchema)]
#[schema(value_type = String, format = Binary)]
pub struct StructureFile(pub Vec<u8>);

/// Query parameters that select a structure file.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct StructureQuery {
    /// Format of the file; `nbt` by default.
    #[param(inline)]
    #[serde(default)]
    format: FileFormat,
    /// Number of the turn after which the build stands, from 1; by default the last.
    #[param(minimum = 1)]
    turn: Option<usize>,
}

/// Returns a build as a structure file.
///
/// The file has what stands after a turn, for the game and its tools. Blocks have the state in which the game places
/// them by default, because logs name materials; the upper half of a door is recognised.
#[utoipa::path(
    get, path = "/v1/submissions/{id}/structure", operation_id = "get_structure", tag = "submissions",
    summary = "Download a build",
    params(("id" = String, Path, description = "The submission's id"), StructureQuery),
    responses(
        (status = 200, description = "The file", body = StructureFile, content_type = "application/octet-stream",
         headers(("x-plumbline-corner" = String, description = "Position `x,y,z` of the build's least corner. A `.nbt` does not hold it; the others are pasted at (0, 0, 0)")),
         example = json!("(bytes)")),
        (status = 409, description = "The blocks are too far apart for the format"),
    )
)]
pub async fn get_structure(
    State(state): State<AppState>,
    Reader(who): Reader,
    Path(id): Path<String>,
    Params(query): Params<StructureQuery>,
) -> AppResult<Response> {
    let ([x, y, z], file) = read::structure_file(&state, &who, &id, query.turn, query.format).await?;
    let name = format!("attachment; filename=\"{id}.{}\"", query.format.extension());
    let header = |text: String| HeaderValue::from_str(&text).map_err(|error| AppError::internal(&error));
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream")),
        (header::CONTENT_DISPOSITION, header(name)?),
        (CORNER_HEADER, header(format!("{x},{y},{z}"))?),
    ];
    Ok((headers, file).into_response())
}

//! Stress fields of submissions, computed when first requested.

use std::fmt::Write as _;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest as _, Sha256};

use crate::app::error::{AppError, AppResult};
use crate::app::submissions::read::stored;
use crate::app::submissions::stress::{StressedStructure, of_submission, turn_of};
use crate::http::extract::caller::Reader;
use crate::http::extract::conditional::has_tag;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use crate::store::reports::GRADER;
use plumbline_engine::elasticity::field::{FIELD_VERSION, Field, Method};
use plumbline_engine::tasks::hex;
use plumbline_engine::voxel::{Cell, Structure};

/// Query parameters that select a stress field and its format.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct StressQuery {
    /// Method: the published simulation (`sph`, the default), or equilibrium by finite elements (`fem`).
    #[param(example = "fem")]
    method: Option<Method>,
    /// Turn, from 1, after which the structure is examined. The default is the last turn.
    #[param(minimum = 1, example = 1)]
    turn: Option<usize>,
    /// Format: an object per block (`json`), a line per block (`ndjson`), or an array per quantity (`arrays`). By
    /// default `ndjson` if `Accept` asks for it, else `json`.
    #[param(inline)]
    format: Option<StressFormat>,
}

/// Format of a stress field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StressFormat {
    /// One document with an object per block.
    Json,
    /// One line per block, each a JSON object.
    Ndjson,
    /// One document with an array per quantity: the smallest.
    Arrays,
}

/// A block in a stress field.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct StressedBlock<'a> {
    /// The cell, as `[x, y, z]`.
    #[schema(value_type = [i32; 3])]
    pub cell: Cell,
    /// Name of its material.
    #[schema(example = "stone")]
    pub material: &'a str,
    /// Von Mises stress, in Pa; null if the method leaves the block out.
    #[schema(example = 5876.85)]
    pub von_mises_pa: Option<f64>,
    /// Displacement of the centre to the east, up and to the south, in m (blocks); null if the method gives none.
    pub displacement_m: Option<[f64; 3]>,
}

/// A stress field.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct StressBody<'a> {
    /// Identifier of the submission.
    #[schema(format = Uuid)]
    pub submission: &'a str,
    /// Turn, from 1, after which the structure was examined.
    pub turn: usize,
    /// Method that computed the field.
    pub method: Method,
    /// Greatest von Mises stress, in Pa; null if it is not a number.
    pub max_von_mises_pa: Option<f64>,
    /// Reasons to read the field with care.
    pub cautions: &'a [String],
    /// The blocks, in the order of the structure.
    pub blocks: Vec<StressedBlock<'a>>,
}

/// A stress field with an array per quantity, all in the order of the structure.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct StressArrays {
    /// Identifier of the submission.
    #[schema(format = Uuid)]
    submission: String,
    /// Turn, from 1, after which the structure was examined.
    turn: usize,
    /// Method that computed the field.
    method: Method,
    /// Greatest von Mises stress, in Pa; null if it is not a number.
    max_von_mises_pa: Option<f64>,
    /// Reasons to read the field with care.
    cautions: Vec<String>,
    /// Names of materials.
    palette: Vec<String>,
    /// Cells, as `[x, y, z]`.
    cells: Vec<[i32; 3]>,
    /// Material of each block, as an index into the palette.
    materials: Vec<u32>,
    /// Von Mises stress of each block, in Pa.
    von_mises_pa: Vec<Option<f64>>,
    /// Displacement of each block's centre, in m.
    displacement_m: Vec<Option<[f64; 3]>>,
}

/// A stress field as one JSON document.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum StressAnswer {
    /// With an object per block.
    Blocks(StressBody<'static>),
    /// With an array per quantity.
    Arrays(StressArrays),
}

/// Returns the stress field of a build.
///
/// The field has the stress (Pa) and the displacement (m) of each block that a submission built. They are computed
/// from the log on request, also for tasks without a stress check.
#[utoipa::path(
    get, path = "/v1/submissions/{id}/stress", operation_id = "get_stress", tag = "submissions",
    summary = "Get a stress field",
    params(("id" = String, Path, description = "The submission's id"), StressQuery),
    responses(
        (status = 200, description = "The stress field",
         content(
            (StressAnswer = "application/json",
             example = json!({ "submission": "0198c0de-0000-7000-8000-000000000001", "turn": 1, "method": "fem",
                               "max_von_mises_pa": 8177.7, "cautions": [],
                               "blocks": [{ "cell": [0, 0, 0], "material": "stone", "von_mises_pa": 8177.7,
                                            "displacement_m": [0.0, -1e-6, 0.0] }] })),
            (String = "application/x-ndjson", example = "{\"cell\":[0,0,0],\"material\":\"stone\",\"von_mises_pa\":8177.7}\n"),
         ),
         headers(("ETag" = String, description = "Tag of log, method, turn, format and grader; for If-None-Match"))),
        (status = 304, description = "The client already has the field"),
        (status = 422, description = "More blocks than stress is computed for, or it takes too long"),
        (status = 503, description = "Too many ask for stress; come back"),
    )
)]
pub async fn get_stress(
    State(state): State<AppState>,
    Path(id): Path<String>,
    Params(query): Params<StressQuery>,
    Reader(who): Reader,
    headers: HeaderMap,
) -> AppResult<Response> {
    let row = stored(&state, &id).await?;
    let accepts = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let wants_lines = accepts.trim_start().starts_with("application/x-ndjson");
    let format = query.format.unwrap_or(if wants_lines { StressFormat::Ndjson } else { StressFormat::Json });
    let method = query.method.unwrap_or(Method::Sph);
    let turn = turn_of(&row, query.turn)?;
    let named = format!("{id} {} {method:?} {turn} {format:?} {GRADER} {FIELD_VERSION}", row.log_hash);
    // The tag is weak because other kinds of processors may round differently.
    let etag = format!("W/\"{}\"", &hex(&Sha256::digest(named))[..32]);
    if has_tag(&headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, etag.as_str()), VARY]).into_response());
    }
    let StressedStructure { structure, field } = of_submission(&state, &who, &row, turn, method).await?;
    let writing = tokio::task::spawn_blocking(move || write(&id, &structure, &field, method, turn, format));
    let written = writing.await.map_err(|error| AppError::internal(&error))?;
    let body = written.map_err(|error| AppError::internal(&error))?;
    let kind = if format == StressFormat::Ndjson { "application/x-ndjson" } else { "application/json" };
    Ok(([(header::CONTENT_TYPE, kind), (header::ETAG, etag.as_str()), VARY], body).into_response())
}

/// `Vary` header, because the format may depend on `Accept`.
const VARY: (header::HeaderName, &str) = (header::VARY, "accept");

/// Writes a field in one of its formats.
///
/// # Errors
/// Returns an error if the field holds a value that JSON cannot express.
pub fn write(
    id: &str,
    structure: &Structure,
    field: &Field,
    method: Method,
    turn: usize,
    format: StressFormat,
) -> serde_json::Result<String> {
    let blocks = structure.cells().iter().enumerate().map(|(i, &cell)| StressedBlock {
        cell,
        material: structure.material(i),
        von_mises_pa: field.von_mises_pa[i],
        displacement_m: field.displacement_m[i],
    });
    match format {
        StressFormat::Json => serde_json::to_string(&StressBody {
            submission: id,
            turn,
            method,
            max_von_mises_pa: field.max_von_mises_pa,
            cautions: &field.cautions,
            blocks: blocks.collect(),
        }),
        StressFormat::Ndjson => {
            let mut lines = String::new();
            for block in blocks {
                // Writing to a string does not fail.
                let _ = writeln!(lines, "{}", serde_json::to_string(&block)?);
            }
            Ok(lines)
        }
        StressFormat::Arrays => serde_json::to_string(&json!({
            "submission": id,
            "turn": turn,
            "method": method,
            "max_von_mises_pa": field.max_von_mises_pa,
            "cautions": field.cautions,
            "palette": structure.palette().names().collect::<Vec<_>>(),
            "cells": structure.cells(),
            "materials": structure.material_ids(),
            "von_mises_pa": field.von_mises_pa,
            "displacement_m": field.displacement_m,
        })),
    }
}

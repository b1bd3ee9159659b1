//! Stress fields of submissions, computed when first asked for.

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest as _, Sha256};
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

use super::submission::stored;
use crate::fair::{FairSlots, Places};
use crate::http::caller::Reader;
use crate::http::conditional::has_tag;
use crate::http::grader::note_panic;
use crate::http::limits::LIMITS;
use crate::http::params::Params;
use crate::http::problem::{ApiError, ApiResult, Problem};
use crate::http::state::AppState;
use crate::store::reports::GRADER;
use crate::threads::yield_to_others;
use plumbline_engine::elasticity::Control;
use plumbline_engine::elasticity::field::{FIELD_VERSION, Field, Method};
use plumbline_engine::tasks::hex;
use plumbline_engine::voxel::replay::Replay;
use plumbline_engine::voxel::{BlockLog, Cell, Structure};

/// What a field is kept under: the log's hash, the turn, and the method.
type Key = (Box<str>, usize, Method);
/// A field, or when it took too long: by the clock, so with less to do it may not.
type Kept = Result<Arc<Field>, Instant>;

/// How long a field that took too long is not tried again.
const TOO_LONG_FOR: Duration = Duration::from_mins(1);

#[derive(Debug, Clone)]
struct ByMemory;

impl Weighter<Key, Kept> for ByMemory {
    fn weight(&self, key: &Key, field: &Kept) -> u64 {
        let bytes = field.as_ref().map_or(0, |field| {
            field.von_mises_pa.capacity() * size_of::<Option<f64>>()
                + field.displacement_m.capacity() * size_of::<Option<[f64; 3]>>()
                + field.cautions.iter().map(String::capacity).sum::<usize>()
        });
        (bytes + key.0.len() + OWN_BYTES) as u64
    }
}

/// What a field takes beside its numbers.
const OWN_BYTES: usize = 256;
/// How much the threads that compute fields yield to others (niceness).
const NICENESS: i32 = 10;

/// Computes stress fields: a few at once, one for each sender, and keeps them by content, so that asking again costs nothing.
#[derive(Debug)]
pub struct StressFields {
    admitted: Arc<Places>,
    slots: Arc<FairSlots>,
    threads: rayon::ThreadPool,
    kept: Cache<Key, Kept, ByMemory>,
}

impl StressFields {
    /// None kept yet.
    ///
    /// # Errors
    /// Where there are no threads to be had.
    pub fn new() -> anyhow::Result<Self> {
        const TYPICAL_BYTES: usize = 64 << 10;
        let at_once = LIMITS.stress_fields_at_once;
        let threads = rayon::ThreadPoolBuilder::new().num_threads(at_once).thread_name(|i| format!("stress-{i}"));
        let bytes = LIMITS.stress_cache_bytes;
        Ok(Self {
            admitted: Places::new(at_once + LIMITS.stress_fields_waiting, LIMITS.stress_fields_waiting_per_sender),
            slots: FairSlots::new(at_once, LIMITS.stress_fields_per_sender),
            threads: threads.start_handler(|_| yield_to_others(NICENESS)).panic_handler(note_panic).build()?,
            kept: Cache::with_weighter(bytes / TYPICAL_BYTES, bytes as u64, ByMemory),
        })
    }

    fn kept(&self, key: &Key) -> Option<Kept> {
        self.kept.get(key).filter(|kept| !kept.as_ref().is_err_and(|since| since.elapsed() > TOO_LONG_FOR))
    }

    /// The field of a structure.
    ///
    /// # Errors
    /// 503 where too many wait, it takes too long to begin, or the service stops; 422 where it takes too long to compute.
    async fn field(
        &self,
        key: Key,
        structure: &Arc<Structure>,
        who: &Arc<str>,
        stop: &CancellationToken,
    ) -> ApiResult<Arc<Field>> {
        let blocks = structure.len();
        if let Some(kept) = self.kept(&key) {
            return kept.map_err(|_| too_long(blocks));
        }
        let _admitted = self.admitted.take(who).map_err(|_| busy())?;
        let patience = Duration::from_secs(LIMITS.stress_wait_seconds);
        let slot = tokio::time::timeout(patience, self.slots.take(who)).await.map_err(|_late| busy())?;
        // Another request may have computed it meanwhile.
        if let Some(kept) = self.kept(&key) {
            return kept.map_err(|_| too_long(blocks));
        }
        // Where the client leaves or the service stops, the computation ends.
        let left = stop.child_token();
        let _guard = left.clone().drop_guard();
        let (answer, answered) = oneshot::channel();
        let (structure, method) = (Arc::clone(structure), key.2);
        self.threads.spawn_fifo(move || {
            let _slot = slot;
            let deadline = Instant::now() + Duration::from_secs(LIMITS.stress_seconds);
            let stop = || left.is_cancelled() || Instant::now() >= deadline;
            let field = Field::of(structure.cells(), method, &Control::until(&stop));
            // Whoever waited for it may have gone.
            let _ = answer.send(field.map_err(|_stopped| left.is_cancelled()));
        });
        match answered.await.map_err(|error| ApiError::internal(&error))? {
            Ok(field) => {
                metrics::counter!("plumbline_stress_fields_computed_total").increment(1);
                let field = Arc::new(field);
                self.kept.insert(key, Ok(Arc::clone(&field)));
                Ok(field)
            }
            Err(true) => {
                let detail = "The service stops. The request may be sent again.";
                Err(ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "stopping", "Stopping", detail).retry_after(5))
            }
            Err(false) => {
                self.kept.insert(key, Err(Instant::now()));
                Err(too_long(blocks))
            }
        }
    }
}

fn busy() -> ApiError {
    let detail = "Many stress fields are being computed. The request may be sent again.";
    ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "busy", "Busy", detail).retry_after(2)
}

fn too_long(blocks: usize) -> ApiError {
    let detail = format!("the stress of these {blocks} blocks takes longer than {} s", LIMITS.stress_seconds);
    ApiError::new(StatusCode::UNPROCESSABLE_ENTITY, "too-long", "Too long", detail)
}

/// Which field, and how it is written.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct StressQuery {
    /// The published simulation, or equilibrium by finite elements. Without it the published one.
    #[param(example = "fem")]
    method: Option<Method>,
    /// The structure after this turn, from 1. Without it the last.
    #[param(minimum = 1, example = 1)]
    turn: Option<usize>,
    /// An object per block; a line per block; or an array per quantity. Without it what `Accept` asks for, else objects.
    #[param(inline)]
    format: Option<StressFormat>,
}

impl StressQuery {
    /// The equilibrium of what stands in the end, as arrays.
    #[must_use]
    pub const fn equilibrium_as_arrays() -> Self {
        Self { method: Some(Method::Fem), turn: None, format: Some(StressFormat::Arrays) }
    }
}

/// How a stress field is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StressFormat {
    /// One document with an object per block.
    Json,
    /// One JSON object a line and block.
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
    /// Its material.
    #[schema(example = "stone")]
    pub material: &'a str,
    /// Von Mises stress, Pa; null where the method leaves the block out.
    #[schema(example = 5876.85)]
    pub von_mises_pa: Option<f64>,
    /// Displacement of the centre, m (blocks): east, up, south; null where the method gives none.
    pub displacement_m: Option<[f64; 3]>,
}

/// A stress field.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct StressBody<'a> {
    /// The submission.
    #[schema(format = Uuid)]
    pub submission: &'a str,
    /// The turn after which the structure stands, from 1.
    pub turn: usize,
    /// The method.
    pub method: Method,
    /// Greatest von Mises stress, Pa; null where there is no number.
    pub max_von_mises_pa: Option<f64>,
    /// Why the field must be read with care.
    pub cautions: &'a [String],
    /// The blocks, in the order of the structure.
    pub blocks: Vec<StressedBlock<'a>>,
}

/// A stress field with an array per quantity, all in the order of the structure.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct StressArrays {
    /// The submission.
    #[schema(format = Uuid)]
    submission: String,
    /// The turn after which the structure stands, from 1.
    turn: usize,
    /// The method.
    method: Method,
    /// Greatest von Mises stress, Pa; null where there is no number.
    max_von_mises_pa: Option<f64>,
    /// Why the field must be read with care.
    cautions: Vec<String>,
    /// Names of materials.
    palette: Vec<String>,
    /// Cells, as `[x, y, z]`.
    cells: Vec<[i32; 3]>,
    /// Material of each block, as an index into the palette.
    materials: Vec<u32>,
    /// Von Mises stress, Pa.
    von_mises_pa: Vec<Option<f64>>,
    /// Displacement, m.
    displacement_m: Vec<Option<[f64; 3]>>,
}

/// A stress field, as `format` asks for it.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum StressAnswer {
    /// With an object per block.
    Blocks(StressBody<'static>),
    /// With an array per quantity.
    Arrays(StressArrays),
}

/// Stress and displacement of each block of what a submission built, in Pa and m. Computed when asked for, from the log:
/// also for tasks without a stress check.
#[utoipa::path(
    get, path = "/v1/submissions/{id}/stress", operation_id = "get_stress", tag = "submissions",
    summary = "Get a stress field",
    params(("id" = String, Path, description = "The submission's id"), StressQuery),
    responses(
        (status = 200, description = "The field",
         content(
            (StressAnswer = "application/json",
             example = json!({ "submission": "0198c0de-0000-7000-8000-000000000001", "turn": 1, "method": "fem",
                               "max_von_mises_pa": 8177.7, "cautions": [],
                               "blocks": [{ "cell": [0, 0, 0], "material": "stone", "von_mises_pa": 8177.7,
                                            "displacement_m": [0.0, -1e-6, 0.0] }] })),
            (String = "application/x-ndjson", example = "{\"cell\":[0,0,0],\"material\":\"stone\",\"von_mises_pa\":8177.7}\n"),
         ),
         headers(("ETag" = String, description = "Names log, method, turn, format and grader; for If-None-Match"))),
        (status = 304, description = "The client has it"),
        (status = 400, description = "A query that cannot be read", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "There is no such submission or turn", body = Problem,
         content_type = "application/problem+json"),
        (status = 422, description = "More blocks than stress is computed for, or it takes too long", body = Problem,
         content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many ask for stress; come back", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub async fn get_stress(
    State(state): State<AppState>,
    Path(id): Path<String>,
    Params(query): Params<StressQuery>,
    Reader(who): Reader,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let row = stored(&state, &id).await?;
    let accepts = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let wants_lines = accepts.trim_start().starts_with("application/x-ndjson");
    let format = query.format.unwrap_or(if wants_lines { StressFormat::Ndjson } else { StressFormat::Json });
    let method = query.method.unwrap_or(Method::Sph);
    let turns = usize::try_from(row.turns).unwrap_or_default();
    let turn = query.turn.unwrap_or(turns);
    if !(1..=turns).contains(&turn) {
        return Err(ApiError::not_found(format!("there is no turn {turn}; the log has {turns}")));
    }
    let named = format!("{id} {} {method:?} {turn} {format:?} {GRADER} {FIELD_VERSION}", row.log_hash);
    // Weak: processors of another kind may round otherwise.
    let etag = format!("W/\"{}\"", &hex(&Sha256::digest(named))[..32]);
    if has_tag(&headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, etag.as_str()), VARY]).into_response());
    }
    let log = state.store.log_json(&id).await?;
    let log = log.ok_or_else(|| ApiError::not_found(format!("there is no submission {id:?}")))?;
    let replaying = tokio::task::spawn_blocking(move || structure_after(&log, turn));
    let structure = Arc::new(replaying.await.map_err(|error| ApiError::internal(&error))??);
    let key = (Box::from(row.log_hash.as_str()), turn, method);
    let field = state.stress.field(key, &structure, &who, &state.stop).await?;
    let writing = tokio::task::spawn_blocking(move || write(&id, &structure, &field, method, turn, format));
    let written = writing.await.map_err(|error| ApiError::internal(&error))?;
    let body = written.map_err(|error| ApiError::internal(&error))?;
    let kind = if format == StressFormat::Ndjson { "application/x-ndjson" } else { "application/json" };
    Ok(([(header::CONTENT_TYPE, kind), (header::ETAG, etag.as_str()), VARY], body).into_response())
}

/// The format may come from `Accept`.
const VARY: (header::HeaderName, &str) = (header::VARY, "accept");

/// What stands after a turn.
///
/// # Errors
/// 422 where it has more blocks than stress is computed for.
fn structure_after(log: &[u8], turn: usize) -> ApiResult<Structure> {
    let log = BlockLog::from_canonical_json(log).map_err(|error| ApiError::internal(&error))?;
    let structure = Replay::new(&log).nth(turn - 1).unwrap_or_else(|| Structure::from_named([]));
    let (blocks, most) = (structure.len(), LIMITS.blocks_with_stress);
    if blocks > most {
        let detail = format!("{blocks} blocks stand; stress is computed for at most {most}");
        return Err(ApiError::new(StatusCode::UNPROCESSABLE_ENTITY, "too-many-blocks", "Too many blocks", detail));
    }
    Ok(structure)
}

fn write(
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

//! Limits of the service (`/v1/limits`).

use axum::Json;
use axum::extract::State;

use crate::app::limits::Limits;
use crate::http::state::AppState;

/// Returns every limit that the service enforces.
#[utoipa::path(
    get, path = "/v1/limits", operation_id = "get_limits", tag = "service", summary = "Get the limits",
    responses((status = 200, description = "The limits in force", body = Limits,
               example = json!({ "body_bytes": 33_554_432, "events": 400_000, "blocks": 100_000 })))
)]
pub async fn get_limits(State(state): State<AppState>) -> Json<Limits> {
    Json(state.limits)
}

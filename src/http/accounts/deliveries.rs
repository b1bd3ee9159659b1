//! `/v1/webhooks/{id}/deliveries`: what was posted to a webhook, and what became of it.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::webhooks::manage;
use crate::clock::rfc3339;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use crate::store::deliveries::DeliveryRow;
use crate::store::states::DeliveryState;

/// A delivery to a webhook.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct DeliveryBody {
    /// Identifier of the delivery: the header `webhook-id` of each attempt.
    #[schema(example = "msg_0198c0de00007000800000000000000a")]
    pub id: String,
    /// Name of the event; `webhook.test` for a test.
    #[schema(example = "run.finished")]
    pub event: String,
    /// State of the delivery.
    pub state: DeliveryState,
    /// Number of attempts since it was stored, or since it was last delivered again.
    #[schema(minimum = 0)]
    pub attempts: i64,
    /// Time of the next attempt; null unless it is pending.
    #[schema(format = DateTime)]
    pub next_at: Option<String>,
    /// HTTP status of the last answer; null without an answer.
    pub last_status: Option<i64>,
    /// Description of the last failure; null without one.
    pub last_error: Option<String>,
    /// Time at which it was stored; that of the event is in the message.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Time at which it was delivered or given up; null while it is pending.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// The message.
    #[schema(value_type = Object)]
    pub message: Value,
}

impl From<DeliveryRow> for DeliveryBody {
    fn from(row: DeliveryRow) -> Self {
        Self {
            next_at: (row.state == DeliveryState::Pending).then(|| rfc3339(row.next_at_ms)),
            id: row.id,
            event: row.event,
            state: row.state,
            attempts: row.attempts,
            last_status: row.last_status,
            last_error: row.last_error,
            created_at: rfc3339(row.created_at_ms),
            ended_at: row.ended_at_ms.map(rfc3339),
            message: serde_json::from_str(&row.body).unwrap_or(Value::String(row.body)),
        }
    }
}

/// A page of deliveries.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct DeliveryPage {
    /// Deliveries, latest first.
    pub deliveries: Vec<DeliveryBody>,
    /// Value of `before` for the next page; null on the last page.
    pub next_before: Option<String>,
}

/// Query of deliveries.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct DeliveriesQuery {
    /// Only deliveries in this state; `dead` lists those that were given up.
    #[param(inline)]
    state: Option<DeliveryState>,
    /// Only deliveries before this one, for paging.
    before: Option<String>,
    /// Maximum number of deliveries on the page.
    #[param(minimum = 1)]
    limit: Option<u32>,
}

/// Lists the deliveries of a webhook.
///
/// Those that were made are kept for a week, those that were given up for a month.
#[utoipa::path(
    get, path = "/v1/webhooks/{id}/deliveries", operation_id = "list_deliveries", tag = "webhooks",
    summary = "List deliveries",
    security(("key" = [])),
    params(("id" = String, Path, description = "The webhook's id"), DeliveriesQuery),
    responses(
        (status = 200, description = "A page of deliveries", body = DeliveryPage,
         example = json!({ "deliveries": [], "next_before": null })),
        (status = 401, description = "No key, or none that is live"),
        (status = 403, description = "The key is neither the owner's own nor a manager's"),
    )
)]
pub async fn list_deliveries(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    Params(query): Params<DeliveriesQuery>,
) -> AppResult<Json<DeliveryPage>> {
    let DeliveriesQuery { state: wanted, before, limit } = query;
    let page = manage::deliveries(&state, &caller, &id, wanted, before.as_deref(), limit).await?;
    let next_before = page.next(|last| last.id.clone());
    Ok(Json(DeliveryPage { deliveries: page.items.into_iter().map(DeliveryBody::from).collect(), next_before }))
}

/// Tries a webhook out.
///
/// The service posts a message of type `webhook.test` to it.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/test", operation_id = "test_webhook", tag = "webhooks",
    summary = "Try a webhook out",
    params(("id" = String, Path, description = "The webhook's id")),
    responses(
        (status = 202, description = "The delivery; its list shows what became of it", body = DeliveryBody,
         example = json!({ "id": "msg_0198c0de00007000800000000000000a", "event": "webhook.test", "state": "pending", "attempts": 0 })),
        (status = 409, description = "The webhook is disabled, or has too many pending deliveries"),
    )
)]
pub async fn test_webhook(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<(StatusCode, Json<DeliveryBody>)> {
    Ok((StatusCode::ACCEPTED, Json(manage::try_out(&state, &caller, &id).await?.into())))
}

/// Delivers a message again.
///
/// The message may have been delivered or given up; a pending one is tried at once. Message and identifier stay the
/// same.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/deliveries/{delivery}/retry", operation_id = "retry_delivery", tag = "webhooks",
    summary = "Deliver again",
    params(("id" = String, Path, description = "The webhook's id"), ("delivery" = String, Path, description = "The delivery's id")),
    responses(
        (status = 202, description = "The delivery", body = DeliveryBody,
         example = json!({ "id": "msg_0198c0de00007000800000000000000a", "event": "run.finished", "state": "pending", "attempts": 0 })),
        (status = 409, description = "The webhook is disabled"),
    )
)]
pub async fn retry_delivery(
    State(state): State<AppState>,
    caller: Caller,
    Path((id, delivery)): Path<(String, String)>,
) -> AppResult<(StatusCode, Json<DeliveryBody>)> {
    Ok((StatusCode::ACCEPTED, Json(manage::retry(&state, &caller, &id, &delivery).await?.into())))
}

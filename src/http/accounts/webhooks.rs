//! `/v1/webhooks`: addresses to which the service posts the events of an owner.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde::Serialize;

use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::webhooks::body::{NewWebhookBody, WebhookChangeBody};
use crate::app::webhooks::manage;
use crate::app::webhooks::message::WebhookEvent;
use crate::clock::rfc3339;
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::state::AppState;
use crate::store::webhooks::WebhookRow;

/// A webhook.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct WebhookBody {
    /// Identifier of the webhook.
    #[schema(format = Uuid)]
    pub id: String,
    /// URL to which events are posted.
    #[schema(example = "https://lab.example/plumbline")]
    pub url: String,
    /// Events that are posted.
    pub events: Vec<WebhookEvent>,
    /// Whether events are posted now.
    pub enabled: bool,
    /// Reason why it is disabled; null while it is enabled.
    pub disabled_reason: Option<String>,
    /// Time of creation.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Secret that signs messages; only in the answer that creates or changes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw")]
    pub secret: Option<String>,
}

/// Webhooks of an owner.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct WebhookList {
    /// Webhooks, oldest first.
    pub webhooks: Vec<WebhookBody>,
}

impl From<WebhookRow> for WebhookBody {
    fn from(row: WebhookRow) -> Self {
        let is_chosen = |event: &WebhookEvent| row.wants(event.name());
        Self {
            events: WebhookEvent::ALL.into_iter().filter(is_chosen).collect(),
            id: row.id,
            url: row.url,
            enabled: row.disabled_reason.is_none(),
            disabled_reason: row.disabled_reason,
            created_at: rfc3339(row.created_at_ms),
            secret: None,
        }
    }
}

impl WebhookBody {
    fn with_secret(row: WebhookRow) -> Self {
        let secret = Some(row.secret.clone());
        Self { secret, ..row.into() }
    }
}

/// Creates a webhook.
///
/// From now on, the service posts each event of the owner's runs and submissions to its URL, by the convention of
/// Standard Webhooks. The caller's key must be the owner's own, or a manager's.
///
/// A message is a JSON object with `type`, `timestamp` and `data`, which is what `/v1/events` sends. Its headers are
/// `webhook-id`, which is the same in every attempt, `webhook-timestamp` and `webhook-signature`. An endpoint that
/// answers with a status from 200 to 299 has received it. After any other answer, or none, the service tries again:
/// it makes ten attempts within three and a half days by default, and then keeps the message as dead. 410 disables the webhook.
/// Redirects are not followed.
#[utoipa::path(
    post, path = "/v1/webhooks", operation_id = "create_webhook", tag = "webhooks", summary = "Create a webhook",
    request_body(content = NewWebhookBody, content_type = "application/json"),
    responses(
        (status = 201, description = "The webhook with its secret, which is shown only here", body = WebhookBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "url": "https://lab.example/plumbline",
             "events": ["run.finished"], "enabled": true, "disabled_reason": null,
             "created_at": "2026-11-21T07:00:00.000Z", "secret": "whsec_…" })),
        (status = 409, description = "The owner has too many webhooks"),
    )
)]
pub async fn create_webhook(
    State(state): State<AppState>,
    caller: Caller,
    body: JsonBody,
) -> AppResult<(StatusCode, Json<WebhookBody>)> {
    // A caller who may not is refused before the body is read.
    caller.require_manager()?;
    let (draft, faults) = read_draft::<NewWebhookBody>(&body, "create one webhook per request")?;
    let row = manage::create(&state, &caller, draft, faults).await?;
    Ok((StatusCode::CREATED, Json(WebhookBody::with_secret(row))))
}

/// Lists the webhooks of the caller's owner.
///
/// Secrets are not shown.
#[utoipa::path(
    get, path = "/v1/webhooks", operation_id = "list_webhooks", tag = "webhooks", summary = "List webhooks",
    security(("key" = [])),
    responses(
        (status = 200, description = "Webhooks, oldest first", body = WebhookList, example = json!({ "webhooks": [] })),
        (status = 401, description = "No key, or none that is live"),
        (status = 403, description = "The key is neither the owner's own nor a manager's"),
    )
)]
pub async fn list_webhooks(State(state): State<AppState>, caller: Caller) -> AppResult<Json<WebhookList>> {
    let webhooks = manage::list(&state, &caller).await?.into_iter().map(WebhookBody::from).collect();
    Ok(Json(WebhookList { webhooks }))
}

/// Returns a webhook.
///
/// The secret is not shown.
#[utoipa::path(
    get, path = "/v1/webhooks/{id}", operation_id = "get_webhook", tag = "webhooks", summary = "Get a webhook",
    security(("key" = [])),
    params(("id" = String, Path, description = "The webhook's id")),
    responses(
        (status = 200, description = "The webhook", body = WebhookBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "url": "https://lab.example/plumbline",
             "events": ["run.finished"], "enabled": true, "disabled_reason": null, "created_at": "2026-11-21T07:00:00.000Z" })),
        (status = 401, description = "No key, or none that is live"),
        (status = 403, description = "The key is neither the owner's own nor a manager's"),
    )
)]
pub async fn get_webhook(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<WebhookBody>> {
    Ok(Json(manage::own(&state, &caller, &id).await?.into()))
}

/// Changes a webhook.
///
/// The body may have a URL, events, and whether it is enabled. What is left out stays as it is.
#[utoipa::path(
    put, path = "/v1/webhooks/{id}", operation_id = "put_webhook", tag = "webhooks", summary = "Change a webhook",
    params(("id" = String, Path, description = "The webhook's id")),
    request_body(content = WebhookChangeBody, content_type = "application/json"),
    responses(
        (status = 200, description = "The webhook", body = WebhookBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "url": "https://lab.example/plumbline",
             "events": ["run.finished"], "enabled": true, "disabled_reason": null, "created_at": "2026-11-21T07:00:00.000Z" })),
    )
)]
pub async fn put_webhook(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Json<WebhookBody>> {
    caller.require_manager()?;
    let (draft, faults) = read_draft::<WebhookChangeBody>(&body, "change one webhook per request")?;
    Ok(Json(manage::change(&state, &caller, &id, draft, faults).await?.into()))
}

/// Deletes a webhook.
///
/// The webhook's deliveries are deleted too.
#[utoipa::path(
    delete, path = "/v1/webhooks/{id}", operation_id = "delete_webhook", tag = "webhooks", summary = "Delete a webhook",
    params(("id" = String, Path, description = "The webhook's id")),
    responses(
        (status = 200, description = "The webhook as it was", body = WebhookBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "url": "https://lab.example/plumbline",
             "events": ["run.finished"], "enabled": true, "disabled_reason": null, "created_at": "2026-11-21T07:00:00.000Z" })),
    )
)]
pub async fn delete_webhook(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<WebhookBody>> {
    Ok(Json(manage::delete(&state, &caller, &id).await?.into()))
}

/// Gives a webhook a new secret.
///
/// For a day, the one before signs too, so that no message fails meanwhile.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/secret", operation_id = "change_webhook_secret", tag = "webhooks",
    summary = "Change the secret of a webhook",
    params(("id" = String, Path, description = "The webhook's id")),
    responses(
        (status = 200, description = "The webhook with its new secret, which is shown only here", body = WebhookBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "url": "https://lab.example/plumbline",
             "events": ["run.finished"], "enabled": true, "disabled_reason": null,
             "created_at": "2026-11-21T07:00:00.000Z", "secret": "whsec_…" })),
    )
)]
pub async fn change_webhook_secret(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<WebhookBody>> {
    Ok(Json(WebhookBody::with_secret(manage::change_secret(&state, &caller, &id).await?)))
}

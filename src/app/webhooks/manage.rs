//! Creating, changing and looking at webhooks and their deliveries.

use uuid::Uuid;

use super::body::{NewWebhookBody, WebhookChangeBody, check_url, names_of};
use super::message::{TEST, new_message_id, new_secret, test_message};
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::app::paging::{Page, page_items};
use crate::clock::{DAY_MS, now_ms};
use crate::store::deliveries::{DeliveryRow, NewDelivery};
use crate::store::states::DeliveryState;
use crate::store::webhooks::{Enabling, NewWebhook, WebhookChange, WebhookRow};
use plumbline_engine::intake::Faults;

/// Reason of a webhook that its owner disabled.
const BY_OWNER: &str = "disabled by its owner";

/// Creates a webhook. Returns it with its secret.
///
/// # Errors
/// Returns an error if the caller may not manage what belongs to its owner, all faults of the webhook, or a conflict if
/// the owner has too many.
pub async fn create(
    app: &App,
    caller: &Caller,
    draft: Option<NewWebhookBody>,
    mut faults: Faults,
) -> AppResult<WebhookRow> {
    let owner = app.manager(caller).await?;
    let (url, events) = draft.map(|draft| (draft.url, draft.events)).unwrap_or_default();
    let url = url.and_then(|url| checked(app, &url, &mut faults));
    let (Some(url), true) = (url, faults.is_empty()) else { return Err(AppError::faulty(faults)) };
    let (id, secret) = (Uuid::now_v7().to_string(), new_secret().map_err(|error| AppError::internal(&error))?);
    let new = NewWebhook { id: &id, owner, url: &url, events: &names_of(events.as_deref()), secret: &secret };
    if !app.store.create_webhook(&new, LIMITS.webhooks, now_ms()).await? {
        let detail = format!("the owner has {} webhooks, the maximum", LIMITS.webhooks);
        return Err(AppError::conflict("too-many-webhooks", detail));
    }
    own(app, caller, &id).await
}

/// Checks the address of a webhook, and adds its fault.
fn checked(app: &App, url: &str, faults: &mut Faults) -> Option<String> {
    check_url(url, app.webhooks.allows_private).map_err(|fault| faults.add_at("url", fault)).ok()
}

/// Returns the webhooks of the caller's owner, oldest first.
///
/// # Errors
/// Returns an error if the caller may not manage what belongs to its owner.
pub async fn list(app: &App, caller: &Caller) -> AppResult<Vec<WebhookRow>> {
    Ok(app.store.webhooks_of(app.manager(caller).await?).await?)
}

/// Returns a webhook of the caller's owner.
///
/// # Errors
/// Returns an error if the caller may not manage what belongs to its owner, or (404) if the owner has no such webhook.
pub async fn own(app: &App, caller: &Caller, id: &str) -> AppResult<WebhookRow> {
    let owner = app.manager(caller).await?;
    let row = app.store.webhook(id).await?.filter(|row| row.owner == owner);
    row.ok_or_else(|| AppError::not_found(format!("there is no webhook {id:?}; GET /v1/webhooks lists yours")))
}

/// Changes a webhook; what the request leaves out stays as it is. Events that ended while it was disabled are not
/// delivered later.
///
/// # Errors
/// Returns an error if there is no such webhook, or all faults of the change.
pub async fn change(
    app: &App,
    caller: &Caller,
    id: &str,
    draft: Option<WebhookChangeBody>,
    mut faults: Faults,
) -> AppResult<WebhookRow> {
    own(app, caller, id).await?;
    let WebhookChangeBody { url, events, enabled } =
        draft.unwrap_or(WebhookChangeBody { url: None, events: None, enabled: None });
    // An address that is no longer allowed may stay, so that the webhook can be disabled; nothing is posted to it.
    let url = url.and_then(|url| checked(app, &url, &mut faults));
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    let events = events.map(|events| names_of(Some(&events)));
    let enabling = enabled.map(|is| if is { Enabling::Enabled } else { Enabling::StaysOrDisabled(BY_OWNER) });
    let change = WebhookChange { url: url.as_deref(), events: events.as_deref(), enabling };
    app.store.change_webhook(id, &change).await?;
    own(app, caller, id).await
}

/// Deletes a webhook with its deliveries. Returns it as it was.
///
/// # Errors
/// Returns an error if there is no such webhook.
pub async fn delete(app: &App, caller: &Caller, id: &str) -> AppResult<WebhookRow> {
    let row = own(app, caller, id).await?;
    app.store.delete_webhook(id).await?;
    Ok(row)
}

/// Gives a webhook a new secret; the one before also signs for a day. Returns the webhook with the new secret.
///
/// # Errors
/// Returns an error if there is no such webhook.
pub async fn change_secret(app: &App, caller: &Caller, id: &str) -> AppResult<WebhookRow> {
    own(app, caller, id).await?;
    let secret = new_secret().map_err(|error| AppError::internal(&error))?;
    app.store.change_webhook_secret(id, &secret, now_ms() + DAY_MS).await?;
    own(app, caller, id).await
}

/// Sends a test message to a webhook.
///
/// # Errors
/// Returns an error if there is no such webhook, or a conflict if it is disabled or has too many pending deliveries.
pub async fn try_out(app: &App, caller: &Caller, id: &str) -> AppResult<DeliveryRow> {
    let webhook = own(app, caller, id).await?;
    refuse_if_disabled(&webhook)?;
    if app.store.pending_deliveries(id).await? >= LIMITS.webhook_pending {
        let detail = format!("the webhook has {} pending deliveries, the maximum", LIMITS.webhook_pending);
        return Err(AppError::conflict("too-many-deliveries", detail));
    }
    let now = now_ms();
    let new = NewDelivery { id: new_message_id(), event_id: None, event: TEST.to_owned(), body: test_message(id, now) };
    app.store.enter_test_delivery(id, &new, now).await?;
    app.store.ends().notify_waiters();
    delivery(app, id, &new.id).await
}

/// Lists the deliveries of a webhook, latest first.
///
/// # Errors
/// Returns an error if there is no such webhook, or if `limit` is out of range.
pub async fn deliveries(
    app: &App,
    caller: &Caller,
    id: &str,
    state: Option<DeliveryState>,
    before: Option<&str>,
    limit: Option<u32>,
) -> AppResult<Page<DeliveryRow>> {
    let items = page_items(limit, 100)?;
    own(app, caller, id).await?;
    Ok(Page::of(app.store.deliveries(id, state, before, items as i64 + 1).await?, items))
}

/// Delivers a message again that was delivered or given up, or a pending one at once.
///
/// # Errors
/// Returns an error if there is no such delivery, or a conflict if its webhook is disabled.
pub async fn retry(app: &App, caller: &Caller, webhook_id: &str, id: &str) -> AppResult<DeliveryRow> {
    refuse_if_disabled(&own(app, caller, webhook_id).await?)?;
    app.store.retry_delivery(webhook_id, id, now_ms()).await?;
    app.store.ends().notify_waiters();
    delivery(app, webhook_id, id).await
}

async fn delivery(app: &App, webhook_id: &str, id: &str) -> AppResult<DeliveryRow> {
    let found = app.store.delivery(webhook_id, id).await?;
    found.ok_or_else(|| AppError::not_found(format!("the webhook has no delivery {id:?}")))
}

fn refuse_if_disabled(webhook: &WebhookRow) -> AppResult<()> {
    match &webhook.disabled_reason {
        None => Ok(()),
        Some(reason) => Err(AppError::conflict(
            "webhook-disabled",
            format!("the webhook is disabled: {reason}; enable it with PUT /v1/webhooks/{}", webhook.id),
        )),
    }
}

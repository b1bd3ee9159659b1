//! Webhooks: addresses to which the events of an owner are posted.

use super::db::{Tx, query, query_as, query_scalar};
use super::locks::Lock;
use super::rows::from_row;
use super::{Store, StoreResult, commit};

/// Stored webhook.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WebhookRow {
    /// Identifier of the webhook.
    pub id: String,
    /// Owner of the events.
    pub owner: String,
    /// Address to which they are posted.
    pub url: String,
    /// Names of the events, separated by commas; empty means all.
    pub events: String,
    /// Secret that signs messages.
    pub secret: String,
    /// Secret before it.
    pub old_secret: Option<String>,
    /// Time until which the old secret signs too, in milliseconds since 1970.
    pub old_secret_until_ms: Option<i64>,
    /// Reason why it is disabled; none while it is enabled.
    pub disabled_reason: Option<String>,
    /// Number of the last event whose deliveries are stored.
    pub seen_event: i64,
    /// Time of creation, in milliseconds since 1970.
    pub created_at_ms: i64,
}

from_row!(WebhookRow {
    id,
    owner,
    url,
    events,
    secret,
    old_secret,
    old_secret_until_ms,
    disabled_reason,
    seen_event,
    created_at_ms
});

impl WebhookRow {
    /// Returns whether the webhook receives the event with this name.
    #[must_use]
    pub fn wants(&self, event: &str) -> bool {
        self.events.is_empty() || self.events.split(',').any(|own| own == event)
    }
}

/// Webhook to store.
#[derive(Debug, Clone, Copy)]
pub struct NewWebhook<'a> {
    /// Identifier of the webhook.
    pub id: &'a str,
    /// Owner of the events.
    pub owner: &'a str,
    /// Address to which they are posted.
    pub url: &'a str,
    /// Names of the events, separated by commas; empty means all.
    pub events: &'a str,
    /// Secret that signs messages.
    pub secret: &'a str,
}

/// Change of a webhook; what is `None` stays as it is.
#[derive(Debug, Clone, Copy)]
pub struct WebhookChange<'a> {
    /// New address.
    pub url: Option<&'a str>,
    /// New names of events.
    pub events: Option<&'a str>,
    /// Whether it is enabled from now on.
    pub enabling: Option<Enabling<'a>>,
}

/// Whether a webhook is enabled.
#[derive(Debug, Clone, Copy)]
pub enum Enabling<'a> {
    /// It is.
    Enabled,
    /// It is not, for this reason.
    Disabled(&'a str),
    /// It is not, for this reason unless there is another already.
    StaysOrDisabled(&'a str),
}

macro_rules! select_webhook {
    ($rest:literal) => {
        concat!(
            "SELECT id, owner, url, events, secret, old_secret, old_secret_until_ms, disabled_reason, seen_event,
                    created_at_ms
             FROM webhooks ",
            $rest
        )
    };
}

impl Store {
    /// Returns how many messages of a webhook were given up.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn dead_deliveries(&self, webhook_id: &str) -> StoreResult<i64> {
        query_scalar("SELECT COUNT(*) FROM deliveries WHERE webhook_id = $1 AND state = 'dead'")
            .bind(webhook_id)
            .fetch_one(&self.readers)
            .await
    }

    /// Returns the error of the latest message of a webhook that is not delivered and was attempted.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn last_delivery_error(&self, webhook_id: &str) -> StoreResult<Option<String>> {
        query_scalar(
            "SELECT last_error FROM deliveries
             WHERE webhook_id = $1 AND state <> 'delivered' AND last_error IS NOT NULL ORDER BY id DESC LIMIT 1",
        )
        .bind(webhook_id)
        .fetch_optional(&self.readers)
        .await
    }

    /// Stores a webhook that receives events from now on, unless its owner has `most` already. Returns whether it did.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn create_webhook(&self, new: &NewWebhook<'_>, most: i64, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(new.owner)]).await?;
        let count: i64 =
            query_scalar("SELECT COUNT(*) FROM webhooks WHERE owner = $1").bind(new.owner).fetch_one(&mut tx).await?;
        if count >= most {
            return Ok(false);
        }
        query(
            "INSERT INTO webhooks (id, owner, url, events, secret, seen_event, created_at_ms)
             SELECT $1, $2, $3, $4, $5, COALESCE(MAX(id), 0), $6 FROM events",
        )
        .bind(new.id)
        .bind(new.owner)
        .bind(new.url)
        .bind(new.events)
        .bind(new.secret)
        .bind(now_ms)
        .execute(&mut tx)
        .await?;
        commit(tx, "create_webhook").await?;
        Ok(true)
    }

    /// Returns the webhook with this identifier.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn webhook(&self, id: &str) -> StoreResult<Option<WebhookRow>> {
        query_as(select_webhook!("WHERE id = $1")).bind(id).fetch_optional(&self.readers).await
    }

    /// Returns the webhooks of an owner, oldest first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn webhooks_of(&self, owner: &str) -> StoreResult<Vec<WebhookRow>> {
        query_as(select_webhook!("WHERE owner = $1 ORDER BY created_at_ms, id"))
            .bind(owner)
            .fetch_all(&self.readers)
            .await
    }

    /// Returns all webhooks, by owner.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn webhooks(&self) -> StoreResult<Vec<WebhookRow>> {
        query_as(select_webhook!("ORDER BY owner, created_at_ms, id")).fetch_all(&self.readers).await
    }

    /// Returns all webhooks that are enabled.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn enabled_webhooks(&self) -> StoreResult<Vec<WebhookRow>> {
        query_as(select_webhook!("WHERE disabled_reason IS NULL ORDER BY id")).fetch_all(&self.readers).await
    }

    /// Changes a webhook. Enabling it goes on with the events from now on, and with the deliveries that are pending.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn change_webhook(&self, id: &str, change: &WebhookChange<'_>) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        query(
            "UPDATE webhooks SET
                 seen_event = CASE WHEN disabled_reason IS NOT NULL AND $4
                     THEN (SELECT COALESCE(MAX(id), 0) FROM events) ELSE seen_event END,
                 url = COALESCE($2, url),
                 events = COALESCE($3, events),
                 disabled_reason = CASE WHEN $4 THEN NULL WHEN $6 THEN $5 ELSE COALESCE(disabled_reason, $5) END
             WHERE id = $1",
        )
        .bind(id)
        .bind(change.url)
        .bind(change.events)
        .bind(matches!(change.enabling, Some(Enabling::Enabled)))
        .bind(match change.enabling {
            None | Some(Enabling::Enabled) => None,
            Some(Enabling::Disabled(reason) | Enabling::StaysOrDisabled(reason)) => Some(reason),
        })
        .bind(matches!(change.enabling, Some(Enabling::Disabled(_))))
        .execute(&mut tx)
        .await?;
        commit(tx, "change_webhook").await
    }

    /// Gives a webhook a new secret; the one before also signs until `old_until_ms`.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn change_webhook_secret(&self, id: &str, secret: &str, old_until_ms: i64) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        query("UPDATE webhooks SET old_secret = secret, old_secret_until_ms = $3, secret = $2 WHERE id = $1")
            .bind(id)
            .bind(secret)
            .bind(old_until_ms)
            .execute(&mut tx)
            .await?;
        commit(tx, "change_webhook_secret").await
    }

    /// Deletes a webhook with its deliveries.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn delete_webhook(&self, id: &str) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Webhook(id)]).await?;
        query("DELETE FROM deliveries WHERE webhook_id = $1").bind(id).execute(&mut tx).await?;
        query("DELETE FROM webhooks WHERE id = $1").bind(id).execute(&mut tx).await?;
        commit(tx, "delete_webhook").await
    }
}

/// Disables a webhook, unless it has another address by now.
pub(super) async fn disable(tx: &mut Tx, webhook: &WebhookRow, reason: &str) -> StoreResult<()> {
    query("UPDATE webhooks SET disabled_reason = $3 WHERE id = $1 AND url = $2 AND disabled_reason IS NULL")
        .bind(&webhook.id)
        .bind(&webhook.url)
        .bind(reason)
        .execute(tx)
        .await?;
    Ok(())
}

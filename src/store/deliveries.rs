//! Deliveries: what is to be posted to webhooks, and what became of it.
//!
//! Whoever attempts a delivery takes it first, for a while. If the process dies, another attempt follows when that
//! while is over, so a message is delivered at least once.

use super::db::{Builder, query, query_as, query_scalar};
use super::events::EventRow;
use super::locks::Lock;
use super::rows::from_row;
use super::states::DeliveryState::{self, Dead, Delivered, Pending};
use super::webhooks::{WebhookRow, disable};
use super::{Store, StoreResult, commit};

/// Time for which an attempt takes its delivery, in milliseconds. It is longer than an attempt may last.
const TAKEN_MS: i64 = 60_000;

/// Stored delivery.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeliveryRow {
    /// Identifier of the delivery, the same in every attempt.
    pub id: String,
    /// Identifier of the webhook.
    pub webhook_id: String,
    /// Name of the event.
    pub event: String,
    /// Message as JSON.
    pub body: String,
    /// State of the delivery.
    pub state: DeliveryState,
    /// Number of attempts so far.
    pub attempts: i64,
    /// Time of the next attempt, while it is pending, in milliseconds since 1970.
    pub next_at_ms: i64,
    /// HTTP status of the last answer.
    pub last_status: Option<i64>,
    /// Error of the last attempt.
    pub last_error: Option<String>,
    /// Time at which it was stored, in milliseconds since 1970; that of the event is in the message.
    pub created_at_ms: i64,
    /// Time at which it was delivered or given up.
    pub ended_at_ms: Option<i64>,
}

from_row!(DeliveryRow {
    id,
    webhook_id,
    event,
    body,
    state,
    attempts,
    next_at_ms,
    last_status,
    last_error,
    created_at_ms,
    ended_at_ms
});

/// Delivery to store.
#[derive(Debug, Clone)]
pub struct NewDelivery {
    /// Identifier of the delivery.
    pub id: String,
    /// Number of the event; none for a test.
    pub event_id: Option<i64>,
    /// Name of the event.
    pub event: String,
    /// Message as JSON.
    pub body: String,
}

/// Result of an attempt.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Attempted {
    /// The endpoint accepted the message, with this status.
    Delivered(u16),
    /// The attempt failed; the next is at this time, in milliseconds since 1970, or there is none.
    Failed {
        /// HTTP status, if there was an answer.
        status: Option<u16>,
        /// Description of the failure.
        error: String,
        /// Time of the next attempt; none if this was the last.
        next_at_ms: Option<i64>,
    },
    /// The endpoint wants no more messages: the webhook is disabled.
    Gone,
}

macro_rules! select_delivery {
    ($rest:literal) => {
        concat!(
            "SELECT id, webhook_id, event, body, state, attempts, next_at_ms, last_status, last_error, created_at_ms,
                    ended_at_ms
             FROM deliveries ",
            $rest
        )
    };
}

impl Store {
    /// Returns at most `limit` events of an owner after number `after`, up to `to`, in order.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn events_of_owner(&self, owner: &str, after: i64, to: i64, limit: i64) -> StoreResult<Vec<EventRow>> {
        query_as(
            "SELECT e.id, e.at_ms, e.run_id, e.submission_id, e.state, e.overall,
                    COALESCE(s.suite_id, r.suite_id) AS suite_id, s.task_number
             FROM events e LEFT JOIN submissions s ON s.id = e.submission_id LEFT JOIN runs r ON r.id = e.run_id
             WHERE e.id > $1 AND e.id <= $2 AND COALESCE(r.owner, s.owner) = $3 ORDER BY e.id LIMIT $4",
        )
        .bind(after)
        .bind(to)
        .bind(owner)
        .bind(limit)
        .fetch_all(&self.readers)
        .await
    }

    /// Stores the deliveries of the events of a webhook up to number `seen`. Does nothing if another node stored some
    /// since the webhook was read. Returns whether they were stored.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn enter_deliveries(
        &self,
        webhook: &WebhookRow,
        new: &[NewDelivery],
        seen: i64,
        now_ms: i64,
    ) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Webhook(&webhook.id)]).await?;
        let moved = query("UPDATE webhooks SET seen_event = $3 WHERE id = $1 AND seen_event = $2")
            .bind(&webhook.id)
            .bind(webhook.seen_event)
            .bind(seen)
            .execute(&mut tx)
            .await?;
        if moved == 0 {
            return Ok(false);
        }
        if !new.is_empty() {
            let mut insert = Builder::new(
                "INSERT INTO deliveries (id, webhook_id, event_id, event, body, state, next_at_ms, created_at_ms) ",
            );
            insert.push_values(new, |row, delivery| {
                row.push_bind(delivery.id.clone())
                    .push_bind(webhook.id.clone())
                    .push_bind(delivery.event_id)
                    .push_bind(delivery.event.clone())
                    .push_bind(delivery.body.clone())
                    .push_bind(Pending)
                    .push_bind(now_ms)
                    .push_bind(now_ms);
            });
            insert.build().execute(&mut tx).await?;
        }
        commit(tx, "enter_deliveries").await?;
        Ok(true)
    }

    /// Stores a delivery that no event caused.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn enter_test_delivery(&self, webhook_id: &str, new: &NewDelivery, now_ms: i64) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Webhook(webhook_id)]).await?;
        query(
            "INSERT INTO deliveries (id, webhook_id, event, body, state, next_at_ms, created_at_ms)
             SELECT $1, id, $3, $4, 'pending', $5, $5 FROM webhooks WHERE id = $2",
        )
        .bind(&new.id)
        .bind(webhook_id)
        .bind(&new.event)
        .bind(&new.body)
        .bind(now_ms)
        .execute(&mut tx)
        .await?;
        commit(tx, "enter_test_delivery").await
    }

    /// Returns how many deliveries of a webhook are pending.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn pending_deliveries(&self, webhook_id: &str) -> StoreResult<i64> {
        query_scalar("SELECT COUNT(*) FROM deliveries WHERE webhook_id = $1 AND state = 'pending'")
            .bind(webhook_id)
            .fetch_one(&self.readers)
            .await
    }

    /// Returns the identifiers of enabled webhooks with deliveries that are due, each with its owner. An owner without
    /// a live key gets none.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn webhooks_with_due_deliveries(&self, now_ms: i64) -> StoreResult<Vec<(String, String)>> {
        query_as(
            "SELECT w.id, w.owner FROM webhooks w
             WHERE w.disabled_reason IS NULL
               AND EXISTS (SELECT 1 FROM deliveries d
                           WHERE d.webhook_id = w.id AND d.state = 'pending' AND d.next_at_ms <= $1)
               AND EXISTS (SELECT 1 FROM keys k
                           WHERE k.owner = w.owner AND k.revoked_at_ms IS NULL
                             AND (k.expires_at_ms IS NULL OR k.expires_at_ms > $1))
             ORDER BY w.id",
        )
        .bind(now_ms)
        .fetch_all(&self.readers)
        .await
    }

    /// Takes the delivery of a webhook that has been due for longest, for a minute; none if none is due.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn take_delivery(&self, webhook_id: &str, now_ms: i64) -> StoreResult<Option<DeliveryRow>> {
        let mut tx = self.begin().await?;
        // Of two nodes that take the same delivery, the second finds that it is not due any more.
        let taken = query_as(
            "UPDATE deliveries SET attempts = attempts + 1, next_at_ms = $2
             WHERE id = (SELECT id FROM deliveries WHERE webhook_id = $1 AND state = 'pending' AND next_at_ms <= $3
                         ORDER BY next_at_ms, id LIMIT 1)
               AND state = 'pending' AND next_at_ms <= $3
             RETURNING id, webhook_id, event, body, state, attempts, next_at_ms, last_status, last_error, created_at_ms,
                       ended_at_ms",
        )
        .bind(webhook_id)
        .bind(now_ms + TAKEN_MS)
        .bind(now_ms)
        .fetch_optional(&mut tx)
        .await?;
        commit(tx, "take_delivery").await?;
        Ok(taken)
    }

    /// Records the result of an attempt.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn record_delivery(
        &self,
        webhook: &WebhookRow,
        taken: &DeliveryRow,
        result: &Attempted,
        now_ms: i64,
    ) -> StoreResult<()> {
        let (state, status, error, next) = match result {
            Attempted::Delivered(status) => (Delivered, Some(*status), None, None),
            Attempted::Failed { status, error, next_at_ms: None } => (Dead, *status, Some(error.as_str()), None),
            Attempted::Failed { status, error, next_at_ms } => (Pending, *status, Some(error.as_str()), *next_at_ms),
            Attempted::Gone => (Dead, Some(410), Some("410 Gone: the endpoint wants no more messages"), None),
        };
        let mut tx = self.begin().await?;
        // An attempt that took too long does not overrule the one that followed.
        query(
            "UPDATE deliveries SET state = $3, last_status = $4, last_error = $5, next_at_ms = COALESCE($6, next_at_ms),
                                   ended_at_ms = $7
             WHERE id = $1 AND attempts = $2 AND state = 'pending'",
        )
        .bind(&taken.id)
        .bind(taken.attempts)
        .bind(state)
        .bind(status.map(i64::from))
        .bind(error)
        .bind(next)
        .bind((state != Pending).then_some(now_ms))
        .execute(&mut tx)
        .await?;
        match result {
            // The endpoint is back: what waits for a later attempt is due now, apart from what is being attempted.
            Attempted::Delivered(_) => {
                query(
                    "UPDATE deliveries SET next_at_ms = $2
                     WHERE webhook_id = $1 AND state = 'pending' AND attempts > 0 AND next_at_ms > $2 + $3",
                )
                .bind(&webhook.id)
                .bind(now_ms)
                .bind(TAKEN_MS)
                .execute(&mut tx)
                .await?;
            }
            Attempted::Gone => disable(&mut tx, webhook, "the endpoint answered 410 Gone").await?,
            Attempted::Failed { .. } => {}
        }
        commit(tx, "record_delivery").await
    }

    /// Makes a delivery due now: one that has ended with all its attempts again, a pending one with those that are
    /// left.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn retry_delivery(&self, webhook_id: &str, id: &str, now_ms: i64) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        query(
            "UPDATE deliveries SET state = 'pending', next_at_ms = $3, ended_at_ms = NULL,
                                   attempts = CASE WHEN state = 'pending' THEN attempts ELSE 0 END
             WHERE id = $2 AND webhook_id = $1",
        )
        .bind(webhook_id)
        .bind(id)
        .bind(now_ms)
        .execute(&mut tx)
        .await?;
        commit(tx, "retry_delivery").await
    }

    /// Returns a delivery of a webhook.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn delivery(&self, webhook_id: &str, id: &str) -> StoreResult<Option<DeliveryRow>> {
        query_as(select_delivery!("WHERE webhook_id = $1 AND id = $2"))
            .bind(webhook_id)
            .bind(id)
            .fetch_optional(&self.readers)
            .await
    }

    /// Returns at most `limit` deliveries of a webhook before the one with the identifier `before`, latest first, in a
    /// state or in any.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn deliveries(
        &self,
        webhook_id: &str,
        state: Option<DeliveryState>,
        before: Option<&str>,
        limit: i64,
    ) -> StoreResult<Vec<DeliveryRow>> {
        let mut query = Builder::new(select_delivery!("WHERE webhook_id = "));
        query.push_bind(webhook_id.to_owned());
        if let Some(state) = state {
            query.push(" AND state = ").push_bind(state);
        }
        if let Some(before) = before {
            query.push(" AND id < ").push_bind(before.to_owned());
        }
        query.push(" ORDER BY id DESC LIMIT ").push_bind(limit);
        query.build_as().fetch_all(&self.readers).await
    }

    /// Forgets deliveries that were made before `delivered_before_ms`, or given up before `dead_before_ms`.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn forget_old_deliveries(&self, delivered_before_ms: i64, dead_before_ms: i64) -> StoreResult<()> {
        let old: bool = query_scalar(
            "SELECT EXISTS (SELECT 1 FROM deliveries WHERE (state = 'delivered' AND ended_at_ms < $1)
                                                        OR (state = 'dead' AND ended_at_ms < $2))",
        )
        .bind(delivered_before_ms)
        .bind(dead_before_ms)
        .fetch_one(&self.readers)
        .await?;
        if !old {
            return Ok(());
        }
        let mut tx = self.begin().await?;
        query(
            "DELETE FROM deliveries WHERE (state = 'delivered' AND ended_at_ms < $1) OR (state = 'dead' AND ended_at_ms < $2)",
        )
        .bind(delivered_before_ms)
        .bind(dead_before_ms)
        .execute(&mut tx)
        .await?;
        commit(tx, "forget_old_deliveries").await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::webhooks::NewWebhook;

    #[tokio::test]
    async fn of_two_nodes_that_saw_the_same_events_one_stores_them_and_the_other_hears_it() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(&folder.path().join("p.db").into(), None).await.unwrap();
        let new = NewWebhook { id: "w", owner: "lab", url: "http://127.0.0.1:1/", events: "", secret: "whsec_" };
        store.create_webhook(&new, 1, 0).await.unwrap();
        let webhook = store.webhook("w").await.unwrap().unwrap();
        let of = |number: i64| NewDelivery {
            id: format!("msg_{number}"),
            event_id: Some(number),
            event: "submission.graded".to_owned(),
            body: "{}".to_owned(),
        };
        assert!(store.enter_deliveries(&webhook, &[of(1)], 1, 0).await.unwrap());
        // The other node saw an event more: it must look again from where the first one ended.
        assert!(!store.enter_deliveries(&webhook, &[of(1), of(2)], 2, 0).await.unwrap());
        assert_eq!(store.webhook("w").await.unwrap().unwrap().seen_event, 1);
        assert_eq!(store.pending_deliveries("w").await.unwrap(), 1);
    }
}

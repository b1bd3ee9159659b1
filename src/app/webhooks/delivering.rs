//! Delivering: stores what is to be posted to each webhook, and posts what is due.

use std::collections::{BTreeMap, HashMap};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use reqwest::dns::{Addrs, Name, Resolve, Resolving};
use reqwest::redirect::Policy;
use reqwest::{Client, StatusCode, header};
use tokio::task::JoinSet;

use super::WebhookSettings;
use super::addresses::is_public;
use super::body::check_url;
use super::message::{message_of, name_of, new_message_id, signatures};
use crate::app::App;
use crate::app::limits::LIMITS;
use crate::clock::steady::steady_now_ms;
use crate::clock::{DAY_MS, now_ms};
use crate::store::StoreResult;
use crate::store::deliveries::{Attempted, DeliveryRow, NewDelivery};
use crate::store::webhooks::WebhookRow;
use crate::tls::use_tls;

/// Interval at which the store is asked, besides whenever something ends.
const LOOK: Duration = Duration::from_secs(1);
/// Pause after something has ended, before the store is asked.
const LEAST_PAUSE: Duration = Duration::from_millis(200);
/// Number of events after which a webhook notes how far it has read, though none was its own.
const NOTED_EVERY: i64 = 1_000;
/// Attempts at the same time: in all, of one owner, and of one webhook.
const AT_ONCE: usize = 64;
const AT_ONCE_OWNER: usize = 8;
const AT_ONCE_WEBHOOK: usize = 4;
/// Time after which a client that could not be made is tried again.
const CLIENT_AGAIN: Duration = Duration::from_mins(1);
/// Interval between removals of old deliveries.
const FORGET_EVERY: Duration = Duration::from_mins(10);

/// Resolver that finds only addresses of the public internet. It is asked for each new connection, so a name that has
/// changed since it was checked leads nowhere else.
#[derive(Debug)]
struct PublicOnly;

impl Resolve for PublicOnly {
    fn resolve(&self, name: Name) -> Resolving {
        Box::pin(async move {
            // Unknown names and names of a private network get the same error. Otherwise, an owner could find out the
            // names of that network by trying.
            let found = tokio::net::lookup_host((name.as_str(), 0)).await.ok().into_iter().flatten();
            let public: Vec<SocketAddr> = found.filter(|address| is_public(address.ip())).collect();
            if public.is_empty() {
                return Err(format!("{:?} has no address of the public internet", name.as_str()).into());
            }
            Ok(Box::new(public.into_iter()) as Addrs)
        })
    }
}

/// Creates the client that posts messages.
fn client(settings: &WebhookSettings) -> reqwest::Result<Client> {
    use_tls();
    let with = |builder: reqwest::ClientBuilder| {
        let builder = builder
            .redirect(Policy::none())
            .no_proxy()
            .timeout(Duration::from_secs(LIMITS.webhook_seconds))
            .user_agent(concat!("plumbline/", env!("CARGO_PKG_VERSION")));
        let builder =
            if settings.allows_private { builder } else { builder.dns_resolver(Arc::new(PublicOnly)).https_only(true) };
        builder.build()
    };
    with(Client::builder()).or_else(|error| {
        tracing::warn!(%error, "webhooks cannot use TLS: does the system lack certificates (ca-certificates)?");
        with(Client::builder().tls_certs_only([]))
    })
}

/// Delivers messages until the service stops. Any number of nodes may do so at the same time.
pub async fn deliver(app: Arc<App>) {
    let mut rounds = Rounds {
        client: None,
        failed: None,
        attempts: JoinSet::new(),
        underway: BTreeMap::new(),
        seen: HashMap::new(),
    };
    let mut forgotten = tokio::time::Instant::now();
    while !app.stop.is_cancelled() {
        let now = steady_now_ms();
        if let Err(error) = rounds.store_new(&app).await {
            tracing::warn!(%error, "could not store deliveries to webhooks");
        }
        if let Err(error) = rounds.begin_attempts(&app).await {
            tracing::warn!(%error, "could not read deliveries to webhooks");
        }
        if forgotten.elapsed() >= FORGET_EVERY {
            forgotten = tokio::time::Instant::now();
            let before = |days: i64| now - days * DAY_MS;
            let old = (before(LIMITS.webhook_delivered_days), before(LIMITS.webhook_dead_days));
            if let Err(error) = app.store.forget_old_deliveries(old.0, old.1).await {
                tracing::warn!(%error, "could not delete old deliveries to webhooks");
            }
        }
        tokio::select! {
            () = app.stop.cancelled() => {}
            () = tokio::time::sleep(LOOK) => {}
            // Under load something ends all the time.
            () = app.store.ends().notified() => tokio::time::sleep(LEAST_PAUSE).await,
            Some(ended) = rounds.attempts.join_next() => rounds.note_ended(ended),
        }
        while let Some(ended) = rounds.attempts.try_join_next() {
            rounds.note_ended(ended);
        }
    }
    // An attempt that was cut off is made again later, under the same identifier.
    rounds.attempts.shutdown().await;
}

/// A webhook, with its owner.
type Of = (String, String);

/// What one round of deliveries leaves to the next.
struct Rounds {
    /// Made for the first delivery: many services have no webhooks, and reading the system's certificates takes a while.
    client: Option<Client>,
    /// When the client could not be made.
    failed: Option<tokio::time::Instant>,
    attempts: JoinSet<Of>,
    /// Number of attempts of each webhook that are under way.
    underway: BTreeMap<Of, usize>,
    /// Number of the last event that was looked at for each webhook without one to deliver.
    seen: HashMap<String, i64>,
}

impl Rounds {
    fn note_ended(&mut self, ended: Result<Of, tokio::task::JoinError>) {
        match ended {
            Ok(of) => {
                if let Some(count) = self.underway.get_mut(&of) {
                    *count -= 1;
                }
                self.underway.retain(|_, count| *count > 0);
            }
            Err(error) => {
                tracing::error!(%error, "an attempt to deliver to a webhook failed");
                // Which webhook it was is unknown; the store keeps attempts apart anyway.
                self.underway.clear();
            }
        }
    }

    /// Stores the deliveries of new events, for each webhook as many as it has room for.
    async fn store_new(&mut self, app: &App) -> StoreResult<()> {
        let webhooks = app.store.enabled_webhooks().await?;
        self.seen.retain(|id, _| webhooks.iter().any(|webhook| webhook.id == *id));
        if webhooks.is_empty() {
            return Ok(());
        }
        let end = app.store.last_event().await?;
        for webhook in webhooks {
            let after = webhook.seen_event.max(self.seen.get(&webhook.id).copied().unwrap_or_default());
            if after >= end {
                continue;
            }
            let room = LIMITS.webhook_pending - app.store.pending_deliveries(&webhook.id).await?;
            if room <= 0 {
                continue;
            }
            let events = app.store.events_of_owner(&webhook.owner, after, end, room).await?;
            let is_whole = (events.len() as i64) < room;
            let seen = if is_whole { end } else { events.last().map_or(end, |last| last.id) };
            let new: Vec<NewDelivery> = events
                .iter()
                .map(|row| (row, name_of(row)))
                .filter(|(_, name)| webhook.wants(name))
                .map(|(row, event)| NewDelivery {
                    id: new_message_id(),
                    event_id: Some(row.id),
                    event,
                    body: message_of(app, row),
                })
                .collect();
            // A webhook without events of its own need not write each time.
            let is_noted = !new.is_empty() || seen - webhook.seen_event >= NOTED_EVERY;
            // Another node may have stored fewer events than these: the next look begins where that one ended.
            if !is_noted || app.store.enter_deliveries(&webhook, &new, seen, now_ms()).await? {
                self.seen.insert(webhook.id, seen);
            }
        }
        Ok(())
    }

    /// Returns the client, which is made once it is needed; none if it cannot be made.
    fn client(&mut self, settings: &WebhookSettings) -> Option<Client> {
        if self.client.is_none() && self.failed.is_none_or(|at| at.elapsed() >= CLIENT_AGAIN) {
            match client(settings) {
                Ok(made) => self.client = Some(made),
                Err(error) => {
                    tracing::error!(%error, "webhooks are not delivered: no HTTP client");
                    self.failed = Some(tokio::time::Instant::now());
                }
            }
        }
        self.client.clone()
    }

    /// Begins attempts of deliveries that are due: first those of webhooks with the fewest under way, a few of each
    /// webhook and each owner at a time, so that slow endpoints hold up no others.
    async fn begin_attempts(&mut self, app: &Arc<App>) -> StoreResult<()> {
        let mut due = app.store.webhooks_with_due_deliveries(now_ms()).await?;
        if due.is_empty() {
            return Ok(());
        }
        let Some(client) = self.client(&app.webhooks) else { return Ok(()) };
        while self.attempts.len() < AT_ONCE {
            let of_owner =
                |owner: &str| self.underway.iter().filter(|(of, _)| of.1 == owner).map(|(_, n)| n).sum::<usize>();
            let of_webhook = |of: &Of| self.underway.get(of).copied().unwrap_or_default();
            due.retain(|of| of_webhook(of) < AT_ONCE_WEBHOOK && of_owner(&of.1) < AT_ONCE_OWNER);
            let Some(next) = due.iter().min_by_key(|of| (of_owner(&of.1), of_webhook(of))).cloned() else { break };
            let taken = app.store.take_delivery(&next.0, now_ms()).await?;
            // Read after the delivery was taken: the address or the secret may have changed.
            let webhook = app.store.webhook(&next.0).await?.filter(|webhook| webhook.disabled_reason.is_none());
            let (Some(taken), Some(webhook)) = (taken, webhook) else {
                due.retain(|of| *of != next);
                continue;
            };
            *self.underway.entry(next).or_default() += 1;
            self.attempts.spawn(attempt(Arc::clone(app), client.clone(), webhook, taken));
        }
        Ok(())
    }
}

/// Attempts a delivery and records the result. Returns the webhook and its owner.
async fn attempt(app: Arc<App>, client: Client, webhook: WebhookRow, taken: DeliveryRow) -> Of {
    let result = post(&app.webhooks, &client, &webhook, &taken).await;
    let outcome = match &result {
        Attempted::Delivered(_) => "delivered",
        Attempted::Failed { next_at_ms: Some(_), .. } => "failed",
        Attempted::Failed { .. } | Attempted::Gone => "dead",
    };
    metrics::counter!("plumbline_webhook_attempts_total", "outcome" => outcome).increment(1);
    // The address may hold a secret of the endpoint, and belongs to the owner.
    match &result {
        Attempted::Failed { error, next_at_ms: None, .. } => {
            tracing::warn!(
                webhook = webhook.id,
                owner = webhook.owner,
                delivery = taken.id,
                error,
                "a delivery was given up"
            );
        }
        Attempted::Gone => {
            tracing::warn!(webhook = webhook.id, owner = webhook.owner, "the endpoint of a webhook is gone (410)");
        }
        Attempted::Delivered(_) | Attempted::Failed { .. } => {}
    }
    if let Err(error) = app.store.record_delivery(&webhook, &taken, &result, now_ms()).await {
        tracing::warn!(%error, "could not record a delivery to a webhook; it will be made again");
    }
    (webhook.id, webhook.owner)
}

async fn post(settings: &WebhookSettings, client: &Client, webhook: &WebhookRow, taken: &DeliveryRow) -> Attempted {
    let now = now_ms();
    let seconds = now / 1_000;
    // An address without a name is not looked up, so it is checked here: the settings may have changed.
    if let Err(fault) = check_url(&webhook.url, settings.allows_private) {
        return failed(settings, taken, None, fault);
    }
    let request = client
        .post(&webhook.url)
        .header(header::CONTENT_TYPE, "application/json")
        .header("webhook-id", &taken.id)
        .header("webhook-timestamp", seconds)
        .header("webhook-signature", signatures(webhook, &taken.id, seconds, &taken.body, now))
        .body(taken.body.clone());
    let (status, error) = match request.send().await {
        Ok(answer) if answer.status().is_success() => return Attempted::Delivered(answer.status().as_u16()),
        Ok(answer) if answer.status() == StatusCode::GONE => return Attempted::Gone,
        Ok(answer) => {
            let status = answer.status();
            let hint = if status.is_redirection() { ": redirects are not followed; change the URL" } else { "" };
            (Some(status.as_u16()), format!("{status}{hint}"))
        }
        Err(error) => (None, without_url(error)),
    };
    failed(settings, taken, status, error)
}

/// Says when the attempt after a failed one is.
fn failed(settings: &WebhookSettings, taken: &DeliveryRow, status: Option<u16>, error: String) -> Attempted {
    let pause = usize::try_from(taken.attempts - 1).ok().and_then(|made| settings.retries.get(made));
    let next_at_ms = pause.map(|pause| now_ms() + spread(*pause, &taken.id));
    Attempted::Failed { status, error, next_at_ms }
}

/// Returns a pause in milliseconds, up to a tenth longer, so that the messages of an endpoint that was down do not all
/// come back at once.
fn spread(pause: Duration, id: &str) -> i64 {
    let part: u32 = id.bytes().rev().take(4).fold(0, |sum, byte| (sum * 31 + u32::from(byte)) % 101);
    let ms = pause.mul_f64(1.0 + f64::from(part) / 1_000.0).as_millis();
    i64::try_from(ms).unwrap_or(i64::MAX)
}

/// Describes a failure with its causes, each once, without the address, whose query may hold a secret.
fn without_url(error: reqwest::Error) -> String {
    const MAX_CHARS: usize = 500;
    let error = error.without_url();
    let mut told = error.to_string();
    let mut cause = std::error::Error::source(&error);
    while let Some(next) = cause {
        let text = next.to_string();
        if !told.contains(&text) {
            told.push_str(": ");
            told.push_str(&text);
        }
        cause = next.source();
    }
    told.chars().take(MAX_CHARS).collect()
}

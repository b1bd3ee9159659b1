//! Delivering: stores what is to be posted to each webhook, and posts what is due.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use reqwest::dns::{Addrs, Name, Resolve, Resolving};
use reqwest::redirect::Policy;
use reqwest::{Client, StatusCode, header};
use tokio::task::JoinSet;
use uuid::Uuid;

use super::WebhookSettings;
use super::addresses::is_public;
use super::message::{message_of, name_of, signatures};
use crate::app::App;
use crate::app::limits::LIMITS;
use crate::clock::{DAY_MS, now_ms};
use crate::store::StoreResult;
use crate::store::deliveries::{Attempted, DeliveryRow, NewDelivery};
use crate::store::webhooks::WebhookRow;
use crate::tls::use_tls;

/// Interval at which the store is asked, besides whenever something ends.
const LOOK: Duration = Duration::from_secs(1);
/// Pause after something has ended, before the store is asked.
const LEAST_PAUSE: Duration = Duration::from_millis(200);
/// Time for which an attempt takes its delivery. It is longer than an attempt may last.
const TAKEN_MS: i64 = 60_000;
/// Number of events after which a webhook notes how far it has read, though none was its own.
const NOTED_EVERY: i64 = 1_000;
/// Attempts at the same time, in all and for one webhook.
const AT_ONCE: usize = 64;
const AT_ONCE_EACH: usize = 4;
/// Interval between removals of old deliveries.
const FORGET_EVERY: Duration = Duration::from_mins(10);

/// Resolver that finds only addresses of the public internet. It is asked for each new connection, so a name that has
/// changed since it was checked leads nowhere else.
#[derive(Debug)]
struct PublicOnly;

impl Resolve for PublicOnly {
    fn resolve(&self, name: Name) -> Resolving {
        Box::pin(async move {
            let found: Vec<SocketAddr> = tokio::net::lookup_host((name.as_str(), 0)).await?.collect();
            let public: Vec<SocketAddr> = found.into_iter().filter(|address| is_public(address.ip())).collect();
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
    let client = match client(&app.webhooks) {
        Ok(client) => client,
        Err(error) => {
            tracing::error!(%error, "webhooks are not delivered: no HTTP client");
            return;
        }
    };
    let mut attempts: JoinSet<String> = JoinSet::new();
    let mut underway: HashMap<String, usize> = HashMap::new();
    let mut forgotten = tokio::time::Instant::now();
    while !app.stop.is_cancelled() {
        if let Err(error) = store_new(&app).await {
            tracing::warn!(%error, "could not store deliveries to webhooks");
        }
        if let Err(error) = begin_attempts(&app, &client, &mut attempts, &mut underway).await {
            tracing::warn!(%error, "could not read deliveries to webhooks");
        }
        if forgotten.elapsed() >= FORGET_EVERY {
            forgotten = tokio::time::Instant::now();
            let before = |days: i64| now_ms() - days * DAY_MS;
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
            Some(ended) = attempts.join_next() => note_ended(&mut underway, ended),
        }
        while let Some(ended) = attempts.try_join_next() {
            note_ended(&mut underway, ended);
        }
    }
    // An attempt that was cut off is made again later, under the same identifier.
    attempts.shutdown().await;
}

fn note_ended(underway: &mut HashMap<String, usize>, ended: Result<String, tokio::task::JoinError>) {
    match ended {
        Ok(webhook_id) => {
            if let Some(count) = underway.get_mut(&webhook_id) {
                *count -= 1;
            }
            underway.retain(|_, count| *count > 0);
        }
        Err(error) => {
            tracing::error!(%error, "an attempt to deliver to a webhook failed");
            // Which webhook it was is unknown; the store keeps attempts apart anyway.
            underway.clear();
        }
    }
}

/// Stores the deliveries of new events, for each webhook as many as it has room for.
async fn store_new(app: &App) -> StoreResult<()> {
    let webhooks = app.store.enabled_webhooks().await?;
    if webhooks.is_empty() {
        return Ok(());
    }
    let end = app.store.last_event().await?;
    for webhook in webhooks.into_iter().filter(|webhook| webhook.seen_event < end) {
        let room = LIMITS.webhook_pending - app.store.pending_deliveries(&webhook.id).await?;
        if room <= 0 {
            continue;
        }
        let events = app.store.events_of_owner(&webhook.owner, webhook.seen_event, end, room).await?;
        let is_whole = (events.len() as i64) < room;
        let seen = if is_whole { end } else { events.last().map_or(end, |last| last.id) };
        let is_chosen = |name: &str| webhook.events.is_empty() || webhook.events.split(',').any(|own| own == name);
        let new: Vec<NewDelivery> = events
            .iter()
            .map(|row| (row, name_of(row)))
            .filter(|(_, name)| is_chosen(name))
            .map(|(row, event)| NewDelivery {
                id: format!("msg_{}", Uuid::now_v7().simple()),
                event_id: Some(row.id),
                event,
                body: message_of(app, row),
            })
            .collect();
        // A webhook without events of its own need not write each time.
        if !new.is_empty() || seen - webhook.seen_event >= NOTED_EVERY {
            app.store.enter_deliveries(&webhook, &new, seen, now_ms()).await?;
        }
    }
    Ok(())
}

/// Begins attempts of deliveries that are due, in turn for all webhooks.
async fn begin_attempts(
    app: &Arc<App>,
    client: &Client,
    attempts: &mut JoinSet<String>,
    underway: &mut HashMap<String, usize>,
) -> StoreResult<()> {
    let mut due = app.store.webhooks_with_due_deliveries(now_ms()).await?;
    while !due.is_empty() && attempts.len() < AT_ONCE {
        let mut left = Vec::new();
        for id in due {
            let count = underway.get(&id).copied().unwrap_or_default();
            if count >= AT_ONCE_EACH || attempts.len() >= AT_ONCE {
                continue;
            }
            let now = now_ms();
            let Some(taken) = app.store.take_delivery(&id, now + TAKEN_MS, now).await? else { continue };
            // Read after the delivery was taken: the address or the secret may have changed.
            let Some(webhook) = app.store.webhook(&id).await? else { continue };
            *underway.entry(id.clone()).or_default() += 1;
            attempts.spawn(attempt(Arc::clone(app), client.clone(), webhook, taken));
            left.push(id);
        }
        due = left;
    }
    Ok(())
}

/// Attempts a delivery and records the result. Returns the identifier of the webhook.
async fn attempt(app: Arc<App>, client: Client, webhook: WebhookRow, taken: DeliveryRow) -> String {
    let result = post(&app.webhooks, &client, &webhook, &taken).await;
    let outcome = match &result {
        Attempted::Delivered(_) => "delivered",
        Attempted::Failed { next_at_ms: Some(_), .. } => "failed",
        Attempted::Failed { .. } | Attempted::Gone => "dead",
    };
    metrics::counter!("plumbline_webhook_attempts_total", "outcome" => outcome).increment(1);
    if let Err(error) = app.store.record_delivery(&taken, &result, now_ms()).await {
        tracing::warn!(%error, "could not record a delivery to a webhook; it will be made again");
    }
    webhook.id
}

async fn post(settings: &WebhookSettings, client: &Client, webhook: &WebhookRow, taken: &DeliveryRow) -> Attempted {
    let now = now_ms();
    let seconds = now / 1_000;
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
    const MOST_CHARS: usize = 500;
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
    told.chars().take(MOST_CHARS).collect()
}

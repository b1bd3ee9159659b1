//! Readiness: whether the database can be written and read.

use std::time::{Duration, Instant};

use tokio::sync::Mutex;

use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use crate::clock::now_ms;
use crate::store::Store;
use crate::store::location::Location;
use crate::store::schema;

/// How long a result holds; more frequent probes cost nothing.
const HOLDS_FOR: Duration = Duration::from_secs(1);
/// Time that the database may take.
const PATIENCE: Duration = Duration::from_secs(4);

/// Recent result of writing to and reading from the database. One request looks; the others wait for its result.
#[derive(Debug, Default)]
pub struct Readiness(Mutex<Option<(Instant, Result<(), &'static str>)>>);

/// Checks that the database can be written and read, at most a second ago.
///
/// # Errors
/// Returns an error that says why it cannot.
pub async fn check(app: &App) -> AppResult<()> {
    let found = app.readiness.look(&app.store).await;
    found.map_err(|detail| AppError::new(Kind::NotReady, detail).retry_after(1))
}

/// Returns what the node lacks: its secrets, or keys of epochs that are not over; a log of receipts without damage; or the folder of large logs.
///
/// # Errors
/// Returns an error if the database or a file cannot be read.
pub async fn lacking(app: &App) -> AppResult<Vec<String>> {
    if app.signer.is_none() {
        return Ok(vec!["secrets".to_owned()]);
    }
    let mut lacking = Vec::new();
    if app.store.missing_folder().await.is_some() {
        lacking.push("folder of large logs and reports".to_owned());
    }
    if app.log.is_damaged() {
        lacking.push("intact log of receipts".to_owned());
    }
    let now = now_ms();
    for epoch in app.store.epochs().await?.iter().filter(|epoch| !epoch.is_over(now)) {
        if !app.store.secrets().has_epoch(epoch.id()) {
            lacking.push(format!("key of epoch {}", epoch.id()));
        }
    }
    Ok(lacking)
}

impl Readiness {
    async fn look(&self, store: &Store) -> Result<(), &'static str> {
        let mut found = self.0.lock().await;
        if let Some((at, found)) = *found
            && at.elapsed() < HOLDS_FOR
        {
            return found;
        }
        let new = match tokio::time::timeout(PATIENCE, store.probe(now_ms())).await {
            // A small write may still fit where a submission does not.
            Ok(Ok(())) if matches!(store.has_room(), Ok(false)) => {
                tracing::error!("not ready: the disk of the database is full");
                Err("The disk of the database is full.")
            }
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => {
                tracing::error!(%error, "not ready");
                Err("The database cannot be written or read; the service's log says why.")
            }
            Err(_late) if matches!(store.location(), Location::Server(_)) => {
                // Whoever waits for a connection of the pool does not learn why there is none.
                let why = match tokio::time::timeout(PATIENCE, schema::state(store.location())).await {
                    Ok(Ok(_)) => "it answers a new connection".to_owned(),
                    Ok(Err(error)) => error.to_string(),
                    Err(_late) => "a new connection gets no answer either".to_owned(),
                };
                tracing::error!(%why, "not ready: the database server did not answer in time");
                Err(
                    "The database server did not answer in time: it may be down, or out of reach; the service's log says why.",
                )
            }
            Err(_late) => {
                tracing::error!(seconds = PATIENCE.as_secs(), "not ready: the database could not be written in time");
                Err("The database could not be written in time: another process may hold its lock.")
            }
        };
        *found = Some((Instant::now(), new));
        new
    }
}

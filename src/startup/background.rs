//! Background tasks: upkeep, the use of keys, sweeping blobs, and what hidden evaluation does at fixed times.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use metrics_exporter_prometheus::PrometheusHandle;
use tokio_util::sync::CancellationToken;

use super::epoch_states::EpochStates;
use crate::app::App;
use crate::app::hidden::completion;
use crate::app::hidden::log::look_for_damage;
use crate::app::hidden::pools::publish_pool;
use crate::client::fetch_round;
use crate::clock::now_ms;
use crate::clock::steady::steady_now_ms;
use crate::http::middleware::rates::Rates;
use crate::store::blobs::Swept;
use crate::store::epochs::EpochRow;
use crate::store::{Store, StoreResult};
use plumbline_engine::hidden::pool::Generator;

/// Task that one node does for all: settling epochs and publishing what they came to.
const HIDDEN: &str = "hidden evaluation";
/// Task that one node does for all: deleting old requests and episodes.
const UPKEEP: &str = "upkeep";
/// Task that one node does for all: sweeping objects that no row refers to.
const BLOBS: &str = "blobs";
/// Task that one node does for all: fetching the rounds of beacons.
const BEACONS: &str = "beacons";

/// What background tasks share.
#[derive(Debug, Clone)]
pub(super) struct Shared {
    pub app: Arc<App>,
    pub store: Store,
    pub stop: CancellationToken,
}

/// Looks once whether the stored log of receipts lacks anything.
pub(super) async fn look_at_log(Shared { app, .. }: Shared) {
    // A database that fails has been logged.
    let _ = look_for_damage(&app).await;
}

/// Runs upkeep every few seconds: forgets idle clients in the rate limits, folds samples of histograms together, which
/// would pile up if nobody reads the metrics, loads suites that another process has added, lifts embargoes that are
/// over, and forgets old requests and episodes.
pub(super) async fn keep_up(Shared { app, store, stop }: Shared, rates: Arc<Rates>, metrics: PrometheusHandle) {
    const EVERY: Duration = Duration::from_secs(5);
    const LEASE_MS: i64 = 15_000;
    let node = uuid::Uuid::new_v4().to_string();
    while stop.run_until_cancelled(tokio::time::sleep(EVERY)).await.is_some() {
        let now = steady_now_ms();
        metrics.run_upkeep();
        rates.evict_idle();
        look_at_file(&store);
        if let Err(error) = app.current_catalogue().await {
            tracing::warn!(%error, "could not look for new suites");
        }
        // Lifting one is signed, so whichever node can sign does it.
        if app.signer.is_some()
            && let Err(error) = store.lift_embargoes(now).await
        {
            tracing::warn!(%error, "could not lift embargoes that are over");
        }
        match store.lead(UPKEEP, &node, LEASE_MS).await {
            Ok(true) => {}
            Ok(false) => continue,
            Err(error) => {
                tracing::warn!(%error, "could not ask which node looks after the database");
                continue;
            }
        }
        if let Err(error) = store.forget_old_requests(now).await {
            tracing::warn!(%error, "could not delete old idempotency keys");
        }
        if let Err(error) = store.forget_old_episodes(now).await {
            tracing::warn!(%error, "could not delete old episodes");
        }
    }
}

/// Says if the database file is not where it was, and sets its log aside if another file took its place.
pub(super) fn look_at_file(store: &Store) {
    let Some(file) = store.file() else { return };
    let Err(error) = file.must_be_in_place() else { return };
    tracing::error!("{error}");
    match file.set_log_aside() {
        Ok(names) => {
            for name in names {
                tracing::error!(name = %name.display(), "the log of the file before was set aside under this name");
            }
        }
        Err(error) => tracing::error!(%error, "its -wal and -shm belong to the file before: move them away"),
    }
}

/// Deletes, once a day, the objects outside the database that no row refers to. Of several nodes, one does it.
pub(super) async fn sweep(Shared { store, stop, .. }: Shared) {
    const LOOK: Duration = Duration::from_secs(20);
    const LEASE_MS: i64 = 15_000;
    let node = uuid::Uuid::new_v4().to_string();
    loop {
        match sweep_if_due(&store, &node, LEASE_MS, steady_now_ms()).await {
            Ok(None | Some(Swept::Deleted(0))) => {}
            Ok(Some(Swept::Deleted(deleted))) => tracing::info!(deleted, "deleted objects that no row refers to"),
            Ok(Some(Swept::OfAnother { place, token })) => tracing::warn!(
                place,
                "another database sweeps the place of the blobs, of which this one is a copy: give it a place of its own; \
                 if this one is to keep the place, delete {token} there",
            ),
            Err(error) => tracing::warn!(%error, "could not look for objects that no row refers to"),
        }
        if stop.run_until_cancelled(tokio::time::sleep(LOOK)).await.is_none() {
            return;
        }
    }
}

async fn sweep_if_due(store: &Store, node: &str, lease_ms: i64, now_ms: i64) -> StoreResult<Option<Swept>> {
    if !store.is_sweep_due(now_ms).await? || !store.lead(BLOBS, node, lease_ms).await? {
        return Ok(None);
    }
    store.sweep_blobs(now_ms).await.map(Some)
}

/// Stores every few seconds when keys were last used. It waits for the writer, and nothing waits for it.
pub(super) async fn keep_uses(Shared { app, stop, .. }: Shared) {
    const EVERY: Duration = Duration::from_secs(5);
    while stop.run_until_cancelled(tokio::time::sleep(EVERY)).await.is_some() {
        store_uses(&app).await;
    }
}

/// Stores when keys were last used.
pub(super) async fn store_uses(app: &App) {
    if let Err(error) = app.store_key_uses().await {
        tracing::warn!(%error, "could not store when keys were last used");
    }
}

/// Settles epochs as soon as they are over. Entries of open epochs are completed, and receipts published, only at full
/// multiples of `every` since 1970, so that nobody can tell when an answer was graded. Of several nodes, one does it.
pub(super) async fn keep_hidden(Shared { store, stop, .. }: Shared, every: Duration) {
    const LOOK: Duration = Duration::from_secs(1);
    const LEASE_MS: i64 = 5_000;
    const TOLD_BYTES: u64 = 16 << 20;
    let node = uuid::Uuid::new_v4().to_string();
    let every_ms = i64::try_from(every.as_millis()).unwrap_or(i64::MAX).max(1);
    let mut states = EpochStates::default();
    let mut published = steady_now_ms() / every_ms;
    // The file grows when a hidden answer is graded, the more the larger the answer, so its size is told only at these
    // times, and coarsely.
    let tell_size = || async {
        if let Ok(bytes) = store.bytes().await {
            metrics::gauge!("plumbline_database_bytes").set(bytes.next_multiple_of(TOLD_BYTES) as f64);
        }
    };
    tell_size().await;
    // Epochs that are settled at once are told too.
    match store.epochs().await {
        Ok(epochs) => states.tell(&epochs, steady_now_ms()),
        Err(error) => tracing::warn!(%error, "could not look at the epochs"),
    }
    while stop.run_until_cancelled(tokio::time::sleep(LOOK)).await.is_some() {
        let now = steady_now_ms();
        match store.lead(HIDDEN, &node, LEASE_MS).await {
            Ok(true) => {}
            Ok(false) => continue,
            Err(error) => {
                tracing::warn!(%error, "could not find out which node settles epochs");
                continue;
            }
        }
        if let Err(error) = completion::settle_epochs(&store, now).await {
            tracing::warn!(%error, "could not settle epochs that are over");
        }
        match store.epochs().await {
            Ok(epochs) => {
                states.tell(&epochs, now);
                let secrets = store.secrets();
                for epoch in epochs.iter().filter(|epoch| states.has_just_settled(epoch.id())) {
                    if !secrets.has_epoch(epoch.id()) {
                        let folder = secrets.folder().display();
                        tracing::warn!(epoch = epoch.id(), %folder, "its key is not there: nobody can get its reveal until you put it back");
                    }
                }
            }
            Err(error) => tracing::warn!(%error, "could not look at the epochs"),
        }
        let due = now / every_ms;
        if due == published {
            continue;
        }
        match completion::publish(&store, now).await {
            Ok(()) => {
                published = due;
                tell_size().await;
            }
            Err(error) => {
                tracing::warn!(%error, "could not complete entries and publish receipts of hidden evaluation");
            }
        }
    }
    if let Err(error) = store.stop_leading(HIDDEN, &node).await {
        tracing::debug!(%error, "another node leads only when this node's lease has ended");
    }
}

/// Fetches the rounds that epochs are bound to from a server of the beacon, as soon as they are emitted, and makes
/// their pools. Without a server, says which rounds are missing.
pub(super) async fn follow_beacons(Shared { store, stop, .. }: Shared, server: Option<String>) {
    const LOOK: Duration = Duration::from_secs(1);
    // A server that fails is asked again later, and what is missing is said again.
    const AFTER_FAILURE: Duration = Duration::from_secs(10);
    const SAID: Duration = Duration::from_mins(1);
    let node = uuid::Uuid::new_v4().to_string();
    let mut pause = LOOK;
    while stop.run_until_cancelled(tokio::time::sleep(pause)).await.is_some() {
        pause = LOOK;
        let lacking = match rounds_to_bring(&store, &node).await {
            Ok(lacking) => lacking,
            Err(error) => {
                tracing::warn!(%error, "could not find out which epochs wait for their beacon's round");
                pause = AFTER_FAILURE;
                continue;
            }
        };
        for (epoch, round) in &lacking {
            let Some(server) = &server else {
                tracing::warn!(
                    epoch = epoch.id(),
                    round,
                    "the round of the beacon is due, so draws wait for it: bring it with `plumbline epochs beacon`, or start with --beacon-url"
                );
                pause = SAID;
                continue;
            };
            match bring_round(&store, server, epoch).await {
                Ok(root) => tracing::info!(epoch = epoch.id(), round, root, "made the pool of an epoch"),
                Err(error) => {
                    tracing::warn!(
                        epoch = epoch.id(),
                        round,
                        server,
                        error = format!("{error:#}"),
                        "could not make the pool of an epoch"
                    );
                    pause = AFTER_FAILURE;
                }
            }
        }
    }
    if let Err(error) = store.stop_leading(BEACONS, &node).await {
        tracing::debug!(%error, "another node leads only when this node's lease has ended");
    }
}

/// Makes the generators that epochs need, with the list of siblings: the first draw and the pool of a beacon shall not
/// wait for them.
pub(super) async fn prepare_generators(Shared { store, stop, .. }: Shared) {
    const LOOK: Duration = Duration::from_secs(10);
    let mut made: BTreeSet<u32> = BTreeSet::new();
    loop {
        let epochs = store.epochs().await.unwrap_or_else(|error| {
            tracing::warn!(%error, "could not find out which generators are needed");
            Vec::new()
        });
        let needs = |epoch: &&EpochRow| epoch.commitment.siblings.is_some() || epoch.commitment.beacon.is_some();
        let open = epochs.iter().filter(|epoch| epoch.settled_at_ms.is_none());
        for version in open.filter(needs).map(|epoch| epoch.commitment.generator_version) {
            if made.insert(version) {
                let made = tokio::task::spawn_blocking(move || Generator::of(version).map(drop)).await;
                let failure = match made {
                    Ok(Ok(())) => continue,
                    Ok(Err(error)) => error.to_string(),
                    Err(panicked) => panicked.to_string(),
                };
                tracing::error!(
                    version,
                    error = failure,
                    "could not make the generator of an epoch; draws will try again"
                );
            }
        }
        if stop.run_until_cancelled(tokio::time::sleep(LOOK)).await.is_none() {
            return;
        }
    }
}

/// Returns the epochs that lack the round of their beacon, with its number; none if another node brings them. Nearly
/// always there are none, and nothing is written.
async fn rounds_to_bring(store: &Store, node: &str) -> StoreResult<Vec<(EpochRow, u64)>> {
    const LEASE_MS: i64 = 15_000;
    let epochs = store.epochs().await?.into_iter();
    let lacking: Vec<_> = epochs.filter_map(|epoch| epoch.lacks_round(now_ms()).map(|round| (epoch, round))).collect();
    if lacking.is_empty() || !store.lead(BEACONS, node, LEASE_MS).await? {
        return Ok(Vec::new());
    }
    Ok(lacking)
}

async fn bring_round(store: &Store, server: &str, epoch: &EpochRow) -> anyhow::Result<String> {
    let beacon = epoch.commitment.beacon.as_ref().expect("an epoch that lacks a round is bound to a beacon");
    let round = fetch_round(server, beacon).await?;
    Ok(publish_pool(store, epoch, &round, now_ms()).await?.root)
}

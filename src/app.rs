//! Composition: store, workers and HTTP made one service, started and stopped in order.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use metrics_exporter_prometheus::PrometheusHandle;
use tokio::net::TcpListener;
use tokio::sync::Notify;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::actions::ACTION_LIMITS;
use crate::actions::pool::Pool;
use crate::clock::now_ms;
use crate::http::limits::LIMITS;
use crate::http::rates::Rates;
use crate::http::server::Connections;
use crate::http::{self, Around, HttpSettings};
use crate::store::keys::Scope;
use crate::store::suites::SuiteStored;
use crate::store::{Store, StoreResult};
use crate::tasks::embedded;
use crate::worker::{WorkerSettings, Workers};

/// What a service is started with.
#[derive(Debug, Clone)]
pub struct Config {
    /// Host and port to listen on; port 0 takes a free one.
    pub listen: String,
    /// The database file.
    pub database: PathBuf,
    /// Submissions graded at the same time.
    pub workers: usize,
    /// How long a job stays with a worker that gives no sign of life.
    pub lease: Duration,
    /// What HTTP is started with.
    pub http: HttpSettings,
}

/// A running service.
#[derive(Debug)]
pub struct App {
    /// Where it listens.
    pub address: SocketAddr,
    store: Store,
    workers: Workers,
    stop: CancellationToken,
    serving: JoinHandle<std::io::Result<()>>,
}

impl App {
    /// Opens the database, stores the suites of the binary, starts the workers and listens.
    ///
    /// # Errors
    /// Where the database or the address cannot be had.
    pub async fn start(config: &Config, metrics: PrometheusHandle) -> anyhow::Result<Self> {
        // The address first: where it is taken, no database is made.
        let listener = TcpListener::bind(&config.listen)
            .await
            .with_context(|| format!("cannot listen on {:?} (expected host:port)", config.listen))?;
        let address = listener.local_addr()?;
        let folder = config.database.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            anyhow::bail!(
                "cannot make the database {}: there is no folder {}",
                config.database.display(),
                folder.display()
            );
        }
        let store = Store::open(&config.database)
            .await
            .with_context(|| format!("cannot open the database {}", config.database.display()))?;
        store_suites(&store).await?;
        let wake = Arc::new(Notify::new());
        let settings = WorkerSettings {
            workers: config.workers,
            lease: config.lease,
            deadline: Duration::from_secs(LIMITS.grading_seconds),
        };
        let signer = Arc::new(store.secrets().signer().context("cannot have the key that signs receipts")?);
        let workers = Workers::start(&store, settings, &signer, &wake);
        let stop = CancellationToken::new();
        let connections = Connections::default();
        let rates = Arc::new(Rates::new(config.http.rates));
        tokio::spawn(keep_up(metrics.clone(), store.clone(), Arc::clone(&rates), stop.clone()));
        let actions = Pool::new(config.workers, ACTION_LIMITS);
        actions.refill();
        let around = Around {
            store: store.clone(),
            wake,
            metrics,
            connections: connections.clone(),
            rates,
            actions,
            receipt_key: signer.public_key(),
            stop: stop.clone(),
        };
        let router = http::router(around, &config.http)?;
        let serving = tokio::spawn(http::server::serve(listener, router, connections, stop.clone()));
        tracing::info!(%address, database = %config.database.display(), workers = config.workers, "listening");
        Ok(Self { address, store, workers, stop, serving })
    }

    /// A key for the demo agents, for a day; what they had before is revoked.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn demo_key(&self) -> anyhow::Result<String> {
        const OWNER: &str = "demo";
        const DAY_MS: i64 = 86_400_000;
        let now = now_ms();
        for key in self.store.keys().await?.iter().filter(|key| key.owner == OWNER && key.is_live(now)) {
            self.store.revoke_key(&key.id, now).await?;
        }
        let key = self.store.create_key(OWNER, &[Scope::Submit], Some(now + DAY_MS), now).await?;
        key.context("the demo has too many keys")
    }

    /// Stops: takes no more requests, lets answers finish, gives unfinished jobs back, closes the database.
    pub async fn shut_down(self) {
        self.stop.cancel();
        if let Err(error) = self.serving.await.map_err(std::io::Error::other).flatten() {
            tracing::error!(%error, "serving ended badly");
        }
        self.workers.shut_down().await;
        self.store.close().await;
    }
}

/// What is done every few seconds: who was quiet is forgotten by the rate limits; samples of histograms are folded together,
/// which would pile up where nobody reads the metrics; suites that another process has added are read; entries of epochs that
/// are over are finalized.
async fn keep_up(metrics: PrometheusHandle, store: Store, rates: Arc<Rates>, stop: CancellationToken) {
    const EVERY: Duration = Duration::from_secs(5);
    while stop.run_until_cancelled(tokio::time::sleep(EVERY)).await.is_some() {
        metrics.run_upkeep();
        rates.forget_the_quiet();
        if let Err(error) = store.current_catalogue().await {
            tracing::warn!(%error, "could not look for new suites");
        }
        if let Err(error) = finalize_what_is_over(&store).await {
            tracing::warn!(%error, "could not finalize entries of epochs that are over");
        }
    }
}

async fn finalize_what_is_over(store: &Store) -> StoreResult<()> {
    for epoch in store.epochs().await? {
        store.finalize_what_is_over(&epoch, now_ms()).await?;
    }
    Ok(())
}

async fn store_suites(store: &Store) -> anyhow::Result<()> {
    let suites =
        embedded::suites().map_err(|faults| anyhow::anyhow!("the suite of this program is faulty: {faults:?}"))?;
    for suite in suites {
        if store.put_suite(&suite, now_ms()).await? == SuiteStored::Conflict {
            let id = suite.id();
            anyhow::bail!("the database holds another {id} than this program; a changed suite needs a new version");
        }
    }
    store.refresh_catalogue().await?;
    Ok(())
}

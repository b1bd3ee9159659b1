//! Composition: assembles store, workers and HTTP into one service, and starts and stops them in order.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use metrics_exporter_prometheus::PrometheusHandle;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::actions::ACTION_LIMITS;
use crate::actions::pool::Pool;
use crate::app::App;
use crate::app::access::{Keys, Openness};
use crate::app::boards::Boards;
use crate::app::limits::{LIMITS, Limits};
use crate::app::load::Connections;
use crate::app::rewards::grader::Grader;
use crate::app::stress::StressFields;
use crate::clock::now_ms;
use crate::fair::PermitPool;
use crate::http::middleware::rates::{RateSettings, Rates};
use crate::http::{self, HttpParts};
use crate::store::Store;
use crate::store::keys::Scope;
use crate::store::serving::Serving;
use crate::store::suites::SuiteStored;
use crate::worker::{WorkerSettings, Workers};
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::tasks::embedded;

/// Settings of the use cases and of HTTP.
#[derive(Debug, Clone, Copy)]
pub struct ServiceSettings {
    /// Bytes of memory for the cache of results of `/v1/grade`; 0 disables the cache.
    pub grade_cache_bytes: usize,
    /// Requests that are allowed without a key.
    pub open: Openness,
    /// Share of a suite that a run must have answered, or skipped on purpose, to be compared on its board.
    pub least_coverage: f64,
    /// Limits on requests per second and on connections.
    pub rates: RateSettings,
}

/// Settings of a service.
#[derive(Debug, Clone)]
pub struct Config {
    /// Host and port to listen on; port 0 picks a free one.
    pub listen: String,
    /// Host and port for metrics and administration, if they have a listener of their own.
    pub admin_listen: Option<String>,
    /// Path of the database file.
    pub database: PathBuf,
    /// Number of submissions graded at the same time.
    pub workers: usize,
    /// Time after which a job is taken from a worker that no longer renews its lease.
    pub lease: Duration,
    /// Interval at which entries of open epochs are completed and receipts of hidden evaluation are published.
    pub hidden_publish: Duration,
    /// Settings of the use cases and of HTTP.
    pub settings: ServiceSettings,
}

/// A running service.
#[derive(Debug)]
pub struct RunningService {
    /// Address of the public listener.
    pub address: SocketAddr,
    /// Address of the administration listener, if there is one.
    pub admin_address: Option<SocketAddr>,
    /// Notices for the operator who starts the service.
    pub notices: Vec<String>,
    app: Arc<App>,
    workers: Workers,
    stop: CancellationToken,
    listeners: Vec<JoinHandle<std::io::Result<()>>>,
    /// Tells other processes that this one serves the database.
    _serving: Option<Serving>,
}

impl RunningService {
    /// Opens the database, stores the suites of the binary, starts the workers and listens.
    ///
    /// # Errors
    /// Returns an error if the database cannot be opened or an address cannot be bound.
    pub async fn start(config: &Config, metrics: PrometheusHandle) -> anyhow::Result<Self> {
        // Bind the address first: if it is taken, no database is created.
        let listener = listen("--listen", &config.listen).await?;
        let address = listener.local_addr()?;
        let admin_listener = match &config.admin_listen {
            Some(place) => Some(listen("--admin-listen", place).await?),
            None => None,
        };
        let admin_address = admin_listener.as_ref().map(TcpListener::local_addr).transpose()?;
        let folder = config.database.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            anyhow::bail!(
                "cannot create the database {}: there is no folder {}",
                config.database.display(),
                folder.display()
            );
        }
        let store = Store::open(&config.database)
            .await
            .with_context(|| format!("cannot open the database {}", config.database.display()))?;
        store_suites(&store).await?;
        let settings = WorkerSettings {
            workers: config.workers,
            lease: config.lease,
            deadline: Duration::from_secs(LIMITS.grading_seconds),
        };
        let signer = store.signer().context("cannot load the key that signs receipts")?;
        let (serving, shared) = serving_notice(&config.database);
        let notices: Vec<String> = receipt_key_notice(&store, &signer).await?.into_iter().chain(shared).collect();
        for notice in &notices {
            tracing::warn!("{notice}");
        }
        let workers = Workers::start(&store, settings, &signer)?;
        let stop = CancellationToken::new();
        let connections = Connections::default();
        let rates = Arc::new(Rates::new(config.settings.rates));
        crate::telemetry::describe_metrics();
        tokio::spawn(keep_hidden(store.clone(), config.hidden_publish, stop.clone()));
        let actions = Pool::new(config.workers, ACTION_LIMITS);
        actions.refill();
        let limits = Limits {
            requests_per_second_per_key: config.settings.rates.per_key,
            requests_per_second_per_address: config.settings.rates.per_address,
            grade_cache_bytes: config.settings.grade_cache_bytes,
            connections_per_address: config.settings.rates.connections_per_address,
            ..LIMITS
        };
        let app = App {
            store: store.clone(),
            grader: Arc::new(Grader::new(config.settings.grade_cache_bytes, &connections, stop.clone())?),
            keys: Keys::new(config.settings.open),
            least_coverage: config.settings.least_coverage,
            boards: Boards::default(),
            stress: StressFields::new()?,
            limits,
            actions,
            action_requests: PermitPool::new(limits.action_requests, limits.action_requests_per_sender),
            signer,
            stop: stop.clone(),
        };
        let app = Arc::new(app);
        tokio::spawn(keep_up(metrics.clone(), Arc::clone(&app), Arc::clone(&rates), stop.clone()));
        tokio::spawn(keep_uses(Arc::clone(&app), stop.clone()));
        let parts = HttpParts { app: Arc::clone(&app), metrics, rates };
        let routers = http::routers(parts, admin_listener.is_some());
        let per_address = config.settings.rates.connections_from_one(LIMITS.connections);
        let serve = http::server::accept::serve(listener, routers.public, connections, per_address, stop.clone());
        let mut listeners = vec![tokio::spawn(serve)];
        if let (Some(listener), Some(router)) = (admin_listener, routers.admin) {
            let serve =
                http::server::accept::serve(listener, router, Connections::default(), LIMITS.connections, stop.clone());
            listeners.push(tokio::spawn(serve));
        }
        let admin = admin_address.map(|address| address.to_string());
        tracing::info!(%address, admin_address = admin, database = %config.database.display(), workers = config.workers, "listening");
        Ok(Self { address, admin_address, notices, app, workers, stop, listeners, _serving: serving })
    }

    /// Creates a key for the demo agents that is valid for a day, and revokes their earlier keys.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn demo_key(&self) -> anyhow::Result<String> {
        const OWNER: &str = "demo";
        const DAY_MS: i64 = 86_400_000;
        let now = now_ms();
        for key in self.app.store.keys().await?.iter().filter(|key| key.owner == OWNER && key.is_live(now)) {
            self.app.store.revoke_key(&key.id, now).await?;
        }
        let key = self.app.store.create_key(OWNER, &[Scope::Submit], Some(now + DAY_MS), now).await?;
        key.context("the demo has too many keys")
    }

    /// Stops accepting requests, lets running requests finish, gives unfinished jobs back, and closes the database.
    pub async fn shut_down(self) {
        self.stop.cancel();
        for listener in self.listeners {
            if let Err(error) = listener.await.map_err(std::io::Error::other).flatten() {
                tracing::error!(%error, "a listener failed");
            }
        }
        self.workers.shut_down().await;
        store_uses(&self.app).await;
        self.app.store.close().await;
    }
}

async fn listen(option: &str, place: &str) -> anyhow::Result<TcpListener> {
    let bound = TcpListener::bind(place).await;
    bound.with_context(|| format!("cannot listen on {place:?} ({option} is a host and a port, such as 127.0.0.1:7586)"))
}

/// Notes that this process serves a database; returns a notice for the operator if another process does so too.
fn serving_notice(database: &Path) -> (Option<Serving>, Option<String>) {
    match Serving::of(database) {
        Ok(serving) => {
            let notice = serving.is_shared.then(|| {
                format!(
                    "another process serves {} too; both grade its queue. If that is a mistake, stop one of them",
                    database.display()
                )
            });
            (Some(serving), notice)
        }
        Err(error) => {
            tracing::warn!(%error, "could not find out whether another process serves the database");
            (None, None)
        }
    }
}

/// Records a change of the key that signs receipts in their log; returns a notice for the operator if the key changed.
async fn receipt_key_notice(store: &Store, signer: &Signer) -> anyhow::Result<Option<String>> {
    let before = store.note_receipt_key(signer, now_ms()).await?;
    Ok(before.map(|before| {
        let (now, folder) = (signer.public_key(), store.secrets().folder().display().to_string());
        format!(
            "receipts are signed with a new key from now on: {now}; the key before was {before}. The change is \
             recorded in the log at /v1/receipts. If you still have the old key, stop the service, put it back into \
             {folder}, and start again"
        )
    }))
}

/// Runs upkeep every few seconds: forgets idle clients in the rate limits, folds samples of histograms together, which
/// would pile up if nobody reads the metrics, and loads suites that another process has added.
async fn keep_up(metrics: PrometheusHandle, app: Arc<App>, rates: Arc<Rates>, stop: CancellationToken) {
    const EVERY: Duration = Duration::from_secs(5);
    while stop.run_until_cancelled(tokio::time::sleep(EVERY)).await.is_some() {
        metrics.run_upkeep();
        rates.evict_idle();
        if let Err(error) = app.store.current_catalogue().await {
            tracing::warn!(%error, "could not look for new suites");
        }
    }
}

/// Stores every few seconds when keys were last used. It waits for the writer, and nothing waits for it.
async fn keep_uses(app: Arc<App>, stop: CancellationToken) {
    const EVERY: Duration = Duration::from_secs(5);
    while stop.run_until_cancelled(tokio::time::sleep(EVERY)).await.is_some() {
        store_uses(&app).await;
    }
}

async fn store_uses(app: &App) {
    if let Err(error) = app.keys.store_uses(&app.store).await {
        tracing::warn!(%error, "could not store when keys were last used");
    }
}

/// Settles epochs as soon as they are over. Entries of open epochs are completed, and receipts published, only at full
/// multiples of `every` since 1970, so that nobody can tell when an answer was graded.
async fn keep_hidden(store: Store, every: Duration, stop: CancellationToken) {
    const LOOK: Duration = Duration::from_secs(1);
    let every_ms = i64::try_from(every.as_millis()).unwrap_or(i64::MAX).max(1);
    let mut published = now_ms() / every_ms;
    // The file grows when a hidden answer is graded, so its size is reported only at these times.
    let tell_size = || metrics::gauge!("plumbline_database_bytes").set(store.file_bytes() as f64);
    tell_size();
    while stop.run_until_cancelled(tokio::time::sleep(LOOK)).await.is_some() {
        if let Err(error) = store.settle_epochs(now_ms()).await {
            tracing::warn!(%error, "could not settle epochs that are over");
        }
        let due = now_ms() / every_ms;
        if due == published {
            continue;
        }
        match store.publish_hidden(now_ms()).await {
            Ok(()) => {
                published = due;
                tell_size();
            }
            Err(error) => {
                tracing::warn!(%error, "could not complete entries and publish receipts of hidden evaluation");
            }
        }
    }
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

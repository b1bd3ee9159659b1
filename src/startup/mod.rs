//! Composition: assembles store, workers and HTTP into one service, and starts and stops them in order.

mod background;
mod epoch_states;
mod notices;
mod supervisor;

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
use crate::app::access::{Keys, Openness};
use crate::app::limits::{LIMITS, Limits};
use crate::app::load::Connections;
use crate::app::operator::Operator;
use crate::app::rewards::grader::Grader;
use crate::app::signing::{Others, Signing, refuse_to_begin_anew, signing};
use crate::app::webhooks::WebhookSettings;
use crate::app::webhooks::delivering::deliver;
use crate::app::{App, AppParts};
use crate::clock::{DAY_MS, now_ms};
use crate::http::middleware::rates::{RateSettings, Rates};
use crate::http::role::Role;
use crate::http::{self, HttpParts};
use crate::store::Store;
use crate::store::blobs::BlobPlace;
use crate::store::keys::{Holder, KeyCreated, Scope};
use crate::store::location::Location;
use crate::store::schema::{self, SchemaState};
use crate::store::serving::Serving;
use crate::store::suites::SuiteStored;
use crate::worker::{WorkerSettings, Workers};
use background::Shared;
use notices::{notices_of_secrets, serving_notice};
use plumbline_engine::hidden::tlog::cosignature::Witness;
use plumbline_engine::tasks::embedded;
use supervisor::Supervisor;

/// Notice of a node that only grades within requests.
const GRADE_ONLY: &str = "this node only grades within requests: it has no database, and grading needs no key. Only \
                          those who may use it should be able to reach it";

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
    /// Location of the database.
    pub database: Location,
    /// Folder of the secrets, if it is not the default one.
    pub secrets: Option<PathBuf>,
    /// Place of large logs and reports, if the operator names one.
    pub blobs: Option<BlobPlace>,
    /// Role of the node.
    pub role: Role,
    /// Number of submissions graded at the same time; 0 leaves grading to other nodes.
    pub workers: usize,
    /// Number of scripts of requests that run at the same time.
    pub cores: usize,
    /// Whether to listen for notices of other nodes.
    pub follows_notices: bool,
    /// Whether the receipt key in the folder of secrets replaces the one that the nodes signed with before.
    pub new_receipt_key: bool,
    /// Time after which a job is taken from a worker that no longer renews its lease.
    pub lease: Duration,
    /// Interval at which entries of open epochs are completed and receipts of hidden evaluation are published.
    pub hidden_publish: Duration,
    /// Server of the randomness beacon from which rounds are fetched; without one, they are brought.
    pub beacon_url: Option<String>,
    /// Witnesses of the log whose cosignatures are taken.
    pub witnesses: Vec<Witness>,
    /// Settings of webhooks.
    pub webhooks: WebhookSettings,
    /// Who runs the service.
    pub operator: Operator,
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
    app: Arc<App>,
    store: Store,
    workers: Option<Workers>,
    stop: CancellationToken,
    listeners: Vec<JoinHandle<std::io::Result<()>>>,
    tasks: Supervisor<Shared>,
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
        let (store, unreached) = open_store(config).await?;
        let settings = WorkerSettings {
            workers: config.workers,
            lease: config.lease,
            deadline: Duration::from_secs(LIMITS.grading_seconds),
        };
        let (serving, shared) = serving_notice(config.database.file())?;
        let others = if shared.is_some() { Others::Serve } else { Others::None };
        let Signing { signer, public_key, notice } = signing(&store, config.new_receipt_key, others).await?;
        let mut notices: Vec<String> = notice.into_iter().collect();
        if config.role == Role::WorkOnly && signer.is_none() {
            anyhow::bail!("{}", notices.concat());
        }
        notices.extend(shared);
        notices.extend(unreached);
        if config.role != Role::GradeOnly {
            notices.extend(notices_of_secrets(&store).await?);
        }
        notices.extend((config.role == Role::GradeOnly).then(|| GRADE_ONLY.to_owned()));
        for notice in &notices {
            tracing::warn!("{notice}");
        }
        // Grading a submission ends with a signed receipt.
        let workers = match &signer {
            Some(signer) if config.workers > 0 && config.role != Role::GradeOnly => {
                Some(Workers::start(&store, settings, signer)?)
            }
            _ => None,
        };
        let stop = CancellationToken::new();
        let connections = Connections::default();
        let rates = Arc::new(Rates::new(config.settings.rates));
        crate::telemetry::describe_metrics();
        let actions = Pool::new(config.cores, ACTION_LIMITS);
        if config.role != Role::WorkOnly {
            actions.refill();
        }
        let limits = Limits {
            requests_per_second_per_key: config.settings.rates.per_key,
            requests_per_second_per_address: config.settings.rates.per_address,
            grade_cache_bytes: config.settings.grade_cache_bytes,
            connections_per_address: config.settings.rates.connections_per_address,
            ..LIMITS
        };
        let app = App::new(AppParts {
            store: store.clone(),
            grader: Grader::new(config.settings.grade_cache_bytes, &connections, stop.clone())?,
            keys: Keys::new(config.settings.open),
            least_coverage: config.settings.least_coverage,
            limits,
            actions,
            signer,
            receipt_key: public_key,
            witnesses: config.witnesses.clone(),
            webhooks: config.webhooks.clone(),
            operator: config.operator.clone(),
            stop: stop.clone(),
        })?;
        let app = Arc::new(app);
        let tasks =
            Supervisor::new(Shared { app: Arc::clone(&app), store: store.clone(), stop: stop.clone() }, stop.clone());
        run_tasks(&tasks, config, app.signer.is_some(), &rates, &metrics);
        let parts = HttpParts { app: Arc::clone(&app), metrics, rates, role: config.role };
        let fronts = http::fronts(parts, admin_listener.is_some());
        let per_address = config.settings.rates.connections_from_one(LIMITS.connections);
        let serve = http::server::accept::serve(listener, fronts.public, connections, per_address, stop.clone());
        let mut listeners = vec![tokio::spawn(serve)];
        if let (Some(listener), Some(front)) = (admin_listener, fronts.admin) {
            let serve =
                http::server::accept::serve(listener, front, Connections::default(), LIMITS.connections, stop.clone());
            listeners.push(tokio::spawn(serve));
        }
        let admin = admin_address.map(|address| address.to_string());
        let access = config.settings.open;
        tracing::info!(%address, admin_address = admin, database = %config.database, workers = config.workers, ?access, "listening");
        Ok(Self { address, admin_address, app, store, workers, stop, listeners, tasks, _serving: serving })
    }

    /// Creates a key for the demo agents that is valid for a day, and revokes their earlier keys.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn demo_key(&self) -> anyhow::Result<String> {
        const OWNER: &str = "demo";
        let now = now_ms();
        for key in self.store.keys().await?.iter().filter(|key| key.owner == OWNER && key.is_live(now)) {
            self.store.revoke_key(&key.id, now).await?;
        }
        let holder = Holder { owner: OWNER, member: None };
        match self.store.create_key(holder, &[Scope::Submit], Some(now + DAY_MS), now).await? {
            KeyCreated::Key(key) => Ok(key),
            KeyCreated::TooMany | KeyCreated::NoMember => anyhow::bail!("the demo has too many keys"),
        }
    }

    /// Stops accepting requests, lets running requests finish, gives unfinished jobs back, and closes the database.
    pub async fn shut_down(self) {
        self.stop.cancel();
        for listener in self.listeners {
            if let Err(error) = listener.await.map_err(std::io::Error::other).flatten() {
                tracing::error!(%error, "a listener failed");
            }
        }
        if let Some(workers) = &self.workers {
            workers.shut_down().await;
        }
        self.tasks.ended().await;
        background::store_uses(&self.app).await;
        background::look_at_file(&self.store);
        self.store.close().await;
    }
}

/// Runs the background tasks of a role.
fn run_tasks(
    tasks: &Supervisor<Shared>,
    config: &Config,
    can_sign: bool,
    rates: &Arc<Rates>,
    metrics: &PrometheusHandle,
) {
    let (rates, metrics) = (Arc::clone(rates), metrics.clone());
    tasks.run("upkeep", move |shared| background::keep_up(shared, Arc::clone(&rates), metrics.clone()));
    tasks.run("uses of keys", background::keep_uses);
    if config.role == Role::GradeOnly {
        return;
    }
    tasks.run("sweep", background::sweep);
    if config.role == Role::Whole {
        tasks.run("log", background::look_at_log);
        tasks.run("webhooks", async |shared| deliver(shared.app).await);
    }
    if !can_sign {
        return;
    }
    let every = config.hidden_publish;
    tasks.run("hidden evaluation", move |shared| background::keep_hidden(shared, every));
    if config.role == Role::Whole {
        let server = config.beacon_url.clone();
        tasks.run("beacons", move |shared| background::follow_beacons(shared, server.clone()));
        tasks.run("generators", background::prepare_generators);
    }
}

/// Opens the store and brings it up to date. Returns it, and a notice if the place of blobs cannot be reached.
async fn open_store(config: &Config) -> anyhow::Result<(Store, Option<String>)> {
    let folder = config.database.file().and_then(Path::parent).filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        anyhow::bail!("cannot create the database {}: there is no folder {}", config.database, folder.display());
    }
    // What cannot be read here is told when it is opened.
    if let Ok(SchemaState { found, known, lacking, is_there: true }) = schema::state(&config.database).await
        && !lacking.is_empty()
        && found <= known
    {
        tracing::info!(found, needed = known, "bringing the schema of the database up to date");
    }
    refuse_to_begin_anew(&config.database, config.secrets.as_deref()).await?;
    let store = Store::open(&config.database, config.secrets.clone())
        .await
        .with_context(|| format!("cannot open the database {}", config.database))?;
    let unreached = match config.role {
        Role::GradeOnly => None,
        Role::Whole | Role::WorkOnly => store.settle_blobs(config.blobs.as_ref()).await?,
    };
    store_suites(&store).await?;
    if config.follows_notices {
        store.follow_notices();
    }
    Ok((store, unreached))
}

async fn listen(option: &str, place: &str) -> anyhow::Result<TcpListener> {
    let bound = TcpListener::bind(place).await;
    bound.with_context(|| format!("cannot listen on {place:?} ({option} is a host and a port, such as 127.0.0.1:7586)"))
}

async fn store_suites(store: &Store) -> anyhow::Result<()> {
    if store.has_suites(&embedded::CONTENTS).await? {
        store.refresh_catalogue().await?;
        return Ok(());
    }
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

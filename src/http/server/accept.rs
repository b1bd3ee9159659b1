//! The accept loop: bounded connections, a bound on slow headers, and a shutdown that lets answers finish.
//!
//! It has a thread of its own: among the thousands of tasks that serve connections it would wait for its turn, and new
//! connections with it.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt as _;

use super::impatient::Impatient;
use crate::app::limits::LIMITS;
use crate::app::load::{Connections, OpenConnection};
use crate::fair::{Place, Places};
use crate::http::middleware::rates::{Peer, network};

/// How long answers may take to finish after a shutdown was asked for.
const GRACE: Duration = Duration::from_secs(10);
/// Bytes that a connection holds of what it reads, and of what it has to write: requests that are sent without waiting for answers
/// fill it.
const BUFFER_BYTES: usize = 128 << 10;
/// Pause after accepting failed, as it does where files run out.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// A connection that counts as open.
struct Open {
    _counted: OpenConnection,
    _slot: OwnedSemaphorePermit,
    _place: Place,
}

/// Serves until `stop`, then lets open answers finish. One address may have `per_address` connections open; more are closed at once.
///
/// # Errors
/// Where the listener cannot be handed over or there is no thread to be had.
pub async fn serve(
    listener: TcpListener,
    router: Router,
    connections: Connections,
    per_address: usize,
    stop: CancellationToken,
) -> std::io::Result<()> {
    let serving = tokio::runtime::Handle::current();
    let places = Places::new(LIMITS.connections, per_address);
    let door = Door { router, connections, places, graceful: GracefulShutdown::new(), serving, stop: stop.clone() };
    let listener = listener.into_std()?;
    let (closed, is_closed) = oneshot::channel();
    std::thread::Builder::new().name("accept".to_owned()).spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let opened = runtime.and_then(|runtime| runtime.block_on(door.keep_open(listener, &stop)));
        // Whoever waited for it may have gone.
        let _ = closed.send(opened.map(|()| door.graceful));
    })?;
    let graceful = is_closed.await.map_err(std::io::Error::other)??;
    tokio::select! {
        () = graceful.shutdown() => {}
        () = tokio::time::sleep(GRACE) => tracing::warn!("some connections did not end in time"),
    }
    Ok(())
}

/// What accepts connections and hands them to the threads that serve.
struct Door {
    router: Router,
    connections: Connections,
    places: Arc<Places>,
    graceful: GracefulShutdown,
    serving: tokio::runtime::Handle,
    stop: CancellationToken,
}

impl Door {
    async fn keep_open(&self, listener: std::net::TcpListener, stop: &CancellationToken) -> std::io::Result<()> {
        let listener = TcpListener::from_std(listener)?;
        let slots = Arc::new(Semaphore::new(LIMITS.connections));
        loop {
            let slot = tokio::select! {
                slot = Arc::clone(&slots).acquire_owned() => slot,
                () = stop.cancelled() => return Ok(()),
            };
            let Ok(slot) = slot else { return Ok(()) };
            let accepted = tokio::select! {
                accepted = listener.accept() => accepted.and_then(|(stream, peer)| Ok((stream.into_std()?, peer))),
                () = stop.cancelled() => return Ok(()),
            };
            match accepted {
                Ok((stream, peer)) => self.let_in(stream, peer, slot),
                Err(error) => {
                    tracing::warn!(%error, "could not accept a connection");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    fn let_in(&self, stream: std::net::TcpStream, peer: SocketAddr, slot: OwnedSemaphorePermit) {
        let Ok(place) = self.places.take(&Arc::from(network(peer.ip()).to_string())) else {
            metrics::counter!("plumbline_connections_refused_total").increment(1);
            return;
        };
        let open = Open { _counted: self.connections.count(), _slot: slot, _place: place };
        let (router, graceful, stop) = (self.router.clone(), self.graceful.watcher(), self.stop.clone());
        self.serving.spawn(async move {
            let _open = open;
            let stream = match TcpStream::from_std(stream) {
                Ok(stream) => stream,
                Err(error) => return tracing::warn!(%error, "could not take over a connection"),
            };
            if let Err(error) = serve_one(stream, peer, router, graceful, stop).await {
                tracing::debug!(%error, "connection ended");
            }
        });
    }
}

async fn serve_one(
    stream: TcpStream,
    peer: SocketAddr,
    router: Router,
    graceful: Watcher,
    stop: CancellationToken,
) -> hyper::Result<()> {
    // Small answers must not wait for more to send; failing to say so only costs time.
    let _ = stream.set_nodelay(true);
    // HTTP/1 alone: telling HTTP/2 apart would wait for the first bytes without a bound.
    let mut builder = http1::Builder::new();
    let headers = Duration::from_secs(LIMITS.header_seconds);
    builder.timer(TokioTimer::new()).header_read_timeout(headers).max_buf_size(BUFFER_BYTES);
    let service = router.map_request(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(Peer(peer));
        request.map(Body::new)
    });
    let stream = Impatient::new(stream, Duration::from_secs(LIMITS.write_seconds), stop);
    let connection = builder.serve_connection(TokioIo::new(stream), TowerToHyperService::new(service));
    graceful.watch(connection).await
}

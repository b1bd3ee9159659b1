//! The accept loop: limits on connections and on slow headers, and a shutdown that lets responses finish.
//!
//! It runs on a thread of its own. Among the thousands of tasks that serve connections, it would wait to be scheduled
//! and delay new connections.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use futures_util::FutureExt as _;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio_util::sync::CancellationToken;

use super::impatient::Impatient;
use crate::app::limits::LIMITS;
use crate::app::load::{Connections, OpenConnection};
use crate::fair::{Permit, PermitPool};
use crate::http::middleware::front::Front;
use crate::http::middleware::rates::{Peer, network};

/// How long responses may take to finish after a shutdown is requested.
const GRACE: Duration = Duration::from_secs(10);
/// Pause after accepting a connection failed, for example because there are no file descriptors left.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Guards of an open connection: its count, its slot, and its share per address.
struct Open {
    _counted: OpenConnection,
    _slot: OwnedSemaphorePermit,
    _permit: Permit,
}

/// Serves until `stop` is cancelled, then lets open responses finish. Each address may have `per_address` open
/// connections; further ones are closed at once.
///
/// # Errors
/// Returns an error if the listener cannot be handed over, or if the accept thread cannot be started.
pub async fn serve(
    listener: TcpListener,
    front: Front,
    connections: Connections,
    per_address: usize,
    stop: CancellationToken,
) -> std::io::Result<()> {
    let serving = tokio::runtime::Handle::current();
    let permits = PermitPool::new(LIMITS.connections, per_address);
    let acceptor =
        Acceptor { front, connections, permits, graceful: GracefulShutdown::new(), serving, stop: stop.clone() };
    let listener = listener.into_std()?;
    let (closed, is_closed) = oneshot::channel();
    std::thread::Builder::new().name("accept".to_owned()).spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let opened = runtime.and_then(|runtime| runtime.block_on(acceptor.run(listener, &stop)));
        // The receiver may have been dropped.
        let _ = closed.send(opened.map(|()| acceptor.graceful));
    })?;
    let graceful = is_closed.await.map_err(std::io::Error::other)??;
    tokio::select! {
        () = graceful.shutdown() => {}
        () = tokio::time::sleep(GRACE) => tracing::warn!("some connections did not end in time"),
    }
    Ok(())
}

/// Acceptor of connections, which hands them to the threads that serve.
struct Acceptor {
    front: Front,
    connections: Connections,
    permits: Arc<PermitPool>,
    graceful: GracefulShutdown,
    serving: tokio::runtime::Handle,
    stop: CancellationToken,
}

impl Acceptor {
    async fn run(&self, listener: std::net::TcpListener, stop: &CancellationToken) -> std::io::Result<()> {
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
                Ok((stream, peer)) => self.spawn_connection(stream, peer, slot),
                Err(error) => {
                    tracing::warn!(%error, "could not accept a connection");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    fn spawn_connection(&self, stream: std::net::TcpStream, peer: SocketAddr, slot: OwnedSemaphorePermit) {
        let Ok(permit) = self.permits.take(&Arc::from(network(peer.ip()).to_string())) else {
            metrics::counter!("plumbline_connections_refused_total").increment(1);
            return;
        };
        let open = Open { _counted: self.connections.count(), _slot: slot, _permit: permit };
        let (front, graceful, stop) = (self.front.clone(), self.graceful.watcher(), self.stop.clone());
        self.serving.spawn(async move {
            let _open = open;
            let stream = match TcpStream::from_std(stream) {
                Ok(stream) => stream,
                Err(error) => return tracing::warn!(%error, "could not hand over a connection"),
            };
            if let Err(error) = serve_one(stream, peer, front, graceful, stop).await {
                tracing::debug!(%error, "connection ended");
            }
        });
    }
}

async fn serve_one(
    stream: TcpStream,
    peer: SocketAddr,
    front: Front,
    graceful: Watcher,
    stop: CancellationToken,
) -> hyper::Result<()> {
    // Small responses must not wait for more data to send. If the option cannot be set, they are only slower.
    let _ = stream.set_nodelay(true);
    // Only HTTP/1: detecting HTTP/2 would wait for the first bytes without a time limit.
    let mut builder = http1::Builder::new();
    let headers = Duration::from_secs(LIMITS.header_seconds);
    builder.timer(TokioTimer::new()).header_read_timeout(headers);
    // The size of a connection's buffer for reading, which bounds a request's head, and of that for writing. A client
    // that pipelines requests fills them.
    builder.max_buf_size(LIMITS.head_bytes);
    let service = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(Peer(peer));
        // hyper reserves room for this future as long as the connection is open, so what a request takes is in a box.
        front.clone().answer(request.map(Body::new)).boxed().map(Ok::<_, Infallible>)
    });
    let stream = Impatient::new(stream, Duration::from_secs(LIMITS.write_seconds), stop);
    let connection = builder.serve_connection(TokioIo::new(stream), service);
    graceful.watch(connection).await
}

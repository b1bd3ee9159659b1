//! A stream that fails if its client stops reading. Otherwise the connection would hold memory and delay a shutdown.

use std::future::Future as _;
use std::io::{self, ErrorKind, IoSlice};
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Sleep, sleep};
use tokio_util::sync::{CancellationToken, WaitForCancellationFutureOwned};

/// How long a client may read nothing once the service is stopping.
const STOPPING: Duration = Duration::from_secs(1);

/// A stream that limits how long a write may make no progress.
#[derive(Debug)]
pub struct Impatient<S> {
    stream: S,
    patience: Duration,
    /// Timeout of a write that makes no progress.
    still: Option<Pin<Box<Sleep>>>,
    stop: Pin<Box<WaitForCancellationFutureOwned>>,
    is_stopping: bool,
}

impl<S> Impatient<S> {
    /// Wraps a stream whose writes may stall for up to `patience`, or for up to a second once `stop` is cancelled.
    pub fn new(stream: S, patience: Duration, stop: CancellationToken) -> Self {
        Self { stream, patience, still: None, stop: Box::pin(stop.cancelled_owned()), is_stopping: false }
    }

    /// Returns the result of a write, or an error if it has made no progress for too long.
    fn watched<T>(&mut self, written: Poll<io::Result<T>>, context: &mut Context<'_>) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.still = None;
            return written;
        }
        if !self.is_stopping && self.stop.as_mut().poll(context).is_ready() {
            self.is_stopping = true;
            self.still = Some(Box::pin(sleep(STOPPING.min(self.patience))));
        }
        let patience = if self.is_stopping { STOPPING.min(self.patience) } else { self.patience };
        let still = self.still.get_or_insert_with(|| Box::pin(sleep(patience)));
        if still.as_mut().poll(context).is_pending() {
            return Poll::Pending;
        }
        Poll::Ready(Err(io::Error::new(ErrorKind::TimedOut, "the client does not read its response")))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Impatient<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Impatient<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.watched(written, context)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let flushed = Pin::new(&mut self.stream).poll_flush(context);
        self.watched(flushed, context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let shut = Pin::new(&mut self.stream).poll_shutdown(context);
        self.watched(shut, context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, bytes);
        self.watched(written, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    #[tokio::test]
    async fn who_takes_nothing_is_let_go_and_who_is_slow_is_not() {
        let patience = Duration::from_millis(900);
        let (service, mut client) = tokio::io::duplex(64);
        let mut service = Impatient::new(service, patience, CancellationToken::new());
        let reading = tokio::spawn(async move {
            for _ in 0..4 {
                sleep(Duration::from_millis(300)).await;
                client.read_exact(&mut [0; 64]).await.unwrap();
            }
            client
        });
        service.write_all(&[1; 5 * 64]).await.unwrap();
        let client = reading.await.unwrap();
        let stuck = service.write_all(&[1; 64]).await.unwrap_err();
        assert_eq!(stuck.kind(), ErrorKind::TimedOut);
        drop(client);
    }

    #[tokio::test]
    async fn a_shutdown_waits_a_moment_only() {
        let stop = CancellationToken::new();
        let (service, _client) = tokio::io::duplex(64);
        let mut service = Impatient::new(service, Duration::from_mins(10), stop.clone());
        let writing = tokio::spawn(async move { service.write_all(&[1; 128]).await });
        sleep(Duration::from_millis(50)).await;
        stop.cancel();
        assert_eq!(writing.await.unwrap().unwrap_err().kind(), ErrorKind::TimedOut);
    }
}

//! A line to a server, which a test makes faulty.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

/// What the line does with what comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Passes {
    /// It passes it on.
    All,
    /// It passes it on after a time.
    Late,
    /// It takes it and says nothing. Connections of this time stay dead for ever.
    Nothing,
    /// It ends all connections, and refuses new ones.
    Cut,
}

/// A line to a port of this machine. The test's runtime passes the bytes on, so it must have a thread for it.
pub struct Line {
    /// The port at which the line begins.
    pub port: u16,
    passes: watch::Sender<Passes>,
    dead: Arc<AtomicUsize>,
}

impl Line {
    pub async fn to(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let own = listener.local_addr().unwrap().port();
        let (passes, seen) = watch::channel(Passes::All);
        let dead = Arc::new(AtomicUsize::new(0));
        let counted = Arc::clone(&dead);
        tokio::spawn(async move {
            while let Ok((one, _)) = listener.accept().await {
                if *seen.borrow() != Passes::Cut {
                    tokio::spawn(connect(one, port, seen.clone(), Arc::clone(&counted)));
                }
            }
        });
        Self { port: own, passes, dead }
    }

    pub fn set(&self, passes: Passes) {
        self.passes.send_replace(passes);
    }

    /// Returns the number of connections that passed nothing on.
    pub fn dead(&self) -> usize {
        self.dead.load(Ordering::Relaxed)
    }
}

/// Passes on both ways until one side ends the connection, or the line is cut.
async fn connect(one: TcpStream, port: u16, mut passes: watch::Receiver<Passes>, dead: Arc<AtomicUsize>) {
    let Ok(other) = TcpStream::connect(("127.0.0.1", port)).await else { return };
    let (seen, is_dead) = (passes.clone(), AtomicBool::new(false));
    let ((from_one, to_one), (from_other, to_other)) = (one.into_split(), other.into_split());
    tokio::select! {
        _ = pass(from_one, to_other, seen.clone(), (&is_dead, &dead)) => {}
        _ = pass(from_other, to_one, seen, (&is_dead, &dead)) => {}
        _ = passes.wait_for(|passes| *passes == Passes::Cut) => {}
    }
}

/// Passes bytes on, as the line does now.
async fn pass(
    mut from: impl AsyncRead + Unpin,
    mut to: impl AsyncWrite + Unpin,
    passes: watch::Receiver<Passes>,
    (is_dead, dead): (&AtomicBool, &AtomicUsize),
) -> std::io::Result<()> {
    let mut bytes = vec![0; 16 << 10];
    loop {
        let count = from.read(&mut bytes).await?;
        let now = *passes.borrow();
        match now {
            Passes::Late => tokio::time::sleep(Duration::from_millis(150)).await,
            Passes::Nothing if !is_dead.swap(true, Ordering::Relaxed) => {
                dead.fetch_add(1, Ordering::Relaxed);
            }
            Passes::All | Passes::Nothing | Passes::Cut => {}
        }
        if is_dead.load(Ordering::Relaxed) {
            // Whoever forgot a connection does not tell its ends either.
            std::future::pending::<()>().await;
        }
        if count == 0 {
            return to.shutdown().await;
        }
        to.write_all(&bytes[..count]).await?;
    }
}

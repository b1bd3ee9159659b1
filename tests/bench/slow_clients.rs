//! Many slow clients at once, and how others are served meanwhile: `slow_clients ADDRESS IDLE SLOW SECONDS`.
//!
//! IDLE connections send nothing and are opened anew when the service closes them. SLOW connections post a body of
//! which a byte comes every second. Beside them one client asks for the limits and grades a log, on a new connection
//! each time.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

#[derive(Default)]
struct Counts {
    open: AtomicU64,
    closed: AtomicU64,
    failed: AtomicU64,
}

async fn idle(address: String, counts: Arc<Counts>) {
    loop {
        let Ok(mut stream) = TcpStream::connect(&address).await else {
            counts.failed.fetch_add(1, Ordering::Relaxed);
            tokio::time::sleep(Duration::from_secs(1)).await;
            continue;
        };
        counts.open.fetch_add(1, Ordering::Relaxed);
        // It ends when the service closes it.
        let _ = stream.read(&mut [0; 1024]).await;
        counts.open.fetch_sub(1, Ordering::Relaxed);
        counts.closed.fetch_add(1, Ordering::Relaxed);
    }
}

async fn slow(address: String, counts: Arc<Counts>) {
    const HEAD: &str =
        "POST /v1/grade HTTP/1.1\r\nhost: a\r\ncontent-type: application/json\r\ncontent-length: 100000\r\n\r\n";
    loop {
        let Ok(mut stream) = TcpStream::connect(&address).await else {
            counts.failed.fetch_add(1, Ordering::Relaxed);
            tokio::time::sleep(Duration::from_secs(1)).await;
            continue;
        };
        counts.open.fetch_add(1, Ordering::Relaxed);
        let mut answer = [0; 1024];
        let mut written = stream.write_all(HEAD.as_bytes()).await;
        while written.is_ok() {
            if let Ok(_answered) = tokio::time::timeout(Duration::from_secs(1), stream.read(&mut answer)).await {
                break;
            }
            written = stream.write_all(b" ").await;
        }
        counts.open.fetch_sub(1, Ordering::Relaxed);
        counts.closed.fetch_add(1, Ordering::Relaxed);
    }
}

async fn ask(address: &str, request: &str) -> anyhow::Result<Duration> {
    let begun = Instant::now();
    let mut stream = TcpStream::connect(address).await?;
    stream.write_all(request.as_bytes()).await?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await?;
    anyhow::ensure!(answer.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&answer));
    Ok(begun.elapsed())
}

fn percentiles(name: &str, mut took: Vec<Duration>) {
    took.sort();
    let at = |share: f64| took[((took.len() - 1) as f64 * share) as usize].as_secs_f64() * 1_000.0;
    println!("{name}: {} requests, p50 {:.2}  p99 {:.2}  max {:.2} ms", took.len(), at(0.5), at(0.99), at(1.0));
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [address, idles, slows, seconds] = arguments.as_slice() else {
        anyhow::bail!("expected an address, numbers of idle and slow connections, and seconds");
    };
    let counts = Arc::new(Counts::default());
    let wanted = idles.parse::<u64>()? + slows.parse::<u64>()?;
    for _ in 0..idles.parse()? {
        tokio::spawn(idle(address.clone(), Arc::clone(&counts)));
    }
    for _ in 0..slows.parse()? {
        tokio::spawn(slow(address.clone(), Arc::clone(&counts)));
    }
    let begun = Instant::now();
    while counts.open.load(Ordering::Relaxed) < wanted * 95 / 100 {
        anyhow::ensure!(begun.elapsed() < Duration::from_mins(1), "the connections do not open");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    println!("{wanted} connections open after {:.1} s", begun.elapsed().as_secs_f64());
    let body = r#"{"task":1,"turns":[{"palette":["stone"],"rows":[[0,0,0,0]]}]}"#;
    let limits = "GET /v1/limits HTTP/1.1\r\nhost: a\r\nconnection: close\r\n\r\n";
    let grade = format!(
        "POST /v1/grade HTTP/1.1\r\nhost: a\r\nconnection: close\r\ncontent-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    );
    let (mut reads, mut grades) = (Vec::new(), Vec::new());
    let begun = Instant::now();
    let mut least = u64::MAX;
    while begun.elapsed().as_secs() < seconds.parse()? {
        reads.push(ask(address, limits).await.context("limits")?);
        grades.push(ask(address, &grade).await.context("grade")?);
        least = least.min(counts.open.load(Ordering::Relaxed));
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    percentiles("limits", reads);
    percentiles("grade", grades);
    println!(
        "meanwhile at least {least} were open; {} were closed by the service, {} could not connect",
        counts.closed.load(Ordering::Relaxed),
        counts.failed.load(Ordering::Relaxed)
    );
    Ok(())
}

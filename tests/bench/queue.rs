//! Rates of the queue on a database, without HTTP and without grading: `queue DATABASE JOBS [--hold]`.
//!
//! Accepts so many submissions one at a time from 64 tasks, claims them in batches, and records a report of each. With
//! `--hold` a transaction stays open on PostgreSQL all the while, which keeps the server from removing deleted rows.

mod submission;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use plumbline::app::submissions::decision::decide_all;
use plumbline::clock::now_ms;
use plumbline::store::Store;
use plumbline::store::claims::Claimed;
use plumbline::store::location::Location;
use plumbline::store::queue::Lane;
use plumbline::store::reports::PackedReport;
use plumbline::store::submissions::NewSubmission;
use plumbline_engine::builders::build;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::grade_hashed;
use plumbline_engine::tasks::embedded;
use submission::submission;

const POSTING: usize = 64;
const CLAIMING: usize = 2;

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (database, jobs) = match arguments.as_slice() {
        [database, jobs, ..] => (database.parse::<Location>()?, jobs.parse::<usize>()?),
        _ => anyhow::bail!("expected a database and a number of jobs"),
    };
    let store = Store::open(&database, None).await?;
    store.follow_notices();
    let suite = embedded::latest().map_err(|faults| anyhow::anyhow!("{faults:?}"))?;
    store.put_suite(&suite, now_ms()).await?;
    let held = match (&database, arguments.iter().any(|argument| argument == "--hold")) {
        (Location::Server(_), true) => Some(hold(&arguments[0]).await?),
        _ => None,
    };
    let task = suite.tasks[0].clone();
    let log = build(&task).map_err(|error| anyhow::anyhow!("{error:?}"))?;
    let report = grade_hashed(&task, &task.content_hash(), &log, &Control::unhurried())
        .map_err(|error| anyhow::anyhow!("{error:?}"))?;
    let packed = PackedReport::of(&report, 1)?;
    let new = Arc::new(submission(&suite, &task, &log)?);

    let begun = Instant::now();
    let next = Arc::new(AtomicUsize::new(0));
    let mut posting = tokio::task::JoinSet::new();
    for _ in 0..POSTING {
        let (store, next, new) = (store.clone(), Arc::clone(&next), Arc::clone(&new));
        posting.spawn(async move {
            while next.fetch_add(1, Ordering::Relaxed) < jobs {
                let one = NewSubmission { id: uuid::Uuid::now_v7().to_string(), ..(*new).clone() };
                store.accept(Arc::new([one]), None, decide_all, now_ms()).await?;
            }
            Ok::<_, anyhow::Error>(())
        });
    }
    while let Some(done) = posting.join_next().await {
        done??;
    }
    tell("accepted, one at a time", jobs, begun.elapsed());

    let begun = Instant::now();
    let (claimed, spent) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
    let mut claiming = tokio::task::JoinSet::new();
    for _ in 0..CLAIMING {
        let (store, packed) = (store.clone(), packed.clone());
        let (claimed, spent) = (Arc::clone(&claimed), Arc::clone(&spent));
        claiming.spawn(async move {
            loop {
                let looked = Instant::now();
                let found = store.claim(&[Lane::Quick], 60_000, 64).await?;
                spent.fetch_add(usize::try_from(looked.elapsed().as_micros())?, Ordering::Relaxed);
                let Claimed::Jobs(claims) = found else { return Ok::<_, anyhow::Error>(()) };
                let count = claims.len();
                let mut graded: Vec<_> = claims.into_iter().map(|claim| (claim, packed.clone())).collect();
                store.record(&mut graded, now_ms()).await?;
                let before = claimed.fetch_add(count, Ordering::Relaxed);
                if before / 100_000 != (before + count) / 100_000 {
                    println!("  {} done", before + count);
                }
            }
        });
    }
    while let Some(done) = claiming.join_next().await {
        done??;
    }
    let all = claimed.load(Ordering::Relaxed);
    tell("claimed and recorded", all, begun.elapsed());
    let spent = Duration::from_micros(spent.load(Ordering::Relaxed) as u64) / u32::try_from(CLAIMING)?;
    tell("claimed, by the time of claims alone", all, spent);
    drop(held);
    store.close().await;
    Ok(())
}

/// Begins a transaction that reads, and keeps it open.
async fn hold(url: &str) -> anyhow::Result<sqlx::Transaction<'static, sqlx::Postgres>> {
    let pool = sqlx::PgPool::connect(url).await?;
    let mut tx = pool.begin_with("BEGIN ISOLATION LEVEL REPEATABLE READ").await?;
    sqlx::query("SELECT COUNT(*) FROM jobs").execute(&mut *tx).await?;
    Ok(tx)
}

fn tell(what: &str, count: usize, took: Duration) {
    println!("{what}: {count} in {:.1} s, {:.0}/s", took.as_secs_f64(), count as f64 / took.as_secs_f64());
}

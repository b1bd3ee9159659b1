//! `plumbline epochs`: announces, lists and closes epochs. `plumbline verify-epoch`: checks a reveal without the service.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand, ValueEnum};
use jiff::Timestamp;
use rayon::prelude::*;
use serde_json::Value;

use super::{database, progress};
use crate::clock::{now_ms, rfc3339};
use crate::epochs::commitment::{Commitment, Terms, leaf_hash};
use crate::epochs::feedback::Feedback;
use crate::epochs::pool::{Generator, PoolError, Specification};
use crate::epochs::reveal::{Reveal, verify};
use crate::epochs::secret::EpochKey;
use crate::store::Store;
use crate::store::epochs::EpochRules;
use crate::store::secrets::{EpochSecret, random_key};
use crate::voxel::BlockLog;

/// Arguments of `epochs`.
#[derive(Debug, Args)]
pub struct EpochsArgs {
    /// The service's database.
    #[arg(long, env = "PLUMBLINE_DATABASE", default_value = "plumbline.db", global = true)]
    database: PathBuf,
    #[command(subcommand)]
    command: EpochsCommand,
}

#[derive(Debug, Subcommand)]
enum EpochsCommand {
    /// Make a key, draw and certify a pool of specifications, and publish the commitment to both.
    Create(CreateArgs),
    /// List epochs.
    List,
    /// Close an epoch before its time; the reason is public.
    Close {
        /// The epoch.
        name: String,
        /// Why.
        #[arg(long)]
        reason: String,
    },
}

/// What entries of the dev tier are told once they are finalized.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum DevFeedback {
    /// How many instances pass.
    ScoreOnly,
    /// That, and how many per criterion.
    Criteria,
    /// Nothing before the epoch is over.
    AfterEpoch,
}

#[derive(Debug, Args)]
struct CreateArgs {
    /// Its name: lower-case letters, digits and dashes, such as 2026-11.
    name: String,
    /// When it opens, such as 2026-11-01T00:00:00Z; by default at once.
    #[arg(long)]
    opens: Option<Timestamp>,
    /// When it closes, such as 2026-12-01T00:00:00Z.
    #[arg(long)]
    closes: Timestamp,
    /// Specifications for each instance of a draw: so many runs can be drawn before the pool is used up.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    per_instance: u32,
    /// What entries of the dev tier are told.
    #[arg(long, value_enum, default_value_t = DevFeedback::ScoreOnly)]
    dev_feedback: DevFeedback,
    /// Seconds in which an instance is to be answered.
    #[arg(long, default_value_t = 86_400, value_parser = clap::value_parser!(u32).range(1..=31_536_000))]
    instance_seconds: u32,
    /// Entries to the dev tier that one owner may register.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    dev_entries: u32,
    /// Entries to the official tier that one owner may register.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    official_entries: u32,
    /// Bits of information that may be released before the epoch closes by itself.
    #[arg(long, default_value_t = 2_000)]
    budget_bits: u32,
}

/// Arguments of `verify-epoch`.
#[derive(Debug, Args)]
pub struct VerifyEpochArgs {
    /// What `GET /v1/epochs/NAME/reveal` gave.
    reveal: PathBuf,
    /// What `GET /v1/epochs/NAME/answers` gave: the logs, which are graded again.
    #[arg(long)]
    answers: Option<PathBuf>,
    /// The epoch as it was published before it opened, kept since (`GET /v1/epochs/NAME`). Without it the reveal is compared with
    /// the commitment that it brings itself.
    #[arg(long)]
    commitment: Option<PathBuf>,
}

/// Runs `epochs`.
///
/// # Errors
/// Where arguments do not fit, or a file or the database fails.
pub fn run(args: &EpochsArgs) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let store = database::open(&args.database).await?;
        match &args.command {
            EpochsCommand::Create(new) => create(&store, new).await?,
            EpochsCommand::List => list(&store).await?,
            EpochsCommand::Close { name, reason } => {
                if store.epoch(name).await?.is_none() {
                    bail!("there is no epoch {name:?}");
                }
                if !store.close_epoch(name, reason.trim(), now_ms()).await? {
                    bail!("the epoch {name:?} is over");
                }
                println!("closed {name}");
            }
        }
        store.close().await;
        Ok(ExitCode::SUCCESS)
    })
}

async fn create(store: &Store, new: &CreateArgs) -> anyhow::Result<()> {
    let is_slug = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-';
    if new.name.is_empty() || new.name.len() > 64 || !new.name.bytes().all(is_slug) {
        bail!("{:?} is not a name of lower-case letters, digits and dashes, 64 at most", new.name);
    }
    let closes_at_ms = new.closes.as_millisecond();
    if new.opens.is_some_and(|opens| opens.as_millisecond() < now_ms()) {
        bail!("it would open in the past, before anybody has seen its commitment");
    }
    if closes_at_ms <= new.opens.map_or_else(now_ms, Timestamp::as_millisecond) {
        bail!("it would close at {}, before it opens or in the past", rfc3339(closes_at_ms));
    }
    if store.epoch(&new.name).await?.is_some() {
        bail!("there is an epoch {:?} already", new.name);
    }
    let key = EpochKey::new(random_key()?);
    let generator = Generator::new()?;
    let strata = generator.strata(&key, new.per_instance);
    let total: u32 = strata.iter().map(|stratum| stratum.size).sum();
    let bar = progress::bar(total as usize, "drawing and certifying");
    let drawn: Result<Vec<Vec<Specification>>, PoolError> =
        strata.par_iter().map(|stratum| generator.specifications(&key, stratum, &|| bar.inc(1))).collect();
    bar.finish_and_clear();
    let specifications = drawn?.concat();
    // Drawing takes its time; the epoch opens after it, whatever was asked for.
    let now = now_ms();
    let opens_at_ms = new.opens.map_or(now, Timestamp::as_millisecond).max(now);
    let hashes: Vec<_> = specifications.iter().map(|own| leaf_hash(&key, own)).collect();
    let terms = Terms {
        epoch: new.name.clone(),
        opens_at_ms,
        closes_at_ms,
        per_instance: new.per_instance,
        dev_feedback: match new.dev_feedback {
            DevFeedback::ScoreOnly => Feedback::ScoreOnly,
            DevFeedback::Criteria => Feedback::Criteria,
            DevFeedback::AfterEpoch => Feedback::AfterEpoch,
        },
    };
    let commitment = Commitment::to(&terms, &key, &strata, &hashes);
    let rules = EpochRules {
        instance_ms: i64::from(new.instance_seconds) * 1_000,
        dev_entries: i64::from(new.dev_entries),
        official_entries: i64::from(new.official_entries),
        budget_bits: f64::from(new.budget_bits),
    };
    let secret = EpochSecret { key, strata, specifications };
    if !store.create_epoch(&commitment, &rules, &secret, now).await? {
        bail!("a key of an epoch {:?} is kept already in {}", new.name, store.secrets().folder().display());
    }
    println!("{}", serde_json::to_string_pretty(&commitment)?);
    eprintln!(
        "epoch {} is announced; its key and pool are in {}: copies of the database do not hold them, so keep a copy where only you \
         can read it",
        new.name,
        store.secrets().folder().display()
    );
    Ok(())
}

async fn list(store: &Store) -> anyhow::Result<()> {
    for epoch in store.epochs().await? {
        let counts = store.epoch_counts(epoch.id()).await?;
        println!(
            "{}  {}  {} to {}  {} dev and {} official entries, {} of {} specifications issued, {:.0} of {:.0} bits released{}",
            epoch.id(),
            epoch.state(now_ms()),
            rfc3339(epoch.commitment.opens_at_ms),
            rfc3339(epoch.commitment.closes_at_ms),
            counts.dev,
            counts.official,
            counts.issued,
            epoch.commitment.specifications,
            epoch.released_bits,
            epoch.rules.budget_bits,
            epoch.closed.as_ref().map_or_else(String::new, |(_, reason)| format!("  closed: {reason}")),
        );
    }
    Ok(())
}

fn read_json(path: &Path) -> anyhow::Result<Value> {
    let text = std::fs::read(path).with_context(|| path.display().to_string())?;
    serde_json::from_slice(&text).with_context(|| path.display().to_string())
}

/// Reads answers: a JSON object a line, with the instance and its log.
fn read_answers(path: &Path) -> anyhow::Result<BTreeMap<String, BlockLog>> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let mut logs = BTreeMap::new();
    for (number, line) in (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty()) {
        let place = || format!("{}: line {number}", path.display());
        let answer: Value = serde_json::from_str(line).with_context(place)?;
        let instance = answer["instance"].as_str().with_context(place)?.to_owned();
        let log = BlockLog::from_canonical_json(answer["log"].to_string().as_bytes());
        logs.insert(instance, log.map_err(|error| anyhow::anyhow!("{}: {error}", place()))?);
    }
    Ok(logs)
}

/// Runs `verify-epoch`: exit 1 where anything does not hold.
///
/// # Errors
/// Where a file cannot be read.
pub fn run_verify(args: &VerifyEpochArgs) -> anyhow::Result<ExitCode> {
    let place = || args.reveal.display().to_string();
    let reveal: Reveal = serde_json::from_value(read_json(&args.reveal)?).with_context(place)?;
    let promised = args.commitment.as_deref().map(|path| -> anyhow::Result<Commitment> {
        let kept = read_json(path)?;
        // The epoch's own page, or the commitment alone.
        let commitment = kept.get("commitment").cloned().unwrap_or(kept);
        serde_json::from_value(commitment).with_context(|| path.display().to_string())
    });
    let promised = promised.transpose()?;
    let logs = args.answers.as_deref().map(read_answers).transpose()?;
    let graded = reveal.instances.iter().filter(|instance| instance.log_sha256.is_some()).count();
    let mut reveal = reveal;
    if logs.is_none() {
        eprintln!("without --answers the {graded} grades are not checked");
        for instance in &mut reveal.instances {
            (instance.log_sha256, instance.overall, instance.scores) = (None, None, None);
        }
    }
    if promised.is_none() {
        eprintln!("without --commitment, kept from before the epoch opened, the reveal is compared with itself");
    }
    let found = verify(&reveal, promised.as_ref(), &logs.unwrap_or_default())?;
    println!(
        "epoch {}: {} of {} specifications, {} of {} draws and {} of {graded} grades were made again and are the same",
        reveal.commitment.epoch,
        found.specifications,
        reveal.commitment.specifications,
        found.draws,
        reveal.instances.len(),
        found.grades
    );
    if found.ungraded > 0 {
        println!("{} answers were not graded, through failures of the service, and count as failed", found.ungraded);
    }
    for breach in &found.breaches {
        println!("BROKEN  {breach}");
    }
    Ok(if found.breaches.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

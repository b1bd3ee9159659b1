//! `plumbline epochs`: announces, lists and closes epochs.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand, ValueEnum};

use super::database::DatabaseArgs;
use super::process::{block_on, say};
use super::{files, progress};
use crate::app::hidden::pools::publish_pool;
use crate::app::limits::LIMITS;
use crate::app::signing::{Others, signing};
use crate::client::{DRAND, fetch_round};
use crate::clock::{DAY_MS, day_ms, milliseconds, now_ms, rfc3339};
use crate::store::Store;
use crate::store::epochs::EpochRules;
use crate::store::secrets::{EpochSecret, PoolFile, random_key};
use plumbline_engine::hidden::beacon::{Beacon, Chain};
use plumbline_engine::hidden::commitment::{Commitment, Rules, Terms, root_of};
use plumbline_engine::hidden::feedback::{Feedback, released_bits};
use plumbline_engine::hidden::pool::Generator;
use plumbline_engine::hidden::secret::EpochKey;
use plumbline_engine::hidden::siblings::Siblings;
use plumbline_engine::hidden::{GENERATOR_VERSION, PROTOCOL};
use plumbline_engine::voxel::Profile;

/// Arguments of `epochs`.
#[derive(Debug, Args)]
pub struct EpochsArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: EpochsCommand,
}

#[derive(Debug, Subcommand)]
enum EpochsCommand {
    /// Announce an epoch: create a key, draw and certify a pool of specifications, and publish the commitment to both.
    Create(CreateArgs),
    /// List epochs.
    List,
    /// Bring the round of the beacon that an epoch is bound to, from which its pool is made. `serve --beacon-url` does
    /// so by itself.
    Beacon {
        /// Name of the epoch.
        name: String,
        /// File with the round as the beacon's servers publish it (`/CHAIN-HASH/public/ROUND`), or the address of such
        /// a server.
        #[arg(long, value_name = "FILE|URL", default_value = DRAND)]
        from: String,
    },
    /// Close an epoch early; the reason is published.
    Close {
        /// Name of the epoch.
        name: String,
        /// Reason, which is published.
        #[arg(long)]
        reason: String,
    },
}

/// Feedback on finalized entries of the dev tier.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum DevFeedback {
    /// Number of instances that pass.
    ScoreOnly,
    /// Number of instances that pass, in all and per criterion.
    Criteria,
    /// No feedback before the epoch is over.
    AfterEpoch,
}

impl From<DevFeedback> for Feedback {
    fn from(feedback: DevFeedback) -> Self {
        match feedback {
            DevFeedback::ScoreOnly => Self::ScoreOnly,
            DevFeedback::Criteria => Self::Criteria,
            DevFeedback::AfterEpoch => Self::AfterEpoch,
        }
    }
}

#[derive(Debug, Args)]
struct CreateArgs {
    /// Name of the epoch: lower-case letters, digits and dashes, such as 2026-11.
    name: String,
    /// Opening time, such as 2026-11-01T00:00:00Z; a date stands for the beginning of that day in UTC. By default, the
    /// epoch opens at once.
    #[arg(long, value_name = "TIME", value_parser = opening_ms)]
    opens: Option<i64>,
    /// Closing time, such as 2026-12-01T00:00:00Z; a date stands for the end of that day in UTC.
    #[arg(long, value_name = "TIME", value_parser = closing_ms)]
    closes: i64,
    /// Specifications for each instance of a draw, which is the number of runs that can be drawn from the pool.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    per_instance: u32,
    /// Feedback on finalized entries of the dev tier, while the epoch is open.
    #[arg(long, value_enum, default_value_t = DevFeedback::ScoreOnly)]
    dev_feedback: DevFeedback,
    /// Seconds within which an instance must be answered.
    #[arg(long, default_value_t = 86_400, value_parser = clap::value_parser!(u32).range(1..=31_536_000))]
    instance_seconds: u32,
    /// Number of entries to the dev tier that one owner may register.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    dev_entries: u32,
    /// Number of entries to the official tier that one owner may register.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    official_entries: u32,
    /// Percentage of the pool that one owner may hold in drawn and reserved runs.
    #[arg(long, default_value_t = 25, value_parser = clap::value_parser!(u8).range(1..=100))]
    owner_percent: u8,
    /// Seconds for which a registered run that is not drawn keeps its share of the pool; later, it can only be drawn if
    /// the pool has room.
    #[arg(long, default_value_t = 259_200, value_parser = clap::value_parser!(u32).range(1..=31_536_000))]
    reservation_seconds: u32,
    /// Bind the pool to a public randomness beacon (drand): nobody, the operator included, knows a specification before
    /// the first round at or after --opens. Official entries are registered until then.
    #[arg(long, requires = "opens")]
    beacon: bool,
    /// File that describes another chain than quicknet, as its servers do (`/CHAIN-HASH/info`).
    #[arg(long, value_name = "FILE", requires = "beacon")]
    beacon_chain: Option<PathBuf>,
    /// Do not draw public siblings. Official runs then need half as many answers, but the board cannot tell whether an
    /// agent knows public builds by heart.
    #[arg(long)]
    no_siblings: bool,
    /// Bits of information that may be released before the epoch closes automatically.
    #[arg(long, default_value_t = 2_000)]
    budget_bits: u32,
}

/// Least time from the announcement of an epoch that is bound to a beacon to its round.
const LEAD_MS: i64 = 60_000;

/// Parses an opening time into milliseconds since 1970.
fn opening_ms(text: &str) -> Result<i64, &'static str> {
    milliseconds(text).or_else(|| day_ms(text)).ok_or(NO_TIME)
}

/// Parses a closing time into milliseconds since 1970.
fn closing_ms(text: &str) -> Result<i64, &'static str> {
    milliseconds(text).or_else(|| Some(day_ms(text)? + DAY_MS)).ok_or(NO_TIME)
}

const NO_TIME: &str = "expected an RFC 3339 time, such as 2026-12-01T00:00:00Z, or a date, such as 2026-12-01";

/// Runs `epochs`.
///
/// # Errors
/// Returns an error if the arguments are invalid, or a file or the database cannot be read or written.
pub fn run(args: &EpochsArgs) -> anyhow::Result<ExitCode> {
    block_on(async {
        let store = args.database.open().await?;
        match &args.command {
            EpochsCommand::Create(new) => create(&store, new).await?,
            EpochsCommand::List => list(&store).await?,
            EpochsCommand::Close { name, reason } => {
                if reason.trim().is_empty() {
                    bail!("--reason: must not be empty; it is published");
                }
                if store.epoch(name).await?.is_none() {
                    bail!("there is no epoch {name:?}");
                }
                if !store.close_epoch(name, reason.trim(), now_ms()).await? {
                    bail!("the epoch {name:?} is already over");
                }
                println!("closed {name}");
            }
            EpochsCommand::Beacon { name, from } => bring_round(&store, name, from).await?,
        }
        store.close().await;
        Ok(ExitCode::SUCCESS)
    })
}

/// Notes that one owner can end the epoch for everybody by spending its budget.
fn warn_of_budget(new: &CreateArgs, rules: &Rules, feedback: Feedback, per_run: u32) {
    let runs = rules.runs_per_owner.min(new.per_instance / 2).min(new.dev_entries.saturating_mul(LIMITS.entry_runs));
    let bits = f64::from(runs) * released_bits(feedback, per_run as usize);
    if bits >= f64::from(new.budget_bits) {
        say(&format!(
            "note: one owner can spend the whole budget of {} bits with its dev runs, which ends the epoch for everybody; \
             --budget-bits {:.0} would prevent that, or a smaller --owner-percent",
            new.budget_bits,
            bits.ceil() + 1.0
        ));
    }
}

async fn create(store: &Store, new: &CreateArgs) -> anyhow::Result<()> {
    let is_slug = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-';
    if new.name.is_empty() || new.name.len() > 64 || !new.name.bytes().all(is_slug) {
        bail!("{:?} is not an epoch name: expected 1 to 64 lower-case letters, digits and dashes", new.name);
    }
    let closes_at_ms = new.closes;
    if new.opens.is_some_and(|opens| opens < now_ms()) {
        bail!("--opens: must not be in the past, before anyone has seen the commitment");
    }
    if closes_at_ms <= now_ms() {
        bail!("--closes: {} is in the past", rfc3339(closes_at_ms));
    }
    if let Some(opens) = new.opens.filter(|opens| closes_at_ms <= *opens) {
        bail!("--closes: {} is not after --opens, {}", rfc3339(closes_at_ms), rfc3339(opens));
    }
    if store.epoch(&new.name).await?.is_some() {
        bail!("the epoch {:?} already exists", new.name);
    }
    let signing = signing(store, false, Others::MaySign).await?;
    if signing.signer.is_none() {
        bail!("{}", signing.notice.unwrap_or_default());
    }
    let beacon = new.opens.filter(|_| new.beacon).map(|opens| bound_to(new, opens)).transpose()?;
    let key = EpochKey::new(random_key()?);
    let strata = Generator::new()?.strata(&key, new.per_instance);
    let (pool, root) = if beacon.is_some() {
        // Draws a trial pool: a family that cannot be drawn would otherwise be noticed only after the round.
        let trial = EpochKey::new(random_key()?);
        PoolFile::draw(GENERATOR_VERSION, &trial, new.per_instance, &|| ())?;
        // Its specifications, and the held-out family among them, are known only after the round.
        (PoolFile::default(), None)
    } else {
        let total: u32 = strata.iter().map(|stratum| stratum.size).sum();
        let bar = progress::bar(total as usize, "drawing and certifying");
        let pool = PoolFile::draw(GENERATOR_VERSION, &key, new.per_instance, &|| bar.inc(1));
        bar.finish_and_clear();
        let pool = pool?;
        let root = root_of(&key, &pool.specifications);
        (pool, Some(root))
    };
    // Drawing takes time; the epoch opens once it is done, even if an earlier time was requested.
    let now = now_ms();
    let opens_at_ms = new.opens.unwrap_or(now).max(now);
    if beacon.as_ref().is_some_and(|beacon| beacon.emitted_at_ms() <= now + LEAD_MS) {
        bail!("--opens: with a beacon, at least a minute from now: official entries are registered until then");
    }
    let rules = Rules {
        instance_seconds: new.instance_seconds,
        dev_entries_per_owner: new.dev_entries,
        official_entries_per_owner: new.official_entries,
        runs_per_owner: (new.per_instance * u32::from(new.owner_percent)).div_ceil(100),
        reservation_seconds: new.reservation_seconds,
        budget_bits: new.budget_bits,
        receipt_key: signing.public_key,
        profile: Profile::Mindcraft,
        protocol: PROTOCOL,
    };
    let feedback = new.dev_feedback.into();
    warn_of_budget(new, &rules, feedback, strata.iter().map(|stratum| stratum.instances).sum());
    let siblings = if new.no_siblings { None } else { Some(Siblings::of(GENERATOR_VERSION)?.list().clone()) };
    let terms = Terms {
        epoch: new.name.clone(),
        opens_at_ms,
        closes_at_ms,
        per_instance: new.per_instance,
        dev_feedback: feedback,
        rules: rules.clone(),
        beacon,
        siblings,
    };
    let commitment = Commitment::to(&terms, &key, &strata, root);
    let secret = EpochSecret { pool_key: key.clone(), key, pool };
    if !store.create_epoch(&commitment, &EpochRules::from(&rules), &secret, now).await? {
        bail!("a key of an epoch {:?} already exists in {}", new.name, store.secrets().folder().display());
    }
    println!("{}", serde_json::to_string_pretty(&commitment)?);
    eprintln!(
        "epoch {} is announced; {} in {}. Copies of the database do not contain them: keep a \
         backup that only you can read",
        new.name,
        if commitment.beacon.is_some() { "its key is" } else { "its key and pool are" },
        store.secrets().folder().display()
    );
    if let Some(beacon) = &commitment.beacon {
        let server = if beacon.is_public() { DRAND } else { "URL" };
        eprintln!(
            "its pool is made from round {} of the beacon, due at {}: start the service with --beacon-url {server}, or bring the \
             round with `plumbline epochs beacon {} --from {server}`",
            beacon.round,
            rfc3339(beacon.emitted_at_ms()),
            new.name
        );
        if !beacon.is_public() {
            eprintln!(
                "the beacon is not quicknet: whoever does not trust its servers does not trust the pool, and its page says so"
            );
        }
    }
    Ok(())
}

/// Returns the round that the epoch is bound to: the first at or after its opening.
fn bound_to(new: &CreateArgs, opens_at_ms: i64) -> anyhow::Result<Beacon> {
    let chain = match &new.beacon_chain {
        None => Chain::quicknet(),
        Some(file) => {
            let place = || format!("--beacon-chain: {}", file.display());
            let what = || format!("{}: expected what the beacon's servers answer to /CHAIN-HASH/info", place());
            files::json(file).with_context(what)?
        }
    };
    let beacon = chain.first_round_from(opens_at_ms).map_err(|why| anyhow::anyhow!("--beacon-chain: {why}"))?;
    if beacon.emitted_at_ms() >= new.closes {
        bail!("--closes: round {} of the beacon is due at {}, later", beacon.round, rfc3339(beacon.emitted_at_ms()));
    }
    Ok(beacon)
}

/// Makes the pool of an epoch from the round in a file, or from a server.
async fn bring_round(store: &Store, name: &str, from: &str) -> anyhow::Result<()> {
    let Some(epoch) = store.epoch(name).await? else { bail!("there is no epoch {name:?}") };
    let Some(beacon) = &epoch.commitment.beacon else { bail!("the epoch {name:?} is bound to no beacon") };
    if epoch.pool.is_none() && now_ms() < beacon.emitted_at_ms() {
        bail!("round {} of the beacon is due at {}, which is not yet", beacon.round, rfc3339(beacon.emitted_at_ms()));
    }
    let elsewhere = || {
        format!(
            "cannot get the round; where there is a way out, save /{}/public/{} of a server of the beacon, and give it with --from FILE",
            beacon.chain_hash, beacon.round
        )
    };
    let round = if from.starts_with("http://") || from.starts_with("https://") {
        fetch_round(from, beacon).await.with_context(elsewhere)?
    } else {
        let what = || {
            format!(
                "--from: {from:?}: expected a round as the beacon's servers publish it, with \"round\" and \"signature\""
            )
        };
        files::json(std::path::Path::new(from)).with_context(what)?
    };
    signing(store, false, Others::MaySign).await?;
    let pool = publish_pool(store, &epoch, &round, now_ms()).await?;
    println!("{}", serde_json::to_string_pretty(&pool)?);
    Ok(())
}

async fn list(store: &Store) -> anyhow::Result<()> {
    for epoch in store.epochs().await? {
        let counts = store.epoch_counts(epoch.id(), epoch.commitment.specifications).await?;
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
            epoch.closed.as_ref().map_or_else(
                || epoch
                    .lacks_round(now_ms())
                    .map_or_else(String::new, |round| format!("  round {round} of its beacon is missing")),
                |(_, reason)| format!("  closed: {reason}")
            ),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_date_stands_for_the_whole_day() {
        assert_eq!((opening_ms("1970-01-02"), closing_ms("1970-01-02")), (Ok(DAY_MS), Ok(2 * DAY_MS)));
        assert_eq!(closing_ms("1970-01-02T00:00:00Z"), Ok(DAY_MS));
        assert!(opening_ms("soon").is_err());
    }
}

//! `plumbline verify-epoch`: verifies a reveal without the service.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::Value;

use super::evidence::{drawn_otherwise, handed_out_in, is_reveal, key};
use super::files;
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::evidence::{Fact, fact};
use plumbline_engine::hidden::feedback::Tier;
use plumbline_engine::hidden::receipts::LogPage;
use plumbline_engine::hidden::reveal::Reveal;
use plumbline_engine::hidden::verify::{Kept, verify};
use plumbline_engine::text::counted;
use plumbline_engine::voxel::BlockLog;

/// Arguments of `verify-epoch`. Each file enables more checks; the output names the checks that could not be made.
#[derive(Debug, Args)]
pub struct VerifyEpochArgs {
    /// Reveal of the epoch, from `GET /v1/epochs/NAME/reveal`.
    reveal: PathBuf,
    /// Answers of the epoch, from `GET /v1/epochs/NAME/answers`, whose logs are graded again.
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    /// Epoch as published before it opened, saved from `GET /v1/epochs/NAME`. Without it, the reveal is compared with
    /// its own copy of the commitment.
    #[arg(long, value_name = "FILE")]
    commitment: Option<PathBuf>,
    /// Pages of the public log (`GET /v1/receipts`), from the first to the last. Pages saved earlier, given beside
    /// them, show whether the log was rewritten.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    receipts: Vec<PathBuf>,
    /// Responses of the service that contain a receipt: to the registration of an entry, the draws of its runs, and the
    /// answers to its instances; or a `journal.jsonl` of `plumbline-client evaluate`, which has them all.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    given: Vec<PathBuf>,
    /// Boards as served by `GET /v1/epochs/NAME/leaderboard`, which are recomputed.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    board: Vec<PathBuf>,
    /// Additional public key to trust, in hex, besides the one that the epoch committed to; needed if the key changed.
    #[arg(long = "key", value_name = "HEX", value_parser = key)]
    keys: Vec<String>,
}

/// Reads answers, one JSON object per line with the instance and its log.
fn read_answers(path: &Path) -> anyhow::Result<BTreeMap<String, BlockLog>> {
    answers_in(&files::text(path)?, &path.display().to_string())
}

/// Reads answers, one JSON object per line with the instance and its log; `name` says where they are from.
pub(super) fn answers_in(text: &str, name: &str) -> anyhow::Result<BTreeMap<String, BlockLog>> {
    let mut logs = BTreeMap::new();
    for (number, line) in (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty()) {
        let place = || format!("{name}: line {number}");
        let answer: Value = serde_json::from_str(line).map_err(|error| {
            let what = if line.trim_start().starts_with('<') { "a page of HTML" } else { "not JSON, or not all of it" };
            anyhow::anyhow!("{}: is {what} ({error}); expected /v1/epochs/NAME/answers, line by line", place())
        })?;
        let Some(instance) = answer["instance"].as_str().map(str::to_owned) else {
            bail!("{}: is not an answer to an instance; expected /v1/epochs/NAME/answers", place());
        };
        let log = BlockLog::from_canonical_json(answer["log"].to_string().as_bytes());
        let log = log.map_err(|error| anyhow::anyhow!("{}: {error}", place()))?;
        if logs.insert(instance, log).is_some() {
            bail!("{}: the instance occurs twice", place());
        }
    }
    Ok(logs)
}

/// Takes the commitment, and the pool if it has one, from an epoch as it was published, or from a commitment alone.
///
/// # Errors
/// Returns an error if it is something else, such as the reveal, whose own copy proves nothing.
pub(super) fn take_epoch(kept: &mut Kept, epoch: Value) -> anyhow::Result<()> {
    if is_reveal(&epoch) {
        bail!("this is the reveal; expected GET /v1/epochs/NAME, saved before the epoch closed");
    }
    let pool = epoch.get("pool").filter(|pool| !pool.is_null()).cloned();
    kept.pool = pool.map(serde_json::from_value).transpose()?;
    let commitment: Commitment = serde_json::from_value(epoch.get("commitment").cloned().unwrap_or(epoch))?;
    kept.commitment = Some(commitment);
    Ok(())
}

/// Takes the commitment from a copy of the epoch that the verifier saved. One that was saved after the end promises
/// nothing, and is left out with a remark.
///
/// # Errors
/// Returns an error if the file cannot be read, or is of another epoch than the reveal.
pub(super) fn take_commitment(kept: &mut Kept, path: &Path, reveal: &Reveal) -> anyhow::Result<()> {
    let place = || path.display().to_string();
    let epoch: Value = files::json(path)?;
    let is_late = epoch["state"] == "closed";
    take_epoch(kept, epoch).with_context(place)?;
    let (own, wanted) = (kept.commitment.as_ref().map(|own| own.epoch.clone()), &reveal.commitment.epoch);
    if let Some(own) = own.filter(|own| own != wanted) {
        bail!("{}: is of the epoch {own:?}, and the reveal of {wanted:?}", place());
    }
    if is_late {
        println!("NOT CHECKED  {}: was saved after the epoch had closed, so it promised nothing", place());
        kept.commitment = None;
    }
    Ok(())
}

/// Reads what the verifier kept, and returns it with the draws among it whose receipts state something else than they.
fn read_kept(args: &VerifyEpochArgs, reveal: &Reveal) -> anyhow::Result<(Kept, Vec<String>)> {
    let mut kept = Kept { keys: args.keys.clone(), ..Kept::default() };
    if let Some(path) = &args.commitment {
        take_commitment(&mut kept, path, reveal)?;
    }
    if let Some(path) = &args.answers {
        let answers = read_answers(path)?;
        // No answers at all is what a service that withholds them would send, and a breach.
        if !answers.is_empty() && reveal.instances.iter().all(|own| !answers.contains_key(&own.id)) {
            let (place, epoch) = (path.display(), &reveal.commitment.epoch);
            bail!(
                "{place}: its answers are to no instance of the epoch {epoch:?}: expected /v1/epochs/{epoch}/answers"
            );
        }
        kept.logs = Some(answers);
    }
    for path in &args.receipts {
        for value in files::values(path)? {
            if is_reveal(&value) {
                bail!("{}: is a reveal; expected pages of GET /v1/receipts", path.display());
            }
            let page: LogPage = serde_json::from_value(value).with_context(|| path.display().to_string())?;
            kept.log.extend(page.receipts);
            kept.heads.extend(page.head);
        }
    }
    if !args.receipts.is_empty() && kept.log.is_empty() && kept.heads.is_empty() {
        bail!("--receipts: these pages hold no receipt and no head; expected the pages of GET /v1/receipts");
    }
    let asked_otherwise = take_given(&mut kept, &args.given, reveal)?;
    for path in &args.board {
        kept.boards.push(read_board(path, &reveal.commitment.epoch)?);
    }
    Ok((kept, asked_otherwise))
}

/// Takes the receipts from files of responses that the verifier kept, or of journals with such responses. Returns what is
/// wrong with draws among them whose receipts state something else than they.
///
/// # Errors
/// Returns an error if a file cannot be read, or holds no receipt that was handed out.
pub(super) fn take_given(kept: &mut Kept, paths: &[PathBuf], reveal: &Reveal) -> anyhow::Result<Vec<String>> {
    let mut asked_otherwise = Vec::new();
    for path in paths {
        let before = kept.given.len();
        for value in files::values(path)? {
            if is_reveal(&value) || value["receipts"].is_array() {
                bail!("{}: is what the service publishes, not what it handed to an entrant", path.display());
            }
            for (response, given) in handed_out_in(&value) {
                let is_own = given.receipt["epoch"] == reveal.commitment.epoch.as_str();
                if let (true, Some(Fact::Draw(draw)), true) =
                    (is_own, fact(&given.receipt), response["instances"].is_array())
                {
                    let why = drawn_otherwise(response, &draw, &reveal.commitment);
                    asked_otherwise.extend(why.map(|why| format!("receipt in {}: {why}", path.display())));
                }
                kept.given.push(given);
            }
        }
        if kept.given.len() == before {
            bail!("{} holds no receipt", path.display());
        }
    }
    Ok(asked_otherwise)
}

/// Reads a board of the epoch.
///
/// # Errors
/// Returns an error if the file cannot be read, is something else, or is of another epoch.
fn read_board(path: &Path, epoch: &str) -> anyhow::Result<Value> {
    let board: Value = files::json(path)?;
    let (file, expected) = (path.display(), format!("expected GET /v1/epochs/{epoch}/leaderboard"));
    let is_tier = Tier::ALL.iter().any(|tier| board["tier"] == tier.name());
    if !is_tier || !board["rows"].is_array() || !board["is_released"].is_boolean() || !board["epoch"].is_string() {
        bail!("{file}: is no board of an epoch; {expected}");
    }
    if board["epoch"] != epoch {
        bail!("{file}: is of the epoch {}, and the reveal of {epoch:?}; {expected}", board["epoch"]);
    }
    if let Some(filter) = board["provenance"].as_str() {
        bail!("{file}: has the rows of provenance {filter:?} alone; {expected} without `provenance`");
    }
    Ok(board)
}

/// Runs `verify-epoch`, with exit code 1 if anything does not match.
///
/// # Errors
/// Returns an error if a file cannot be read or parsed.
pub fn run(args: &VerifyEpochArgs) -> anyhow::Result<ExitCode> {
    let place = || format!("{}: expected the response to GET /v1/epochs/NAME/reveal", args.reveal.display());
    let reveal: Reveal = serde_json::from_value(files::json(&args.reveal)?).with_context(place)?;
    let (kept, asked_otherwise) = read_kept(args, &reveal)?;
    let is_good = verified(&reveal, &kept)?;
    for why in &asked_otherwise {
        println!("BROKEN  {why}");
    }
    Ok(if is_good && asked_otherwise.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Verifies a reveal, and prints what was found. Returns whether nothing is broken.
///
/// # Errors
/// Returns an error if this program lacks a version that the epoch was made with, or if its own families are faulty.
pub(super) fn verified(reveal: &Reveal, kept: &Kept) -> anyhow::Result<bool> {
    let found = verify(reveal, kept)?;
    if let Some(why) = found.unverifiable {
        for breach in &found.breaches {
            println!("BROKEN  {breach}");
        }
        if found.breaches.is_empty() {
            bail!("{why}");
        }
        println!("NOT CHECKED  {why}");
        return Ok(false);
    }
    let graded = reveal.instances.iter().filter(|instance| instance.log_sha256.is_some()).count();
    println!(
        "epoch {}: {} of {} specifications, {} of {} draws and {} of {graded} grades recomputed and identical",
        reveal.commitment.epoch,
        found.specifications,
        reveal.commitment.specifications,
        found.draws,
        reveal.instances.len(),
        found.grades
    );
    let (receipts, boards) = (counted(found.receipts, "receipt"), counted(found.boards, "board"));
    println!("{receipts} agree with the reveal; {boards} recomputed and identical");
    if found.ungraded > 0 {
        let answers = counted(found.ungraded, "answer");
        println!("{answers} without a grade because the service failed; they count as failed");
    }
    if kept.commitment.is_none() {
        println!("NOT CHECKED  commitment: no copy saved before the epoch opened was given; the reveal's own was used");
    }
    if kept.boards.is_empty() {
        println!("NOT CHECKED  boards: none that was fetched from the service was given (--board)");
    }
    if kept.given.is_empty() {
        println!("NOT CHECKED  receipts that were handed out: none was given (--given)");
    }
    for remark in &found.remarks {
        println!("NOTE  {remark}");
    }
    for what in &found.unchecked {
        println!("NOT CHECKED  {what}");
    }
    for breach in &found.breaches {
        println!("BROKEN  {breach}");
    }
    Ok(found.breaches.is_empty())
}

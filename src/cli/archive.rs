//! `plumbline archive-epoch` and `verify-archive`: everything that an epoch published as one file, which anybody may keep and verify
//! after the service is gone.

use std::fs::File;
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use serde_json::error::Category;

use super::archived_log::{self, ArchivedLog, Demands};
use super::epoch_page;
use super::evidence::key;
use super::files;
use super::process::block_on;
use super::verify_epoch::{answers_in, take_commitment, take_epoch, take_given, verified};
use super::witness::{folder_of, witness_key};
use crate::client::Service;
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::feedback::Tier;
use plumbline_engine::hidden::receipts::LogPage;
use plumbline_engine::hidden::reveal::Reveal;
use plumbline_engine::hidden::tlog::cosignature::Witness;
use plumbline_engine::hidden::tlog::note::read_verifier_key;
use plumbline_engine::hidden::tlog::tree::{Tree, leaf};
use plumbline_engine::hidden::verify::Kept;
use plumbline_engine::text::agreeing;

/// Receipts on a page of the log.
const PAGE: usize = 1_000;
/// Version of the format.
const FORMAT: u32 = 1;

/// Arguments of `archive-epoch`.
#[derive(Debug, Args)]
pub struct ArchiveArgs {
    /// Address of the service, such as `https://bench.example`.
    url: String,
    /// Name of the epoch, which must be over.
    epoch: String,
    /// File to write: compressed JSON.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Arguments of `verify-archive`.
#[derive(Debug, Args)]
pub struct VerifyArchiveArgs {
    /// Archive that `archive-epoch` wrote.
    archive: PathBuf,
    /// Epoch as published before it opened, saved from `GET /v1/epochs/NAME`. Without it, the archive is compared with
    /// its own copy of the commitment.
    #[arg(long, value_name = "FILE")]
    commitment: Option<PathBuf>,
    /// Responses of the service that contain a receipt, or journals with such responses, as `verify-epoch` takes them.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    given: Vec<PathBuf>,
    /// Key of a witness that you trust, as `plumbline witness --name` prints it: the archive must have its cosignature.
    #[arg(long = "witness", value_name = "KEY", value_parser = witness_key)]
    witnesses: Vec<Witness>,
    /// Additional public key to trust, in hex, besides the one that the epoch committed to; needed if the key changed.
    #[arg(long = "key", value_name = "HEX", value_parser = key)]
    keys: Vec<String>,
}

/// Everything that an epoch published.
#[derive(Debug, Serialize, Deserialize)]
struct Archive {
    /// Version of the format.
    #[serde(rename = "plumbline_archive")]
    format: u32,
    /// `GET /v1/epochs/NAME`.
    epoch: Value,
    /// `GET /v1/epochs/NAME/reveal`.
    reveal: Value,
    /// `GET /v1/epochs/NAME/answers`, line by line.
    answers: Vec<Value>,
    /// `GET /v1/receipts`, all pages.
    log: Vec<LogPage>,
    /// `GET /v1/epochs/NAME/leaderboard` of both tiers.
    boards: Vec<Value>,
    /// `GET /log/key`, with which other tools verify the checkpoints.
    log_key: String,
    /// `GET /log/checkpoint`, from before the pages were read.
    checkpoint: String,
    /// `GET /log/witnesses`: checkpoints that witnesses have cosigned, from before the pages were read.
    witnesses: Value,
}

/// Runs `archive-epoch`.
///
/// # Errors
/// Returns an error if the service cannot be reached, the epoch is not over, or the file cannot be written.
pub fn run(args: &ArchiveArgs) -> anyhow::Result<ExitCode> {
    let archive = block_on(download(&Service::at(&args.url, None)?, &args.epoch))?;
    if args.out.exists() {
        bail!("--out: {} already exists", args.out.display());
    }
    let place = || format!("--out: cannot write {}", args.out.display());
    let file = File::create_new(&args.out).with_context(place)?;
    let mut packed = GzEncoder::new(file, Compression::default());
    serde_json::to_writer(&mut packed, &archive).with_context(place)?;
    packed.finish().with_context(place)?.sync_all().with_context(place)?;
    File::open(folder_of(&args.out))?.sync_all()?;
    println!("{}", args.out.display());
    tell_of_witnesses(&archive);
    Ok(ExitCode::SUCCESS)
}

/// Says which witnesses have not cosigned all of the epoch.
fn tell_of_witnesses(archive: &Archive) {
    let needed = needed_of(archive);
    let witnesses = archive.witnesses["witnesses"].as_array().map(Vec::as_slice).unwrap_or_default();
    if witnesses.is_empty() {
        println!(
            "NOTE    no witness has cosigned the log, so only the operator vouches for it: somebody else may run `plumbline \
             witness`, and the operator adds its key (`serve --witness`)"
        );
    }
    for witness in witnesses {
        let name = witness["name"].as_str().unwrap_or("a witness");
        let then = "run the witness once more, and archive again";
        match witness["size"].as_u64() {
            None => println!("NOTE    {name}: has cosigned nothing yet; {then}"),
            Some(size) if size < needed => {
                println!(
                    "NOTE    {name}: has cosigned {}, and the epoch needs {needed}; {then}",
                    agreeing(size, "entry of the log", "entries of the log")
                );
            }
            Some(_) => {}
        }
    }
}

/// Returns the position of the last receipt of an archive's epoch.
fn needed_of(archive: &Archive) -> u64 {
    let receipts = archive.reveal["receipts"].as_array().map(Vec::as_slice).unwrap_or_default();
    receipts.iter().filter_map(|receipt| receipt["seq"].as_u64()).max().unwrap_or(0)
}

async fn download(service: &Service, name: &str) -> anyhow::Result<Archive> {
    let text = async |path: &str| -> anyhow::Result<String> { Ok(String::from_utf8(service.get_bytes(path).await?)?) };
    let of_epoch = format!("/v1/epochs/{name}");
    let reveal = service.get(&format!("{of_epoch}/reveal")).await?;
    let answers = text(&format!("{of_epoch}/answers")).await?;
    let answers: Result<Vec<Value>, _> = answers.lines().map(serde_json::from_str).collect();
    let checkpoint = text("/log/checkpoint").await?;
    let witnesses = service.get("/log/witnesses").await?;
    let mut log: Vec<LogPage> = Vec::new();
    let mut after = Some(0);
    while let Some(last) = after {
        let page: LogPage =
            serde_json::from_value(service.get(&format!("/v1/receipts?after={last}&limit={PAGE}")).await?)?;
        after = page.next_after;
        log.push(page);
    }
    let mut boards = Vec::new();
    for tier in Tier::ALL.map(Tier::name) {
        boards.push(service.get(&format!("{of_epoch}/leaderboard?tier={tier}")).await?);
    }
    Ok(Archive {
        format: FORMAT,
        epoch: service.get(&of_epoch).await?,
        reveal,
        answers: answers?,
        log,
        boards,
        log_key: text("/log/key").await?,
        checkpoint,
        witnesses,
    })
}

/// Runs `verify-archive`, with exit code 1 if anything does not match.
///
/// # Errors
/// Returns an error if a file cannot be read or is something else.
pub fn verify(args: &VerifyArchiveArgs) -> anyhow::Result<ExitCode> {
    let place = || format!("{}: is no archive of an epoch", args.archive.display());
    let archive = read(&args.archive).with_context(place)?;
    let reveal: Reveal = serde_json::from_value(archive.reveal.clone()).with_context(place)?;
    let answers: Vec<String> = archive.answers.iter().map(Value::to_string).collect();
    let mut kept = Kept {
        logs: Some(answers_in(&answers.join("\n"), "answers")?),
        heads: archive.log.iter().filter_map(|page| page.head.clone()).collect(),
        boards: archive.boards.clone(),
        // `archive-epoch` fetches them last.
        boards_follow_reveal: true,
        keys: args.keys.clone(),
        ..Kept::default()
    };
    take_epoch(&mut kept, archive.epoch.clone()).with_context(place)?;
    // The archive's own copy of the commitment proves no more than the reveal's.
    kept.commitment = None;
    if let Some(path) = &args.commitment {
        let pool = kept.pool.take();
        take_commitment(&mut kept, path, &reveal)?;
        kept.pool = kept.pool.or(pool);
    }
    let has_board = |tier: &str| archive.boards.iter().any(|board| board["tier"] == tier);
    let missing: Vec<&str> = Tier::ALL.map(Tier::name).into_iter().filter(|tier| !has_board(tier)).collect();
    let (tree, name) = (tree_of(&archive)?, archived_log::name_of(&archive.log));
    kept.log = archive.log.into_iter().flat_map(|page| page.receipts).collect();
    // Pages are read one after the other: each has the end of the log as it was then.
    let last = kept.log.last().map_or(0, |last| last.seq);
    kept.heads.retain(|head| head.size == last);
    let asked_otherwise = take_given(&mut kept, &args.given, &reveal)?;
    let mut is_good = verified(&reveal, &kept)? && asked_otherwise.is_empty();
    for why in asked_otherwise {
        println!("BROKEN  {why}");
    }
    for difference in epoch_page::differences(&archive.epoch, &archive.reveal, &reveal, &kept.log) {
        println!("BROKEN  epoch page: {difference}");
        is_good = false;
    }
    if kept.log.is_empty() {
        println!("BROKEN  log: the archive has no receipt of the public log");
        is_good = false;
    }
    let committed = reveal.commitment.rules.as_ref().map(|rules| rules.receipt_key.as_str());
    let trusted: Vec<&str> = kept.keys.iter().map(String::as_str).chain(committed).collect();
    // A witness vouches for the epoch only if it has seen the log with all of its receipts.
    let size = reveal.receipts.iter().flatten().map(|file| file.seq.unsigned_abs()).max().unwrap_or(0);
    let demands = Demands { size, keys: &trusted, witnesses: &args.witnesses };
    let (key, checkpoint, witnesses) = (&archive.log_key, &archive.checkpoint, &archive.witnesses);
    is_good &= archived_log::holds(&ArchivedLog { key, checkpoint, witnesses, tree, name }, &demands);
    for tier in missing {
        println!("NOT CHECKED  the {tier} board: it is not in the archive");
    }
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Unpacks the bytes of an archive, whose checksum shows damage.
fn unpacked(packed: &[u8]) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    match GzDecoder::new(packed).read_to_end(&mut bytes) {
        Ok(_) => Ok(bytes),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => {
            bail!("it ends in the middle: copy or download it again")
        }
        Err(_) => bail!("its compressed bytes are damaged: copy or download it again"),
    }
}

fn read(path: &Path) -> anyhow::Result<Archive> {
    let bytes = std::fs::read(path)?;
    // A browser or a proxy may have unpacked it.
    let bytes = if bytes.starts_with(&[0x1f, 0x8b]) { unpacked(&bytes)? } else { bytes };
    let text = files::decoded(bytes).context("it is not text in UTF-8")?;
    let archive: Archive = match text.trim_start().chars().next() {
        None => bail!("the file is empty"),
        Some('<') => bail!("it holds a page of HTML"),
        Some(_) => serde_json::from_str(&text).map_err(|error| match error.classify() {
            Category::Eof => anyhow::anyhow!("it ends in the middle: copy or download it again"),
            _ => anyhow::Error::new(error),
        })?,
    };
    if archive.format != FORMAT {
        bail!("it has format {}, this program reads format {FORMAT}", archive.format);
    }
    if read_verifier_key(&archive.log_key).is_none() {
        bail!("its log_key is no key of a log");
    }
    Ok(archive)
}

/// Builds the tree of the transparency log from the pages.
fn tree_of(archive: &Archive) -> anyhow::Result<Tree> {
    let mut tree = Tree::default();
    for receipt in archive.log.iter().flat_map(|page| &page.receipts) {
        let hash = unhex::<32>(&receipt.hash).with_context(|| format!("receipt {}: its hash is none", receipt.seq))?;
        tree.push(leaf(&hash));
    }
    Ok(tree)
}

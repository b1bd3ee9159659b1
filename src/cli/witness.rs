//! `plumbline witness`: follows the transparency log of a service, checks that it only grows, and cosigns its checkpoints.

use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde::{Deserialize, Serialize};

use super::process::block_on;
use crate::client::Service;
use crate::clock::now_ms;
use crate::store::secrets::Secrets;
use plumbline_engine::hidden::canonical::Hash;
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::hidden::tlog::cosignature::{Witness, cosignature, witness_key as key_of};
use plumbline_engine::hidden::tlog::frontier::Frontier;
use plumbline_engine::hidden::tlog::note::{Checkpoint, read_verifier_key};
use plumbline_engine::hidden::tlog::tiles::{TILE, TileName, read_entries};
use plumbline_engine::hidden::tlog::tree::leaf;
use plumbline_engine::text::agreeing;

/// Arguments of `witness`.
#[derive(Debug, Args)]
pub struct WitnessArgs {
    /// Address of the service, such as `https://bench.example`.
    url: String,
    /// File in which the witness keeps what it has seen. It is made the first time.
    #[arg(long, value_name = "FILE")]
    state: PathBuf,
    /// Key of the log, from `/log/key`: get it from somebody you trust. Needed the first time.
    #[arg(long, value_name = "KEY")]
    log_key: Option<String>,
    /// Key that the log is signed with now, if its operator has told you that the key was replaced. What the witness saw
    /// under the key before must still be there.
    #[arg(long, value_name = "KEY", conflicts_with = "log_key")]
    new_log_key: Option<String>,
    /// Name of the witness, such as `example.org/witness`, to cosign under. Its key is FILE.key, made the first time.
    #[arg(long, value_name = "NAME", value_parser = witness_name)]
    name: Option<String>,
    /// Send the cosignature to the service too, which shows it if its operator knows the key of the witness.
    #[arg(long, requires = "name")]
    publish: bool,
}

/// Parses the name of a witness: it is part of a line, before a space, and of a key, before a plus.
fn witness_name(text: &str) -> Result<String, &'static str> {
    let is_name = !text.is_empty() && !text.contains(|c: char| c.is_whitespace() || c.is_control() || c == '+');
    is_name.then(|| text.to_owned()).ok_or("expected a name without spaces and plus signs, such as example.org/witness")
}

/// What a witness has seen of a log.
#[derive(Debug, Serialize, Deserialize)]
struct Seen {
    log_key: String,
    frontier: Frontier,
    /// The last checkpoint, as it was signed.
    note: Option<String>,
    /// The last checkpoints under keys that were replaced, which stay evidence.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    replaced: Vec<Replaced>,
}

/// A key that the log was signed with before.
#[derive(Debug, Serialize, Deserialize)]
struct Replaced {
    log_key: String,
    note: String,
}

/// Runs the command, with exit code 1 if the log is not what it was.
///
/// # Errors
/// Returns an error if the service cannot be reached or answers something else, or a file cannot be read or written.
pub fn run(args: &WitnessArgs) -> anyhow::Result<ExitCode> {
    block_on(follow(args))
}

async fn follow(args: &WitnessArgs) -> anyhow::Result<ExitCode> {
    let _alone = alone(&args.state)?;
    let mut seen = remembered(args)?;
    let (origin, seen_key) = log_key("--log-key", &seen.log_key)?;
    let key = match &args.new_log_key {
        Some(new) => {
            let (name, key) = log_key("--new-log-key", new)?;
            if name != origin {
                bail!("--new-log-key: is the key of {name}, and {} follows {origin}", args.state.display());
            }
            key
        }
        None => seen_key.clone(),
    };
    let service = Service::at(&args.url, None)?;
    let note = String::from_utf8(service.get_bytes("/log/checkpoint").await?).context("the checkpoint is not text")?;
    if Checkpoint::parts(&note).and_then(|(text, _)| Checkpoint::read(&text)).is_none() {
        let begin: String = note.chars().take(60).collect();
        bail!(
            "{}: /log/checkpoint is no checkpoint, but begins with {begin:?}: is something between you and the service?",
            args.url
        );
    }
    let Some(checkpoint) = Checkpoint::verified(&note, &[&key]).filter(|checkpoint| checkpoint.origin == origin) else {
        println!(
            "BROKEN  the checkpoint is not signed with the key of {origin}; {}\n{note}",
            unsigned_why(&seen, &note, args)
        );
        return Ok(ExitCode::FAILURE);
    };
    let before = seen.frontier.size();
    if before > 0 || seen.note.is_some() {
        // Only a state that its own signed note proves can accuse the service.
        let own = seen.note.as_deref().and_then(|note| Checkpoint::verified(note, &[&seen_key]));
        if own.is_none_or(|own| own.size != before || own.root != seen.frontier.root()) {
            bail!(
                "--state: {} is damaged: what it keeps of the log is not what its signed checkpoint says; put a copy of it back",
                args.state.display()
            );
        }
    }
    if checkpoint.size < before {
        return Ok(other_history(&seen, &note, "it is shorter than the one seen before"));
    }
    let mut grown = seen.frontier.clone();
    while grown.size() < checkpoint.size {
        for entry in entries(&service, grown.size(), checkpoint.size).await? {
            grown.push(leaf(&entry));
        }
    }
    if grown.root() != checkpoint.root {
        if before == 0 {
            println!(
                "BROKEN  the entries in /log/tile are not those that the checkpoint is signed for: the tiles or the checkpoint are of \
                 another log\n{note}"
            );
            return Ok(ExitCode::FAILURE);
        }
        return Ok(other_history(&seen, &note, "its entries do not follow those seen before"));
    }
    let size = agreeing(checkpoint.size, "entry", "entries");
    match &seen.note {
        None => eprintln!("{origin}: {size}, seen for the first time"),
        Some(_) => {
            eprintln!("{origin}: {size}, {} of them new; the earlier ones are as they were", checkpoint.size - before);
        }
    }
    if let Some(new) = &args.new_log_key
        && new.trim() != seen.log_key
    {
        let before = std::mem::replace(&mut seen.log_key, new.trim().to_owned());
        seen.replaced.extend(seen.note.take().map(|note| Replaced { log_key: before, note }));
        eprintln!("the log is followed under its new key from now on");
    }
    (seen.frontier, seen.note) = (grown, Some(note.clone()));
    keep(&args.state, &seen)?;
    print!("{note}");
    if let Some(name) = &args.name {
        let signer = own_key(&args.state)?;
        eprintln!("cosigned as {}", key_of(name, &signer));
        let at_s = u64::try_from(now_ms() / 1_000).context("the clock is before 1970")?;
        let line = cosignature(name, &signer, &checkpoint, at_s);
        print!("{line}");
        if args.publish {
            service.post_text("/log/cosignatures", note + &line).await?;
            eprintln!("the service has the cosignature");
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Parses the key of a log; returns its name and the key in hexadecimal.
fn log_key(option: &str, text: &str) -> anyhow::Result<(String, String)> {
    read_verifier_key(text)
        .with_context(|| format!("{option}: expected the key of a log as /log/key shows it: name+id+key"))
}

/// Says what may be the cause of a checkpoint without the signature of the known key.
fn unsigned_why(seen: &Seen, note: &str, args: &WitnessArgs) -> &'static str {
    if args.new_log_key.is_some() {
        return "does --new-log-key come from /log/key of this service?";
    }
    let known = seen.note.as_deref().and_then(|note| note.lines().next());
    if known.is_some() && known == note.lines().next() {
        "its operator may have replaced the key. Ask: a change of the key is told in /v1/receipts. If it is so, \
         follow the log with --new-log-key, and the key that they give you. Until then this is no log to trust"
    } else {
        "does --log-key come from /log/key of this service?"
    }
}

/// Waits for other commands that use the same state: of two at once, each could cosign a history of its own.
fn alone(state: &Path) -> anyhow::Result<File> {
    let mut name = state.as_os_str().to_owned();
    name.push(".lock");
    let place = || format!("--state: cannot lock {}", Path::new(&name).display());
    let file = File::create(&name).with_context(place)?;
    file.lock().with_context(place)?;
    Ok(file)
}

/// Reads what was seen before; nothing the first time.
fn remembered(args: &WitnessArgs) -> anyhow::Result<Seen> {
    let place = || args.state.display().to_string();
    let seen: Seen = match std::fs::read(&args.state) {
        Ok(text) => serde_json::from_slice(&text)
            .with_context(|| format!("--state: {} is not what `plumbline witness` writes", args.state.display()))?,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let needed = "--log-key: needed the first time, when nothing was seen yet";
            let log_key = args.log_key.clone().context(needed)?;
            Seen { log_key: log_key.trim().to_owned(), frontier: Frontier::default(), note: None, replaced: Vec::new() }
        }
        Err(error) => return Err(error).with_context(place),
    };
    if args.log_key.as_ref().is_some_and(|key| key.trim() != seen.log_key) {
        bail!(
            "--log-key: {} follows the log with the key {}. If its operator replaced that key, give the new one as \
             --new-log-key; for another log, name another file",
            args.state.display(),
            seen.log_key
        );
    }
    Ok(seen)
}

/// Writes what was seen so that a crash leaves the old file or the new one.
fn keep(state: &Path, seen: &Seen) -> anyhow::Result<()> {
    let mut name = state.as_os_str().to_owned();
    name.push(".new");
    let fresh = PathBuf::from(name);
    let place = || format!("--state: cannot write {}", fresh.display());
    let mut file = File::create(&fresh).with_context(place)?;
    serde_json::to_writer_pretty(&mut file, seen)?;
    file.sync_all().with_context(place)?;
    std::fs::rename(&fresh, state).with_context(|| state.display().to_string())?;
    Ok(File::open(folder_of(state))?.sync_all()?)
}

/// Downloads the entries from a position on, up to the end of their tile or of the log.
async fn entries(service: &Service, from: u64, size: u64) -> anyhow::Result<Vec<Hash>> {
    const FULL: u64 = TILE as u64;
    let index = from / FULL;
    let width = (size - index * FULL).min(FULL) as usize;
    let path = format!("/log/tile/{}", TileName { level: None, index, width });
    let bytes = service.get_bytes(&path).await?;
    let mut entries = read_entries(&bytes, width).with_context(|| {
        format!("{path}: expected {width} entries of 32 bytes, found something else, {} bytes long", bytes.len())
    })?;
    entries.drain(..(from % FULL) as usize);
    Ok(entries)
}

/// Shows both checkpoints: signed with keys of one log, they prove that the service has shown two histories.
fn other_history(seen: &Seen, note: &str, why: &str) -> ExitCode {
    println!("BROKEN  the service shows another history: {why}.");
    println!("Seen before:\n{}\nNow:\n{note}", seen.note.as_deref().unwrap_or("nothing"));
    eprintln!(
        "Keep the file of --state and both checkpoints: they are the evidence. If the operator can explain it, as after a \
         backup that was restored, follow the new history with another file (and tell whoever trusts this witness)"
    );
    ExitCode::FAILURE
}

/// Loads the key of the witness; makes it the first time.
fn own_key(state: &Path) -> anyhow::Result<Signer> {
    let mut name = state.file_name().context("--state: expected the name of a file")?.to_owned();
    name.push(".key");
    let name = name.to_str().context("--state: expected a name in UTF-8")?;
    Ok(Secrets::in_folder(folder_of(state).to_owned()).signer_named(name)?)
}

/// Returns the folder of a file.
pub(super) fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Parses the key of a witness.
pub(super) fn witness_key(text: &str) -> Result<Witness, &'static str> {
    Witness::read(text).ok_or("expected the key of a witness as `plumbline witness --name` prints it: name+id+key")
}

//! `plumbline verify-receipt`: verifies receipts and the log that chains them, without the service.

use std::fmt::Display;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use clap::Args;
use sha2::{Digest as _, Sha256};

use super::evidence::key;
use super::given_receipts::{Given, Verdict};
use plumbline_engine::hidden::canonical::canonical_json;
use plumbline_engine::hidden::receipts::{
    ReceiptFault, ReceiptFile, gaps, of_other_keys, verify, verify_chain, verify_keys,
};
use plumbline_engine::hidden::tlog::note::Checkpoint;
use plumbline_engine::tasks::hex;
use plumbline_engine::text::{agreeing, counted};

/// Arguments of `verify-receipt`.
#[derive(Debug, Args)]
pub struct VerifyReceiptArgs {
    /// Files of receipts (`GET /v1/submissions/ID/receipt`), of pages of the log (`GET /v1/receipts`), or of responses with a
    /// receipt, such as a journal of `plumbline-client evaluate`.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Public key to trust, in hex: `public_key` in `/.well-known/plumbline-receipts.json`. If the key changed, give
    /// every key.
    #[arg(long = "key", required = true, value_name = "HEX", value_parser = key)]
    keys: Vec<String>,
    /// Accept pages that do not reach the signed end of the log, and receipts whose position in it is not signed.
    /// Receipts that were cut off or moved are then not detected. Pages must still follow one another without gaps.
    #[arg(long)]
    part: bool,
}

/// Faults and notes, printed as they are found.
#[derive(Default)]
struct Findings {
    is_broken: bool,
}

impl Findings {
    fn broken(&mut self, why: impl Display) {
        self.is_broken = true;
        println!("BROKEN  {why}");
    }

    fn add(&mut self, verdict: Verdict, why: impl Display) {
        self.is_broken |= verdict == Verdict::Broken;
        println!("{} {why}", verdict.label());
    }
}

/// Runs the command, with exit code 1 if a receipt or the chain does not verify.
///
/// # Errors
/// Returns an error if a file cannot be read or parsed, or the files hold no receipts.
pub fn run(args: &VerifyReceiptArgs) -> anyhow::Result<ExitCode> {
    let mut given = Given::default();
    for file in &args.files {
        given.read(file)?;
    }
    // Files may come in any order, and a page twice: of equal receipts, one with its body is kept for the chain, but
    // every copy is verified.
    given.log.sort_by_key(|receipt| (receipt.seq, receipt.receipt.is_none()));
    let mut copies = given.log.clone();
    copies.dedup();
    given.log.dedup_by(|one, other| (one.seq, &one.hash, &one.link) == (other.seq, &other.hash, &other.link));
    let all: Vec<&ReceiptFile> = given.alone.iter().chain(&copies).collect();
    if all.is_empty() && given.heads.is_empty() && given.handed.is_empty() {
        bail!("no receipts in these files: expected receipts, pages of the log, or responses with a receipt");
    }
    let trusted: Vec<&str> = args.keys.iter().map(String::as_str).collect();
    let mut found = Findings::default();
    signatures(&all, &trusted, &mut found);
    places_in_log(&given, &trusted, &mut found);
    let is_linked = chains(&given, &mut found);
    if !args.part {
        for fault in given.places(&trusted) {
            let or = if fault == ReceiptFault::NoBeginning { ", or use --part" } else { "" };
            found.broken(format!("end of the log: {fault}{or}"));
        }
    }
    changes_of_key(&given.log, &all, &mut found);
    println!("{}", summary(&given, is_linked));
    Ok(if found.is_broken { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Verifies the hash and the signature of each receipt.
fn signatures(all: &[&ReceiptFile], trusted: &[&str], found: &mut Findings) {
    for others in of_other_keys(all.iter().copied(), trusted) {
        found.broken(others);
    }
    for receipt in all {
        match verify(receipt, trusted) {
            Ok(()) | Err(ReceiptFault::Withheld | ReceiptFault::OtherKey { .. }) => {}
            Err(fault) => found.broken(format!("receipt {}: {fault}", receipt.seq)),
        }
    }
}

/// Looks up each receipt beside the pages, by its proof or in the pages.
fn places_in_log(given: &Given, trusted: &[&str], found: &mut Findings) {
    for handed in &given.handed {
        let hash = hex(&Sha256::digest(canonical_json(&handed.receipt)));
        let (verdict, told) = given.handed_out(handed, &hash, trusted);
        found.add(verdict, format!("receipt {}…: {told}", &hash[..12]));
    }
    for alone in &given.alone {
        let place = format!("receipt {}", alone.seq);
        if alone.inclusion.is_none() {
            let (verdict, told) = given.without_inclusion(alone);
            found.add(verdict, format!("{place}: {told}"));
            continue;
        }
        match alone.verify_inclusion(trusted) {
            Ok(Checkpoint { origin, size, .. }) => {
                let entries = agreeing(size, "entry", "entries");
                found.add(Verdict::Note, format!("{place}: is in the log {origin} of {entries}"));
            }
            Err(fault) => found.broken(format!("{place}: {fault}")),
        }
    }
}

/// Verifies the links between receipts: pages of the log form one chain without gaps. Returns whether all are linked.
fn chains(given: &Given, found: &mut Findings) -> bool {
    let mut is_linked = true;
    let alone = given.alone.iter().map(|single| vec![single]);
    for chain in alone.chain([given.log.iter().collect()]) {
        let Err(fault) = verify_chain(chain.iter().copied()) else { continue };
        is_linked = false;
        let faults = if matches!(fault, ReceiptFault::Gap { .. }) { gaps(&chain) } else { vec![fault] };
        for fault in faults {
            found.broken(fault);
        }
    }
    for alone in &given.alone {
        if given.log.iter().any(|own| own.seq == alone.seq && (own.link != alone.link || own.hash != alone.hash)) {
            found.broken(format!("receipt {}: the log has a different receipt at this position", alone.seq));
        }
    }
    is_linked
}

/// Verifies that each key after the first was announced in the log, and tells of the changes.
fn changes_of_key(log: &[ReceiptFile], all: &[&ReceiptFile], found: &mut Findings) {
    if let Err(fault) = verify_keys(log) {
        found.broken(fault);
    }
    for receipt in all {
        if let Some(change) = receipt.receipt.as_ref().and_then(|receipt| receipt.get("key_change")) {
            let told = format!("the key changed from {} to {}", change["before"], change["now"]);
            found.add(Verdict::Note, format!("receipt {}: {told}", receipt.seq));
        }
    }
}

/// Says how many receipts there were.
fn summary(given: &Given, is_linked: bool) -> String {
    let withheld = given.alone.iter().chain(&given.log).filter(|receipt| receipt.receipt.is_none()).count();
    let beside = given.alone.len() + given.handed.len();
    let mut told = Vec::new();
    if !given.log.is_empty() {
        let linked = if is_linked { ", each linked to the one before" } else { "" };
        told.push(format!("{} of the log{linked}", counted(given.log.len(), "receipt")));
    }
    if beside > 0 || given.log.is_empty() {
        let where_to = if given.log.is_empty() { "" } else { " beside it" };
        told.push(format!("{}{where_to}", counted(beside, "receipt")));
    }
    format!("{}; {withheld} of them not released yet", told.join("; "))
}

//! `plumbline verify-receipt`: verifies receipts and the log that chains them, without the service.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::verify_epoch::read_given;
use plumbline_engine::hidden::canonical::{canonical_json, unhex};
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::receipts::{
    LogHead, LogPage, ReceiptFault, ReceiptFile, verify, verify_chain, verify_end, verify_keys, verify_signature,
};
use plumbline_engine::hidden::tlog::note::Checkpoint;
use plumbline_engine::tasks::hex;
use plumbline_engine::text::{agreeing, counted};

/// Arguments of `verify-receipt`.
#[derive(Debug, Args)]
pub struct VerifyReceiptArgs {
    /// Files of receipts (`GET /v1/submissions/ID/receipt`), or of pages of the log (`GET /v1/receipts`) in order.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Public key to trust, in hex: `public_key` in `/.well-known/plumbline-receipts.json`. If the key changed, give
    /// every key.
    #[arg(long = "key", required = true, value_name = "HEX", value_parser = key)]
    keys: Vec<String>,
    /// Accept pages that do not reach the signed end of the log, and receipts whose position in it is not signed.
    /// Receipts that were cut off or moved are then not detected.
    #[arg(long)]
    part: bool,
}

/// Parses a public key.
fn key(text: &str) -> Result<String, &'static str> {
    let is_key = unhex::<32>(text.trim()).is_some();
    is_key.then(|| text.trim().to_ascii_lowercase()).ok_or("expected 64 hexadecimal digits")
}

/// Contents of the files.
#[derive(Default)]
struct Given {
    alone: Vec<ReceiptFile>,
    /// Receipts of hidden evaluation, as they were handed out before the log has them.
    handed: Vec<GivenReceipt>,
    log: Vec<ReceiptFile>,
    heads: Vec<LogHead>,
}

impl Given {
    fn read(&mut self, path: &Path) -> anyhow::Result<()> {
        let place = || path.display().to_string();
        let text = std::fs::read(path).with_context(place)?;
        let value: Value = serde_json::from_slice(&text).with_context(place)?;
        if value.get("receipts").is_none() && value.get("seq").is_none() {
            let told =
                || format!("{}: expected a receipt, a page of the log, or a response with a receipt", path.display());
            self.handed.push(read_given(&value).with_context(told)?);
            return Ok(());
        }
        if value.get("receipts").is_none() {
            self.alone.push(serde_json::from_value(value).with_context(place)?);
            return Ok(());
        }
        let page: LogPage = serde_json::from_value(value).with_context(place)?;
        self.log.extend(page.receipts);
        self.heads.extend(page.head);
        Ok(())
    }

    /// Returns the faults in the positions of the receipts.
    fn places(&self, trusted: &[&str], has_log: bool) -> Vec<ReceiptFault> {
        let mut faults: Vec<ReceiptFault> =
            self.alone.iter().filter_map(|receipt| receipt.verify_place(trusted).err()).collect();
        if has_log {
            if self.log.first().is_some_and(|first| first.seq != 1) {
                faults.push(ReceiptFault::NoBeginning);
            }
            let log: Vec<&ReceiptFile> = self.log.iter().collect();
            let end = match self.heads.iter().max_by_key(|head| head.size) {
                Some(head) => verify_end(&log, head, trusted),
                None => Err(ReceiptFault::NoHead),
            };
            faults.extend(end.err());
        }
        faults
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
    let log = &given.log;
    let mut chains: Vec<Vec<&ReceiptFile>> = given.alone.iter().map(|single| vec![single]).collect();
    // Pages of the log form one chain without gaps.
    chains.push(log.iter().collect());
    let all: Vec<&ReceiptFile> = chains.concat();
    if all.is_empty() && given.heads.is_empty() && given.handed.is_empty() {
        bail!("no receipts in these files");
    }
    let trusted: Vec<&str> = args.keys.iter().map(String::as_str).collect();
    let mut is_good = true;
    let mut withheld = 0;
    for receipt in &all {
        match verify(receipt, &trusted) {
            Ok(()) => {}
            Err(ReceiptFault::Withheld) => withheld += 1,
            Err(fault) => {
                is_good = false;
                println!("BROKEN  receipt {}: {fault}", receipt.seq);
            }
        }
    }
    for handed in &given.handed {
        let hash = hex(&Sha256::digest(canonical_json(&handed.receipt)));
        let is_own = hash == handed.hash && trusted.contains(&handed.public_key.as_str());
        if is_own && verify_signature(&handed.receipt, &handed.public_key, &handed.signature).is_ok() {
            println!(
                "NOTE    receipt {}…: is signed; the log has it by its hash from the next full minute on",
                &hash[..12]
            );
        } else {
            is_good = false;
            println!("BROKEN  receipt {}…: its hash, its key or its signature does not verify", &hash[..12]);
        }
    }
    for alone in given.alone.iter().filter(|receipt| receipt.inclusion.is_none()) {
        println!("NOTE    receipt {}: has no proof of inclusion, so whether the log has it was not checked", alone.seq);
    }
    for alone in given.alone.iter().filter(|receipt| receipt.inclusion.is_some()) {
        match alone.verify_inclusion(&trusted) {
            Ok(Checkpoint { origin, size, .. }) => {
                println!(
                    "NOTE    receipt {}: is in the log {origin} of {}",
                    alone.seq,
                    agreeing(size, "entry", "entries")
                );
            }
            Err(fault) => {
                is_good = false;
                println!("BROKEN  receipt {}: {fault}", alone.seq);
            }
        }
    }
    for fault in chains.iter().filter_map(|chain| verify_chain(chain.iter().copied()).err()) {
        is_good = false;
        println!("BROKEN  {fault}");
    }
    for alone in &given.alone {
        if given.log.iter().any(|own| own.seq == alone.seq && (own.link != alone.link || own.hash != alone.hash)) {
            is_good = false;
            println!("BROKEN  receipt {}: the log has a different receipt at this position", alone.seq);
        }
    }
    let has_log = given.alone.len() + given.handed.len() < args.files.len();
    for fault in given.places(&trusted, has_log).iter().filter(|_| !args.part) {
        is_good = false;
        println!("BROKEN  {fault}");
    }
    if let Err(fault) = verify_keys(log) {
        is_good = false;
        println!("BROKEN  {fault}");
    }
    for receipt in &all {
        let change = receipt.receipt.as_ref().and_then(|receipt| receipt.get("key_change"));
        if let Some(change) = change {
            println!("NOTE    receipt {}: the key changed from {} to {}", receipt.seq, change["before"], change["now"]);
        }
    }
    let chain = if log.is_empty() { "" } else { ", each log entry linked to the one before" };
    println!("{}{chain}; {withheld} of them not released yet", counted(all.len() + given.handed.len(), "receipt"));
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

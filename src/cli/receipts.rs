//! `plumbline verify-receipt`: checks receipts, and the log that chains them, without the service.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::Value;

use crate::epochs::receipts::{ReceiptFault, ReceiptFile, verify, verify_chain, verify_keys};

/// Arguments of `verify-receipt`.
#[derive(Debug, Args)]
pub struct VerifyReceiptArgs {
    /// Receipts (`GET /v1/submissions/ID/receipt`), or pages of the log (`GET /v1/receipts`) in order.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// A public key to trust, in hex: `public_key` of `/.well-known/plumbline-receipts.json`. Give each one where the key changed.
    #[arg(long = "key", required = true, value_name = "HEX")]
    keys: Vec<String>,
}

/// The receipts of a file, and whether it is a page of the log.
fn read(path: &Path) -> anyhow::Result<(Vec<ReceiptFile>, bool)> {
    let place = || path.display().to_string();
    let text = std::fs::read(path).with_context(place)?;
    let value: Value = serde_json::from_slice(&text).with_context(place)?;
    match value.get("receipts") {
        Some(page) => Ok((serde_json::from_value(page.clone()).with_context(place)?, true)),
        None => Ok((vec![serde_json::from_value(value).with_context(place)?], false)),
    }
}

/// Runs the command: exit 1 where a receipt or the chain does not hold.
///
/// # Errors
/// Where a file cannot be read.
pub fn run(args: &VerifyReceiptArgs) -> anyhow::Result<ExitCode> {
    let (mut all, mut log) = (Vec::new(), Vec::new());
    for file in &args.files {
        let (receipts, is_page) = read(file)?;
        if is_page { log.extend(receipts) } else { all.extend(receipts) }
    }
    let mut chains: Vec<Vec<&ReceiptFile>> = all.iter().map(|single| vec![single]).collect();
    // Pages follow each other, without a gap.
    chains.push(log.iter().collect());
    let all: Vec<&ReceiptFile> = chains.concat();
    if all.is_empty() {
        bail!("no receipts in these files");
    }
    let trusted: Vec<&str> = args.keys.iter().map(|key| key.trim()).collect();
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
    for fault in chains.iter().filter_map(|chain| verify_chain(chain.iter().copied()).err()) {
        is_good = false;
        println!("BROKEN  {fault}");
    }
    if let Err(fault) = verify_keys(&log) {
        is_good = false;
        println!("BROKEN  {fault}");
    }
    for receipt in &all {
        let change = receipt.receipt.as_ref().and_then(|receipt| receipt.get("key_change"));
        if let Some(change) = change {
            println!("NOTE    receipt {}: the key changed from {} to {}", receipt.seq, change["before"], change["now"]);
        }
    }
    let chain = if log.is_empty() { "" } else { ", each of the log linked to the one before" };
    println!("{} receipts{chain}; {withheld} of them not released yet", all.len());
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

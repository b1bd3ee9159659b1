//! `plumbline verify-receipt`: verifies receipts and the log that chains them, without the service.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::evidence::{is_reveal, key, read_given};
use super::files;
use super::serve::MAX_PUBLISH_SECONDS;
use plumbline_engine::hidden::canonical::canonical_json;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::receipts::{
    LogHead, LogPage, ReceiptFault, ReceiptFile, gaps, of_other_keys, verify, verify_chain, verify_end, verify_keys,
    verify_signature,
};
use plumbline_engine::hidden::tlog::note::Checkpoint;
use plumbline_engine::tasks::hex;
use plumbline_engine::text::{agreeing, counted};

/// Arguments of `verify-receipt`.
#[derive(Debug, Args)]
pub struct VerifyReceiptArgs {
    /// Files of receipts (`GET /v1/submissions/ID/receipt`), or of pages of the log (`GET /v1/receipts`).
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

/// How long after its time a receipt is in the log for sure, in milliseconds: the longest interval at which a service may
/// publish receipts of hidden evaluation, and some minutes.
const LOGGED_WITHIN_MS: i64 = 1_000 * MAX_PUBLISH_SECONDS.cast_signed() + 5 * 60_000;

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
        let value: Value = files::json(path)?;
        if is_reveal(&value) {
            bail!(
                "{}: is a reveal, which `plumbline verify-epoch` verifies; expected pages of GET /v1/receipts",
                path.display()
            );
        }
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

/// What is known of a receipt as it was handed out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Note,
    NotChecked,
    Broken,
}

impl Verdict {
    const fn label(self) -> &'static str {
        match self {
            Self::Note => "NOTE   ",
            Self::NotChecked => "NOT CHECKED ",
            Self::Broken => "BROKEN ",
        }
    }
}

impl Given {
    /// Verifies a receipt with this hash, as it was handed out, and looks it up in the pages of the log. If the pages are
    /// the whole log, a receipt that they lack although their head was signed more than a day later is not in the log.
    fn handed_out(&self, handed: &GivenReceipt, hash: &str, trusted: &[&str]) -> (Verdict, Cow<'static, str>) {
        let is_own = hash == handed.hash && trusted.contains(&handed.public_key.as_str());
        if !is_own || verify_signature(&handed.receipt, &handed.public_key, &handed.signature).is_err() {
            return (Verdict::Broken, "its hash, its key or its signature does not verify".into());
        }
        if self.log.is_empty() {
            let told = "is signed; whether the log has it was not checked: give the pages of the log too";
            return (Verdict::NotChecked, told.into());
        }
        if let Some(own) = self.log.iter().find(|own| own.hash == hash) {
            return (Verdict::Note, format!("is at position {} of the log", own.seq).into());
        }
        if let Some(broken) = self.lacks(&handed.receipt) {
            return broken;
        }
        let told = "is signed, and not in the pages given; the log has it by its hash from the next full minute on: fetch \
                    all of its pages later than that";
        (Verdict::NotChecked, told.into())
    }

    /// Says that the log lacks a receipt, if the pages are all of it and their head was signed more than a day later.
    fn lacks(&self, receipt: &Value) -> Option<(Verdict, Cow<'static, str>)> {
        let head = self.heads.iter().max_by_key(|head| head.size);
        let whole = head.filter(|head| usize::try_from(head.size) == Ok(self.log.len()))?;
        let later = whole.at_ms.saturating_sub(time_of(receipt)?);
        let told = || format!("is not in the log, whose head was signed {} later", counted(later / 3_600_000, "hour"));
        (later > LOGGED_WITHIN_MS).then(|| (Verdict::Broken, told().into()))
    }

    /// Looks a receipt with a place but without a proof up in the pages of the log.
    fn without_inclusion(&self, alone: &ReceiptFile) -> (Verdict, Cow<'static, str>) {
        if self.log.iter().any(|own| own.seq == alone.seq && own.hash == alone.hash && own.link == alone.link) {
            return (Verdict::Note, "is in the log".into());
        }
        let head = self.heads.iter().map(|head| head.size).max();
        let told = if self.log.is_empty() {
            "has no proof of inclusion, so whether the log has it was not checked: give the pages of the log too"
        } else if head.is_some_and(|size| alone.seq > size) {
            "has no proof of inclusion, and comes after the signed end of the pages given: fetch all of its pages again"
        } else {
            "has no proof of inclusion, and is not in the pages given: fetch all of its pages again"
        };
        alone.receipt.as_ref().and_then(|receipt| self.lacks(receipt)).unwrap_or((Verdict::NotChecked, told.into()))
    }
}

/// Returns the latest time that a receipt states, in milliseconds since 1970. What it confirms may state it: a
/// registration, an answer.
fn time_of(receipt: &Value) -> Option<i64> {
    let of_member = |(name, value): (&String, &Value)| match value {
        Value::Number(at_ms) if name.ends_with("_at_ms") => at_ms.as_i64(),
        inner => time_of(inner),
    };
    receipt.as_object()?.iter().filter_map(of_member).max()
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
    let log = &given.log;
    let mut chains: Vec<Vec<&ReceiptFile>> = given.alone.iter().map(|single| vec![single]).collect();
    // Pages of the log form one chain without gaps.
    chains.push(log.iter().collect());
    let all: Vec<&ReceiptFile> = given.alone.iter().chain(&copies).collect();
    if all.is_empty() && given.heads.is_empty() && given.handed.is_empty() {
        bail!("no receipts in these files");
    }
    let trusted: Vec<&str> = args.keys.iter().map(String::as_str).collect();
    let mut is_good = true;
    let withheld = chains.iter().flatten().filter(|receipt| receipt.receipt.is_none()).count();
    for others in of_other_keys(all.iter().copied(), &trusted) {
        is_good = false;
        println!("BROKEN  {others}");
    }
    for receipt in &all {
        match verify(receipt, &trusted) {
            Ok(()) | Err(ReceiptFault::Withheld | ReceiptFault::OtherKey { .. }) => {}
            Err(fault) => {
                is_good = false;
                println!("BROKEN  receipt {}: {fault}", receipt.seq);
            }
        }
    }
    for handed in &given.handed {
        let hash = hex(&Sha256::digest(canonical_json(&handed.receipt)));
        let (verdict, told) = given.handed_out(handed, &hash, &trusted);
        is_good &= verdict != Verdict::Broken;
        println!("{} receipt {}…: {told}", verdict.label(), &hash[..12]);
    }
    for alone in given.alone.iter().filter(|receipt| receipt.inclusion.is_none()) {
        let (verdict, told) = given.without_inclusion(alone);
        is_good &= verdict != Verdict::Broken;
        println!("{} receipt {}: {told}", verdict.label(), alone.seq);
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
    let mut is_linked = true;
    for chain in &chains {
        let Err(fault) = verify_chain(chain.iter().copied()) else { continue };
        (is_good, is_linked) = (false, false);
        let faults = if matches!(fault, ReceiptFault::Gap { .. }) { gaps(chain) } else { vec![fault] };
        for fault in faults {
            println!("BROKEN  {fault}");
        }
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
        let or = if *fault == ReceiptFault::NoBeginning { ", or use --part" } else { "" };
        println!("BROKEN  end of the log: {fault}{or}");
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
    let beside = given.alone.len() + given.handed.len();
    let mut told = Vec::new();
    if !log.is_empty() {
        let linked = if is_linked { ", each linked to the one before" } else { "" };
        told.push(format!("{} of the log{linked}", counted(log.len(), "receipt")));
    }
    if beside > 0 || log.is_empty() {
        told.push(format!("{}{}", counted(beside, "receipt"), if log.is_empty() { "" } else { " beside it" }));
    }
    println!("{}; {withheld} of them not released yet", told.join("; "));
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_engine::hidden::evidence::{EntryFact, Fact, receipt};
    use plumbline_engine::hidden::feedback::Tier;
    use plumbline_engine::hidden::receipts::Signer;
    use serde_json::json;

    #[test]
    fn a_receipt_that_was_handed_out_is_looked_up_in_the_log() {
        let signer = Signer::new(&[5; 32]);
        let handed = |registered_at_ms: i64| {
            let [id, owner, agent, configuration_sha256] = [(); 4].map(|()| "x".to_owned());
            let entry =
                EntryFact { id, owner, agent, configuration_sha256, tier: Tier::Dev, runs: 1, registered_at_ms };
            let receipt = receipt("2026-11", &[1; 32], &Fact::Entry(entry));
            let signed = signer.sign(&receipt);
            GivenReceipt {
                receipt,
                hash: hex(&signed.hash),
                signature: signed.signature,
                public_key: signed.public_key,
            }
        };
        let logged = handed(1_000);
        // Two days later.
        let head = LogHead::signed(1, "0".repeat(64), 172_800_000, &signer);
        let own = json!({ "seq": 1, "receipt": null, "hash": logged.hash, "signature": null,
            "public_key": logged.public_key, "previous": "", "link": "" });
        let mut given =
            Given { log: vec![serde_json::from_value(own).unwrap()], heads: vec![head], ..Given::default() };
        let trusted = signer.public_key();
        let verdict = |given: &Given, handed: &GivenReceipt| {
            let (verdict, told) = given.handed_out(handed, &handed.hash, &[&trusted]);
            (verdict, told.into_owned())
        };
        assert_eq!(verdict(&given, &logged), (Verdict::Note, "is at position 1 of the log".to_owned()));
        let (broken, told) = verdict(&given, &handed(2_000));
        assert_eq!(broken, Verdict::Broken);
        assert!(told.contains("is not in the log, whose head was signed 47 hours later"), "{told}");
        // It may be too young, or on a page that was not given.
        assert_eq!(verdict(&given, &handed(172_000_000)).0, Verdict::NotChecked);
        // So for one that is returned with its place, but without a proof.
        let placed = |handed: &GivenReceipt| ReceiptFile {
            receipt: Some(handed.receipt.clone()),
            hash: handed.hash.clone(),
            ..given.log[0].clone()
        };
        assert_eq!(given.without_inclusion(&placed(&logged)).0, Verdict::Note);
        assert_eq!(given.without_inclusion(&placed(&handed(2_000))).0, Verdict::Broken);
        assert_eq!(given.without_inclusion(&placed(&handed(172_000_000))).0, Verdict::NotChecked);
        assert_eq!(Given::default().without_inclusion(&placed(&logged)).0, Verdict::NotChecked);
        let later = ReceiptFile { seq: 2, ..placed(&handed(172_000_000)) };
        let (verdict_of, told) = given.without_inclusion(&later);
        assert_eq!(verdict_of, Verdict::NotChecked);
        assert!(told.contains("comes after the signed end"), "{told}");
        given.heads[0].size = 2;
        assert_eq!(verdict(&given, &handed(2_000)).0, Verdict::NotChecked);
        assert_eq!(verdict(&Given::default(), &logged).0, Verdict::NotChecked);
        let forged = GivenReceipt { receipt: json!({ "entry": { "registered_at_ms": 5 } }), ..logged };
        assert_eq!(verdict(&given, &forged).0, Verdict::Broken);
    }
}

//! The receipts that `verify-receipt` is given, and what the pages of the log beside them say of each.

use std::borrow::Cow;
use std::path::Path;

use anyhow::{Context as _, bail};
use serde_json::Value;

use super::evidence::{handed_out_in, is_reveal};
use super::files;
use super::serve::MAX_PUBLISH_SECONDS;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::receipts::{LogHead, LogPage, ReceiptFault, ReceiptFile, verify_end, verify_signature};
use plumbline_engine::text::counted;

/// How long after its time a receipt is in the log for sure, in milliseconds: the longest interval at which a service may
/// publish receipts of hidden evaluation, and some minutes.
const LOGGED_WITHIN_MS: i64 = 1_000 * MAX_PUBLISH_SECONDS.cast_signed() + 5 * 60_000;

/// Contents of the files.
#[derive(Default)]
pub(super) struct Given {
    /// Receipts with their places, each from a file of its own.
    pub alone: Vec<ReceiptFile>,
    /// Receipts of hidden evaluation, as they were handed out before the log has them.
    pub handed: Vec<GivenReceipt>,
    /// Receipts of the pages.
    pub log: Vec<ReceiptFile>,
    /// Signed ends of the log, of the pages.
    pub heads: Vec<LogHead>,
    /// Whether any file is a page of the log, even an empty one.
    has_pages: bool,
}

impl Given {
    /// Adds the contents of a file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, or holds anything but receipts.
    pub fn read(&mut self, path: &Path) -> anyhow::Result<()> {
        let place = || path.display().to_string();
        let mut is_empty = true;
        for value in files::values(path)? {
            if is_reveal(&value) {
                bail!(
                    "{}: is a reveal, which `plumbline verify-epoch` verifies; expected pages of GET /v1/receipts",
                    place()
                );
            }
            if value["receipts"].is_array() {
                let page: LogPage = serde_json::from_value(value).with_context(place)?;
                self.log.extend(page.receipts);
                self.heads.extend(page.head);
                (self.has_pages, is_empty) = (true, false);
            } else if value.get("seq").is_some() {
                self.alone.push(serde_json::from_value(value).with_context(place)?);
                is_empty = false;
            } else {
                let handed = handed_out_in(&value);
                is_empty &= handed.is_empty();
                self.handed.extend(handed.into_iter().map(|(_, given)| given));
            }
        }
        if is_empty {
            bail!("{}: expected a receipt, a page of the log, or a response with a receipt", place());
        }
        Ok(())
    }

    /// Returns the faults in the positions of the receipts.
    pub fn places(&self, trusted: &[&str]) -> Vec<ReceiptFault> {
        let mut faults: Vec<ReceiptFault> =
            self.alone.iter().filter_map(|receipt| receipt.verify_place(trusted).err()).collect();
        if self.has_pages {
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
pub(super) enum Verdict {
    Note,
    NotChecked,
    Broken,
}

impl Verdict {
    /// Returns the word that begins a line with this verdict.
    pub const fn label(self) -> &'static str {
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
    pub fn handed_out(&self, handed: &GivenReceipt, hash: &str, trusted: &[&str]) -> (Verdict, Cow<'static, str>) {
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
    pub fn without_inclusion(&self, alone: &ReceiptFile) -> (Verdict, Cow<'static, str>) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_engine::hidden::evidence::{EntryFact, Fact, receipt};
    use plumbline_engine::hidden::feedback::Tier;
    use plumbline_engine::hidden::receipts::Signer;
    use plumbline_engine::tasks::hex;
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

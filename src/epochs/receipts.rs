//! Receipts: what a grade was, signed, and chained to all receipts before it.
//!
//! A receipt's bytes are its canonical JSON; its hash is their SHA-256; its signature is Ed25519 over them. The public log holds
//! the hashes in order, each link the SHA-256 over the link before it and the hash, so none can be taken out or put in later
//! without every later link changing.

use ed25519_dalek::{Signature, Signer as _, SigningKey, VerifyingKey};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest as _, Sha256};

use super::canonical::{Hash, canonical_json, unhex};
use crate::grading::Report;
use crate::tasks::hex;

/// The link before the first.
pub const FIRST_LINK: Hash = [0; 32];

/// What is known of a grade beside its report.
#[derive(Debug, Clone, Copy)]
pub struct Graded<'a> {
    /// The submission.
    pub submission: &'a str,
    /// The attempt that graded it.
    pub attempt: i64,
    /// Suite of its task.
    pub suite: &'a str,
    /// SHA-256 of the log's canonical JSON.
    pub log_hash: &'a str,
    /// Name and version of the program.
    pub grader: &'a str,
    /// When.
    pub graded_at_ms: i64,
    /// Of a hidden instance: its id, and the salt that keeps its receipt's hash from being guessed before the epoch closes.
    pub hidden: Option<(&'a str, &'a str)>,
}

/// The receipt of a grade.
#[must_use]
pub fn receipt(graded: &Graded<'_>, report: &Report) -> Value {
    let criteria: Map<String, Value> = report
        .criteria
        .iter()
        .map(|criterion| {
            (criterion.criterion.name().to_owned(), json!({ "holds": criterion.holds, "mean": criterion.mean }))
        })
        .collect();
    let mut receipt = json!({
        "plumbline_receipt": 1,
        "submission": graded.submission,
        "attempt": graded.attempt,
        "suite": graded.suite,
        "task": report.task,
        "specification_sha256": report.task_hash,
        "log_sha256": graded.log_hash,
        "checks_version": report.checks_version,
        "grader": graded.grader,
        "graded_at_ms": graded.graded_at_ms,
        "overall": report.overall,
        "accuracy": report.accuracy,
        "criteria": criteria,
    });
    if let Some((instance, salt)) = graded.hidden {
        receipt["instance"] = instance.into();
        receipt["salt"] = salt.into();
    }
    receipt
}

/// The entry that says that another key signs from now on. It is signed with that one: the old key may be lost.
#[must_use]
pub fn key_change(before: &str, now: &str, at_ms: i64) -> Value {
    json!({ "plumbline_receipt": 1, "key_change": { "before": before, "now": now, "at_ms": at_ms } })
}

/// A receipt with its signature; hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signed {
    /// The canonical JSON.
    pub body: String,
    /// SHA-256 of the body.
    pub hash: Hash,
    /// Ed25519 over the body.
    pub signature: String,
    /// The key that verifies it.
    pub public_key: String,
}

/// Signs receipts. It prints without its key.
pub struct Signer(SigningKey);

impl std::fmt::Debug for Signer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Signer({})", self.public_key())
    }
}

impl Signer {
    /// With this secret key.
    #[must_use]
    pub fn new(secret: &[u8; 32]) -> Self {
        Self(SigningKey::from_bytes(secret))
    }

    /// The key that verifies what it signs, in hex.
    #[must_use]
    pub fn public_key(&self) -> String {
        hex(self.0.verifying_key().as_bytes())
    }

    /// A receipt, signed.
    #[must_use]
    pub fn sign(&self, receipt: &Value) -> Signed {
        let body = canonical_json(receipt);
        Signed {
            hash: Sha256::digest(&body).into(),
            signature: hex(&self.0.sign(&body).to_bytes()),
            public_key: self.public_key(),
            body: String::from_utf8(body).unwrap_or_default(),
        }
    }
}

/// The link after `before` for a receipt with this hash.
#[must_use]
pub fn link(before: &Hash, receipt: &Hash) -> Hash {
    Sha256::new().chain_update(before).chain_update(receipt).finalize().into()
}

/// A receipt as the service hands it out, to be checked without it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ReceiptFile {
    /// Its place in the public log, from 1.
    pub seq: i64,
    /// The receipt; null while it belongs to a hidden instance of an open epoch.
    #[schema(value_type = Option<Object>)]
    pub receipt: Option<Value>,
    /// SHA-256 of the receipt's canonical JSON.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub hash: String,
    /// Ed25519 signature over that JSON; null while the receipt is.
    pub signature: Option<String>,
    /// The public key that verifies it.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub public_key: String,
    /// The link before it.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub previous: String,
    /// SHA-256 over the link before it and its hash.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub link: String,
}

/// What is wrong with a receipt.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReceiptFault {
    /// It has not been released.
    #[error("the receipt is not released before its epoch closes; its hash and link stand in the log")]
    Withheld,
    /// A field is not what it should be.
    #[error("{0}: not hexadecimal of the right length")]
    Unreadable(&'static str),
    /// The key is another.
    #[error("signed with key {found}, not with {wanted}")]
    OtherKey {
        /// The receipt's.
        found: String,
        /// The one to trust.
        wanted: String,
    },
    /// The hash is another's.
    #[error("the receipt has the hash {0}, which is not the one in the log: it was changed")]
    OtherHash(String),
    /// The signature does not verify.
    #[error("the signature does not verify: the receipt is not of this key")]
    BadSignature,
    /// The key changed, and the log does not say so.
    #[error("receipt {0} is signed with another key than the one before it, and no entry says that the key changed")]
    UntoldKey(i64),
    /// The link does not follow.
    #[error("link {0} does not follow from the link before it and the hash")]
    BrokenLink(i64),
}

/// Checks a receipt against the public keys that are trusted.
///
/// # Errors
/// The first fault.
pub fn verify(file: &ReceiptFile, trusted: &[&str]) -> Result<(), ReceiptFault> {
    let public_key = file.public_key.as_str();
    if !trusted.contains(&public_key) {
        return Err(ReceiptFault::OtherKey { found: file.public_key.clone(), wanted: trusted.join(" or ") });
    }
    let (Some(receipt), Some(signature)) = (&file.receipt, &file.signature) else { return Err(ReceiptFault::Withheld) };
    let body = canonical_json(receipt);
    let hash: Hash = Sha256::digest(&body).into();
    if hex(&hash) != file.hash {
        return Err(ReceiptFault::OtherHash(hex(&hash)));
    }
    let key = unhex(public_key).and_then(|bytes| VerifyingKey::from_bytes(&bytes).ok());
    let key = key.ok_or(ReceiptFault::Unreadable("public_key"))?;
    let signature = unhex(signature).ok_or(ReceiptFault::Unreadable("signature"))?;
    key.verify_strict(&body, &Signature::from_bytes(&signature)).map_err(|_bad| ReceiptFault::BadSignature)?;
    let previous = unhex(&file.previous).ok_or(ReceiptFault::Unreadable("previous"))?;
    if hex(&link(&previous, &hash)) != file.link {
        return Err(ReceiptFault::BrokenLink(file.seq));
    }
    Ok(())
}

/// Checks that the key of each entry of the log is that of the entry before it, or that it says itself that the key changed.
///
/// # Errors
/// The first entry that does not.
pub fn verify_keys<'a>(log: impl IntoIterator<Item = &'a ReceiptFile>) -> Result<(), ReceiptFault> {
    let mut last: Option<&str> = None;
    for file in log {
        let is_told = |before: &str| {
            let change = file.receipt.as_ref().and_then(|receipt| receipt.get("key_change"));
            change.is_some_and(|change| change["before"] == before && change["now"] == file.public_key.as_str())
        };
        if last.is_some_and(|last| last != file.public_key && !is_told(last)) {
            return Err(ReceiptFault::UntoldKey(file.seq));
        }
        last = Some(&file.public_key);
    }
    Ok(())
}

/// Checks that entries of the log, in order, follow from each other.
///
/// # Errors
/// The first link that does not.
pub fn verify_chain<'a>(log: impl IntoIterator<Item = &'a ReceiptFile>) -> Result<usize, ReceiptFault> {
    let mut last: Option<&str> = None;
    let mut count = 0;
    for file in log {
        let previous: Hash = unhex(&file.previous).ok_or(ReceiptFault::Unreadable("previous"))?;
        let hash: Hash = unhex(&file.hash).ok_or(ReceiptFault::Unreadable("hash"))?;
        let starts = file.seq > 1 || previous == FIRST_LINK;
        let follows = last.is_none_or(|last| last == file.previous);
        if !starts || !follows || hex(&link(&previous, &hash)) != file.link {
            return Err(ReceiptFault::BrokenLink(file.seq));
        }
        last = Some(&file.link);
        count += 1;
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(signer: &Signer, seq: i64, previous: &Hash, receipt: Value) -> ReceiptFile {
        let signed = signer.sign(&receipt);
        ReceiptFile {
            seq,
            receipt: Some(receipt),
            hash: hex(&signed.hash),
            signature: Some(signed.signature),
            public_key: signed.public_key,
            previous: hex(previous),
            link: hex(&link(previous, &signed.hash)),
        }
    }

    #[test]
    fn a_receipt_verifies_and_a_changed_one_does_not() {
        let signer = Signer::new(&[5; 32]);
        let other = Signer::new(&[6; 32]).public_key();
        let good = file(&signer, 1, &FIRST_LINK, json!({ "overall": true, "submission": "s" }));
        assert_eq!(verify(&good, &[&other, &signer.public_key()]), Ok(()));
        let mut changed = good.clone();
        changed.receipt = Some(json!({ "overall": false, "submission": "s" }));
        assert!(matches!(verify(&changed, &[&signer.public_key()]), Err(ReceiptFault::OtherHash(_))));
        changed.hash = hex(&Sha256::digest(canonical_json(&changed.receipt)));
        assert_eq!(verify(&changed, &[&signer.public_key()]), Err(ReceiptFault::BadSignature));
        assert!(matches!(verify(&good, &[&other]), Err(ReceiptFault::OtherKey { .. })));
        let mut cut = good.clone();
        cut.previous = hex(&[1; 32]);
        assert_eq!(verify(&cut, &[&signer.public_key()]), Err(ReceiptFault::BrokenLink(1)));
        assert!(!format!("{signer:?}").contains(&hex(&[5; 32])));
    }

    #[test]
    fn a_key_changes_only_where_the_log_says_so() {
        let (old, new) = (Signer::new(&[5; 32]), Signer::new(&[6; 32]));
        let first = file(&old, 1, &FIRST_LINK, json!({ "submission": 1 }));
        let told = key_change(&old.public_key(), &new.public_key(), 3);
        let change = file(&new, 2, &unhex(&first.link).unwrap(), told);
        let after = file(&new, 3, &unhex(&change.link).unwrap(), json!({ "submission": 2 }));
        assert_eq!(verify_keys([&first, &change, &after]), Ok(()));
        assert_eq!(verify_keys([&first, &after]), Err(ReceiptFault::UntoldKey(3)));
        assert_eq!(verify(&change, &[&new.public_key()]), Ok(()));
    }

    #[test]
    fn a_log_from_which_one_was_taken_breaks() {
        let signer = Signer::new(&[5; 32]);
        let mut previous = FIRST_LINK;
        let log: Vec<ReceiptFile> = (1..=4)
            .map(|seq| {
                let file = file(&signer, seq, &previous, json!({ "submission": seq }));
                previous = unhex(&file.link).unwrap();
                file
            })
            .collect();
        assert_eq!(verify_chain(&log), Ok(4));
        assert_eq!(verify_chain(&log[1..]), Ok(3), "a page from the middle");
        assert_eq!(verify_chain([&log[0], &log[2]]), Err(ReceiptFault::BrokenLink(3)));
    }
}

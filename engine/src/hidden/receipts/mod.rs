//! Receipts: what a grade was, signed, and chained to all receipts before it.
//!
//! A receipt's bytes are its canonical JSON; its hash is their SHA-256; its signature is Ed25519 over them. The public log holds
//! the hashes in order, each link the SHA-256 over the link before it and the hash, so none can be taken out or put in later
//! without every later link changing.

mod log;

use ed25519_dalek::{Signature, Signer as _, SigningKey, VerifyingKey};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest as _, Sha256};

use super::canonical::{Hash, canonical_json, unhex};
use crate::grading::Report;
use crate::tasks::hex;

pub use log::{FIRST_LINK, LogHead, LogPage, link, verify_chain, verify_end, verify_keys};

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
    /// Of a hidden instance: what else is said of it.
    pub hidden: Option<OfInstance<'a>>,
}

/// What the receipt of a hidden instance says beside.
#[derive(Debug, Clone, Copy)]
pub struct OfInstance<'a> {
    /// The epoch.
    pub epoch: &'a str,
    /// The instance.
    pub instance: &'a str,
    /// Keeps the receipt's hash from being guessed before the epoch closes.
    pub salt: &'a str,
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
    if let Some(hidden) = graded.hidden {
        receipt["epoch"] = hidden.epoch.into();
        receipt["instance"] = hidden.instance.into();
        receipt["salt"] = hidden.salt.into();
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
    /// Of a receipt that is handed out alone: Ed25519 signature over its place and link, in hex. On a page of the log the signed head
    /// stands for all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(pattern = "^[0-9a-f]{128}$")]
    pub place_signature: Option<String>,
}

pub(super) fn must_be_trusted(public_key: &str, trusted: &[&str]) -> Result<(), ReceiptFault> {
    if trusted.contains(&public_key) {
        return Ok(());
    }
    Err(ReceiptFault::OtherKey { found: public_key.to_owned(), wanted: trusted.join(" or ") })
}

/// Checks a signature over the canonical JSON of a value.
///
/// # Errors
/// Where key or signature cannot be read, or the signature does not verify.
pub fn verify_signature(value: &Value, public_key: &str, signature: &str) -> Result<(), ReceiptFault> {
    let key = unhex(public_key).and_then(|bytes| VerifyingKey::from_bytes(&bytes).ok());
    let key = key.ok_or(ReceiptFault::Unreadable("public_key"))?;
    let signature = unhex(signature).ok_or(ReceiptFault::Unreadable("signature"))?;
    let verified = key.verify_strict(&canonical_json(value), &Signature::from_bytes(&signature));
    verified.map_err(|_bad| ReceiptFault::BadSignature)
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
    /// Nothing vouches for the receipt's place in the log.
    #[error(
        "the place of receipt {0} in the log is not signed; ask the service for it again, or give the page of the log with its head"
    )]
    UnsignedPlace(i64),
    /// The signature over the place does not verify.
    #[error("the signature over place {0} of the log does not verify: the place was changed")]
    BadPlace(i64),
    /// The log has more or fewer receipts than its signed head says.
    #[error("the log ends at receipt {found}, and its signed head says {signed}: receipts were cut off, or added")]
    OtherLength {
        /// The last that is there.
        found: i64,
        /// What the head says.
        signed: i64,
    },
    /// No head came with the log.
    #[error(
        "no signed head came with the log, so nothing shows that its end is there; `GET /v1/receipts` sends one with each page"
    )]
    NoHead,
    /// The log does not begin with its first receipt.
    #[error("the log does not begin with receipt 1: give all of its pages, or --part")]
    NoBeginning,
    /// The link does not follow.
    #[error("link {0} does not follow from the link before it and the hash")]
    BrokenLink(i64),
}

/// Checks a receipt against the public keys that are trusted.
///
/// # Errors
/// The first fault.
pub fn verify(file: &ReceiptFile, trusted: &[&str]) -> Result<(), ReceiptFault> {
    must_be_trusted(&file.public_key, trusted)?;
    let (Some(receipt), Some(signature)) = (&file.receipt, &file.signature) else { return Err(ReceiptFault::Withheld) };
    let body = canonical_json(receipt);
    let hash: Hash = Sha256::digest(&body).into();
    if hex(&hash) != file.hash {
        return Err(ReceiptFault::OtherHash(hex(&hash)));
    }
    verify_signature(receipt, &file.public_key, signature)?;
    let previous = unhex(&file.previous).ok_or(ReceiptFault::Unreadable("previous"))?;
    if hex(&link(&previous, &hash)) != file.link {
        return Err(ReceiptFault::BrokenLink(file.seq));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn file(signer: &Signer, seq: i64, previous: &Hash, receipt: Value) -> ReceiptFile {
        let signed = signer.sign(&receipt);
        ReceiptFile {
            seq,
            receipt: Some(receipt),
            hash: hex(&signed.hash),
            signature: Some(signed.signature),
            public_key: signed.public_key,
            previous: hex(previous),
            link: hex(&link(previous, &signed.hash)),
            place_signature: None,
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
}

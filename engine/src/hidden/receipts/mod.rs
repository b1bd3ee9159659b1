//! Receipts: signed statements of grades, each chained to all receipts before it.
//!
//! The bytes of a receipt are its canonical JSON. Its hash is the SHA-256 of these bytes, and its signature is an
//! Ed25519 signature over them. The public log holds the hashes in order; each link is the SHA-256 over the previous
//! link and the hash, so removing or inserting a receipt changes every later link.

mod faults;
mod log;

use ed25519_dalek::{Signature, Signer as _, SigningKey, VerifyingKey};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest as _, Sha256};

use super::canonical::{Hash, canonical_json, unhex};
use crate::grading::Report;
use crate::tasks::hex;

pub use faults::{OfOtherKey, ReceiptFault, of_other_keys};
pub use log::{FIRST_LINK, LogHead, LogPage, gaps, link, verify_chain, verify_end, verify_keys};

/// The facts about a grade that its report does not contain.
#[derive(Debug, Clone, Copy)]
pub struct Graded<'a> {
    /// Identifier of the submission.
    pub submission: &'a str,
    /// Number of the attempt that graded the submission.
    pub attempt: i64,
    /// Suite of the task.
    pub suite: &'a str,
    /// SHA-256 of the canonical JSON of the block log.
    pub log_hash: &'a str,
    /// Name and version of the grading program.
    pub grader: &'a str,
    /// Time of grading, milliseconds since 1970.
    pub graded_at_ms: i64,
    /// Additional facts about the grade of a hidden instance.
    pub hidden: Option<OfInstance<'a>>,
}

/// The additional facts on the receipt of a hidden instance.
#[derive(Debug, Clone, Copy)]
pub struct OfInstance<'a> {
    /// Name of the epoch.
    pub epoch: &'a str,
    /// Identifier of the instance.
    pub instance: &'a str,
    /// Salt that prevents guessing the receipt behind a hash before the epoch closes.
    pub salt: &'a str,
}

/// Builds the receipt of a grade.
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

/// Builds the log entry that announces a new signing key. The new key signs the entry, because the old key may be lost.
#[must_use]
pub fn key_change(before: &str, now: &str, at_ms: i64) -> Value {
    json!({ "plumbline_receipt": 1, "key_change": { "before": before, "now": now, "at_ms": at_ms } })
}

/// A signed receipt. Signature and key are in hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signed {
    /// Canonical JSON of the receipt.
    pub body: String,
    /// SHA-256 of the body.
    pub hash: Hash,
    /// Ed25519 signature over the body.
    pub signature: String,
    /// Public key that verifies the signature.
    pub public_key: String,
}

/// Signs receipts. Its `Debug` output shows the public key only.
pub struct Signer(SigningKey);

impl std::fmt::Debug for Signer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Signer({})", self.public_key())
    }
}

impl Signer {
    /// Creates a signer with this secret key.
    #[must_use]
    pub fn new(secret: &[u8; 32]) -> Self {
        Self(SigningKey::from_bytes(secret))
    }

    /// Returns the public key that verifies its signatures, in hex.
    #[must_use]
    pub fn public_key(&self) -> String {
        hex(self.0.verifying_key().as_bytes())
    }

    /// Returns the bytes of the public key.
    #[must_use]
    pub fn public_bytes(&self) -> [u8; 32] {
        self.0.verifying_key().to_bytes()
    }

    /// Signs a text.
    #[must_use]
    pub fn sign_text(&self, text: &[u8]) -> [u8; 64] {
        self.0.sign(text).to_bytes()
    }

    /// Signs the canonical JSON of a receipt.
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

/// A receipt as the service returns it; clients can verify it without the service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ReceiptFile {
    /// Position in the public log, from 1.
    pub seq: i64,
    /// The receipt; null while it belongs to an open epoch of hidden evaluation.
    #[schema(value_type = Option<Object>)]
    pub receipt: Option<Value>,
    /// SHA-256 of the receipt's canonical JSON.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub hash: String,
    /// Ed25519 signature over the canonical JSON, in hex; null while the receipt is null.
    pub signature: Option<String>,
    /// Public key that verifies the signature, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub public_key: String,
    /// Link of the receipt before it; all zeros for the first receipt.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub previous: String,
    /// SHA-256 over the previous link and the receipt's hash.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub link: String,
    /// Ed25519 signature over position and link, in hex, for a receipt that is returned on its own. On a page of the
    /// log, the signed head covers all receipts instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(pattern = "^[0-9a-f]{128}$")]
    pub place_signature: Option<String>,
    /// Proof that the transparency log has the receipt, for a receipt that is returned on its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inclusion: Option<InclusionProof>,
}

/// Proof that the transparency log has a receipt (RFC 6962).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct InclusionProof {
    /// Number of entries of the log that the proof is about.
    #[schema(example = 1234)]
    pub size: u64,
    /// Hashes of the siblings from the leaf up, in hex. The leaf is SHA-256 over a zero byte and the receipt's hash.
    pub path: Vec<String>,
    /// Checkpoint of the log, as a signed note (C2SP tlog-checkpoint).
    pub checkpoint: String,
}

pub(super) fn must_be_trusted(public_key: &str, trusted: &[&str]) -> Result<(), ReceiptFault> {
    if trusted.contains(&public_key) {
        return Ok(());
    }
    Err(ReceiptFault::OtherKey { found: public_key.to_owned(), wanted: trusted.join(" or ") })
}

/// Verifies a signature over the canonical JSON of a value.
///
/// # Errors
/// Returns an error if the key or the signature cannot be read, or if the signature does not verify.
pub fn verify_signature(value: &Value, public_key: &str, signature: &str) -> Result<(), ReceiptFault> {
    let key = unhex(public_key).and_then(|bytes| VerifyingKey::from_bytes(&bytes).ok());
    let key = key.ok_or(ReceiptFault::Unreadable("public_key"))?;
    let signature = unhex(signature).ok_or(ReceiptFault::Unreadable("signature"))?;
    let verified = key.verify_strict(&canonical_json(value), &Signature::from_bytes(&signature));
    verified.map_err(|_bad| ReceiptFault::BadSignature)
}

/// Verifies the key, hash, signature and link of a receipt against the trusted public keys.
///
/// # Errors
/// Returns the first fault.
pub fn verify(file: &ReceiptFile, trusted: &[&str]) -> Result<(), ReceiptFault> {
    must_be_trusted(&file.public_key, trusted)?;
    let (receipt, signature) = match (&file.receipt, &file.signature) {
        (Some(receipt), Some(signature)) => (receipt, signature),
        // A body that nobody has signed is no receipt; only both together are withheld.
        (None, None) => return Err(ReceiptFault::Withheld),
        _ => return Err(ReceiptFault::Halved),
    };
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
            inclusion: None,
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
        for (receipt, signature) in [(good.receipt.clone(), None), (None, good.signature.clone())] {
            let halved = ReceiptFile { receipt, signature, ..good.clone() };
            assert_eq!(verify(&halved, &[&signer.public_key()]), Err(ReceiptFault::Halved));
        }
        let withheld = ReceiptFile { receipt: None, signature: None, ..good.clone() };
        assert_eq!(verify(&withheld, &[&signer.public_key()]), Err(ReceiptFault::Withheld));
        let mut cut = good.clone();
        cut.previous = hex(&[1; 32]);
        assert_eq!(verify(&cut, &[&signer.public_key()]), Err(ReceiptFault::BrokenLink(1)));
        assert!(!format!("{signer:?}").contains(&hex(&[5; 32])));
    }
}

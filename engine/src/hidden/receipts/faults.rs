//! What can be wrong with receipts and with the public log.

use std::fmt;

use super::ReceiptFile;

/// A fault of a receipt or of the public log.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReceiptFault {
    /// The receipt has not been released.
    #[error("the receipt is withheld until its epoch closes; until then the log has only its hash and link")]
    Withheld,
    /// The receipt has either no body or no signature.
    #[error("the receipt has its body or its signature, but not both: one was removed")]
    Halved,
    /// A member cannot be decoded.
    #[error("{0} is not hexadecimal of the right length")]
    Unreadable(&'static str),
    /// The signing key is not trusted.
    #[error(
        "signed with the key {found}, and not with {wanted}: if the operator replaced the key, get the new one from somebody whom you \
             trust, and give it with --key"
    )]
    OtherKey {
        /// Key of the signature.
        found: String,
        /// Trusted keys.
        wanted: String,
    },
    /// The hash does not belong to the receipt.
    #[error("the receipt has the hash {0}, which is not its hash in the log: the receipt was changed")]
    OtherHash(String),
    /// The signature does not verify.
    #[error("the signature does not verify: this key did not sign this content")]
    BadSignature,
    /// The key changed without an announcement in the log.
    #[error("receipt {0} has a different signing key from the receipt before it, but announces no change of the key")]
    UntoldKey(i64),
    /// The receipt's position in the log is not signed.
    #[error(
        "the position of receipt {0} in the log is not signed: fetch the receipt again, or give its log page and head"
    )]
    UnsignedPlace(i64),
    /// The signature over position and link does not verify.
    #[error("the signature over position {0} in the log does not verify: the position or the link was changed")]
    BadPlace(i64),
    /// The proof that the transparency log has the receipt does not hold.
    #[error("the proof that the transparency log has the receipt at position {0} does not hold")]
    BadInclusion(i64),
    /// The log has more or fewer receipts than its signed head states.
    #[error(
        "the log ends at receipt {found}, but its signed head states {signed}: receipts were cut off or added, \
             or more pages follow (`GET /v1/receipts?after={found}&limit=1000`)"
    )]
    OtherLength {
        /// Position of the last receipt present.
        found: i64,
        /// Number of receipts that the head states.
        signed: i64,
    },
    /// The log came without a signed head.
    #[error(
        "the log has no signed head, so nothing shows where it ends; `GET /v1/receipts` sends a head with each page"
    )]
    NoHead,
    /// The log does not start at its first receipt.
    #[error(
        "the log does not start at receipt 1, so what was announced before is not checked: give all of its pages (`GET \
             /v1/receipts?after=0&limit=1000`)"
    )]
    NoBeginning,
    /// Receipts are missing between others.
    #[error(
        "{} missing: give the pages with them (`GET /v1/receipts?after={}&limit=1000`); if the service does not have them, they \
             were removed",
        if from == to { format!("receipt {from} is") } else { format!("receipts {from} to {to} are") },
        from - 1
    )]
    Gap {
        /// Position of the first that is missing.
        from: i64,
        /// Position of the last that is missing.
        to: i64,
    },
    /// The link does not follow from the previous link.
    #[error("the link of receipt {0} does not follow from the previous link and the receipt's hash")]
    BrokenLink(i64),
}

/// Receipts whose key is not trusted. Nothing else may be wrong with them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OfOtherKey {
    /// Their key, in hex.
    pub key: String,
    /// Their number.
    pub count: usize,
    /// Position of the first.
    pub first: i64,
    /// Position of the last.
    pub last: i64,
}

impl fmt::Display for OfOtherKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, count, first, last } = self;
        match count {
            1 => write!(f, "receipt {first} is signed with the key {key}, which you do not trust")?,
            _ => write!(
                f,
                "{count} receipts, from {first} to {last}, are signed with the key {key}, which you do not trust"
            )?,
        }
        f.write_str(
            ": if the operator replaced the key, get the new key from somebody whom you trust, and give it with --key",
        )
    }
}

/// Lists the keys of receipts that are not trusted.
#[must_use]
pub fn of_other_keys<'a>(receipts: impl IntoIterator<Item = &'a ReceiptFile>, trusted: &[&str]) -> Vec<OfOtherKey> {
    let mut others: Vec<OfOtherKey> = Vec::new();
    for file in receipts.into_iter().filter(|file| !trusted.contains(&file.public_key.as_str())) {
        match others.iter_mut().find(|other| other.key == file.public_key) {
            None => others.push(OfOtherKey { key: file.public_key.clone(), count: 1, first: file.seq, last: file.seq }),
            Some(other) => {
                other.count += 1;
                (other.first, other.last) = (other.first.min(file.seq), other.last.max(file.seq));
            }
        }
    }
    others
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::hidden::receipts::tests::file;
    use crate::hidden::receipts::{FIRST_LINK, Signer};

    #[test]
    fn receipts_of_one_key_are_one_finding() {
        let (own, other) = (Signer::new(&[5; 32]), Signer::new(&[6; 32]));
        let at = |seq, signer| file(signer, seq, &FIRST_LINK, json!({ "submission": seq }));
        let receipts = [at(3, &other), at(1, &own), at(9, &other), at(4, &other)];
        let found = of_other_keys(&receipts, &[&own.public_key()]);
        let told: Vec<String> = found.iter().map(ToString::to_string).collect();
        let begins = format!("3 receipts, from 3 to 9, are signed with the key {}", other.public_key());
        assert!(told.len() == 1 && told[0].starts_with(&begins), "{told:?}");
        assert!(of_other_keys(&receipts[..1], &[])[0].to_string().starts_with("receipt 3 is signed with"));
        assert!(of_other_keys(&receipts, &[&own.public_key(), &other.public_key()]).is_empty());
    }
}

//! The public log of receipts: a chain of links with a signed end.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::{ReceiptFault, ReceiptFile, Signer, must_be_trusted, verify_signature};
use crate::hidden::canonical::{Hash, unhex};
use crate::hidden::tlog::note::Checkpoint;
use crate::hidden::tlog::proof::is_included;
use crate::hidden::tlog::tree::leaf;
use crate::tasks::hex;

/// The link before the first receipt: all zeros.
pub const FIRST_LINK: Hash = [0; 32];

/// Computes the link that follows `before` for a receipt with this hash.
#[must_use]
pub fn link(before: &Hash, receipt: &Hash) -> Hash {
    Sha256::new().chain_update(before).chain_update(receipt).finalize().into()
}

/// A page of the log.
#[derive(Debug, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = ReceiptPage)]
pub struct LogPage {
    /// Receipts in order, each linked to the one before it.
    pub receipts: Vec<ReceiptFile>,
    /// Value of `after` for the next page; null on the last page.
    pub next_after: Option<i64>,
    /// Signed end of the whole log at the time when this page was read. The last page ends there.
    #[serde(default)]
    pub head: Option<LogHead>,
}

/// The signed end of the log: the number of receipts and the last link, which covers all links before it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LogHead {
    /// Number of receipts in the log.
    pub size: i64,
    /// Last link of the log; all zeros if the log is empty.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub link: String,
    /// Time of signing, milliseconds since 1970.
    pub at_ms: i64,
    /// Public key that verifies the signature, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub public_key: String,
    /// Ed25519 signature, in hex, over the canonical JSON of
    /// `{"plumbline_log_head": 1, "size": …, "link": …, "at_ms": …}`.
    #[schema(pattern = "^[0-9a-f]{128}$")]
    pub signature: String,
}

impl LogHead {
    /// Creates and signs a head.
    #[must_use]
    pub fn signed(size: i64, link: String, at_ms: i64, signer: &Signer) -> Self {
        let signed = signer.sign(&head_text(size, &link, at_ms));
        Self { size, link, at_ms, public_key: signed.public_key, signature: signed.signature }
    }

    /// Verifies the signature against the trusted keys.
    ///
    /// # Errors
    /// Returns the first fault.
    pub fn verify(&self, trusted: &[&str]) -> Result<(), ReceiptFault> {
        must_be_trusted(&self.public_key, trusted)?;
        verify_signature(&head_text(self.size, &self.link, self.at_ms), &self.public_key, &self.signature)
    }
}

fn head_text(size: i64, link: &str, at_ms: i64) -> Value {
    json!({ "plumbline_log_head": 1, "size": size, "link": link, "at_ms": at_ms })
}

fn place_text(seq: i64, link: &str) -> Value {
    json!({ "plumbline_log_place": 1, "seq": seq, "link": link })
}

impl ReceiptFile {
    /// Adds a signature over position and link, for a receipt that is returned on its own; none if there is no signer.
    #[must_use]
    pub fn with_place(mut self, signer: Option<&Signer>) -> Self {
        self.place_signature = signer.map(|signer| signer.sign(&place_text(self.seq, &self.link)).signature);
        self
    }

    /// Verifies the signature over position and link. Any of the trusted keys may have made it, because the key may
    /// have changed since the receipt was signed.
    ///
    /// # Errors
    /// Returns an error if the receipt has no such signature, or if it does not verify.
    pub fn verify_place(&self, trusted: &[&str]) -> Result<(), ReceiptFault> {
        let signature = self.place_signature.as_ref().ok_or(ReceiptFault::UnsignedPlace(self.seq))?;
        let text = place_text(self.seq, &self.link);
        let verifies = trusted.iter().any(|key| verify_signature(&text, key, signature).is_ok());
        if verifies { Ok(()) } else { Err(ReceiptFault::BadPlace(self.seq)) }
    }
}

impl ReceiptFile {
    /// Verifies the proof that the transparency log has the receipt at its place. Any of the trusted keys may have
    /// signed the checkpoint. Returns the checkpoint.
    ///
    /// # Errors
    /// Returns an error if the receipt has no proof, or if it does not hold.
    pub fn verify_inclusion(&self, trusted: &[&str]) -> Result<Checkpoint, ReceiptFault> {
        let bad = || ReceiptFault::BadInclusion(self.seq);
        let proof = self.inclusion.as_ref().ok_or_else(bad)?;
        let checkpoint = Checkpoint::verified(&proof.checkpoint, trusted).ok_or_else(bad)?;
        let path: Option<Vec<Hash>> = proof.path.iter().map(|hash| unhex(hash)).collect();
        let entry: Hash = unhex(&self.hash).ok_or(ReceiptFault::Unreadable("hash"))?;
        let index = self.seq.checked_sub(1).and_then(|index| u64::try_from(index).ok());
        let (Some(path), Some(index)) = (path, index) else { return Err(bad()) };
        let holds = proof.size == checkpoint.size
            && is_included(&leaf(&entry), index, checkpoint.size, &path, &checkpoint.root);
        if holds { Ok(checkpoint) } else { Err(bad()) }
    }
}

/// Checks that each entry of the log has the key of the entry before it or announces the change of the key itself.
/// After a gap nothing is known of the entry before; [`verify_chain`] reports the gap.
///
/// # Errors
/// Returns an error for the first entry that does neither.
pub fn verify_keys<'a>(log: impl IntoIterator<Item = &'a ReceiptFile>) -> Result<(), ReceiptFault> {
    let mut last: Option<(i64, &str)> = None;
    for file in log {
        let is_told = |before: &str| {
            let change = file.receipt.as_ref().and_then(|receipt| receipt.get("key_change"));
            change.is_some_and(|change| change["before"] == before && change["now"] == file.public_key.as_str())
        };
        let before = last.filter(|(seq, _)| seq.checked_add(1) == Some(file.seq));
        if before.is_some_and(|(_, key)| key != file.public_key && !is_told(key)) {
            return Err(ReceiptFault::UntoldKey(file.seq));
        }
        last = Some((file.seq, &file.public_key));
    }
    Ok(())
}

/// Lists the gaps between the entries of the log, in order.
#[must_use]
pub fn gaps(log: &[&ReceiptFile]) -> Vec<ReceiptFault> {
    let between = |pair: &[&ReceiptFile]| {
        let (from, to) = (pair[0].seq.checked_add(1)?, pair[1].seq.checked_sub(1)?);
        (from <= to).then_some(ReceiptFault::Gap { from, to })
    };
    log.windows(2).filter_map(between).collect()
}

/// Checks that the entries of the log, in order, form a chain, and returns their number.
///
/// # Errors
/// Returns an error for the first gap, or the first link that cannot be read or does not follow from the one before it.
pub fn verify_chain<'a>(log: impl IntoIterator<Item = &'a ReceiptFile>) -> Result<usize, ReceiptFault> {
    let mut last: Option<(i64, &str)> = None;
    let mut count = 0;
    for file in log {
        let previous: Hash = unhex(&file.previous).ok_or(ReceiptFault::Unreadable("previous"))?;
        let hash: Hash = unhex(&file.hash).ok_or(ReceiptFault::Unreadable("hash"))?;
        let starts = (file.seq == 1) == (previous == FIRST_LINK) && file.seq > 0;
        if let Some((seq, link)) = last.filter(|(seq, _)| seq.checked_add(1).is_some_and(|next| next < file.seq))
            && link != file.previous
        {
            return Err(ReceiptFault::Gap { from: seq + 1, to: file.seq - 1 });
        }
        let follows = last.is_none_or(|(seq, link)| link == file.previous && seq.checked_add(1) == Some(file.seq));
        if !starts || !follows || hex(&link(&previous, &hash)) != file.link {
            return Err(ReceiptFault::BrokenLink(file.seq));
        }
        last = Some((file.seq, &file.link));
        count += 1;
    }
    Ok(count)
}

/// Checks that a log, whose entries form a chain, ends where its signed head states.
///
/// # Errors
/// Returns an error if the head does not verify, or if the log ends at another position or link.
pub fn verify_end(log: &[&ReceiptFile], head: &LogHead, trusted: &[&str]) -> Result<(), ReceiptFault> {
    head.verify(trusted)?;
    let (seq, link) = log.last().map_or((0, hex(&FIRST_LINK)), |last| (last.seq, last.link.clone()));
    if seq != head.size {
        return Err(ReceiptFault::OtherLength { found: seq, signed: head.size });
    }
    if link == head.link { Ok(()) } else { Err(ReceiptFault::BrokenLink(seq)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::receipts::tests::file;
    use crate::hidden::receipts::{key_change, verify};

    #[test]
    fn a_key_changes_only_where_the_log_says_so() {
        let (old, new) = (Signer::new(&[5; 32]), Signer::new(&[6; 32]));
        let first = file(&old, 1, &FIRST_LINK, json!({ "submission": 1 }));
        let told = key_change(&old.public_key(), &new.public_key(), 3);
        let change = file(&new, 2, &unhex(&first.link).unwrap(), told);
        let after = file(&new, 3, &unhex(&change.link).unwrap(), json!({ "submission": 2 }));
        assert_eq!(verify_keys([&first, &change, &after]), Ok(()));
        let untold = file(&new, 2, &unhex(&first.link).unwrap(), json!({ "submission": 2 }));
        assert_eq!(verify_keys([&first, &untold]), Err(ReceiptFault::UntoldKey(2)));
        assert_eq!(verify_keys([&first, &after]), Ok(()), "the page between them may tell");
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
        assert_eq!(verify_chain([&log[0], &log[3]]), Err(ReceiptFault::Gap { from: 2, to: 3 }));
        let told = ReceiptFault::Gap { from: 2, to: 3 }.to_string();
        assert!(told.contains("`GET /v1/receipts?after=1&limit=1000`"), "{told}");
        assert_eq!(gaps(&[&log[0], &log[3]]), [ReceiptFault::Gap { from: 2, to: 3 }]);
        assert_eq!(gaps(&[&log[0], &log[1]]), []);
        let last = ReceiptFile { seq: i64::MAX, ..log[3].clone() };
        assert!(verify_chain([&last, &last]).is_err() && verify_keys([&last, &last]).is_ok());
        assert_eq!(gaps(&[&last, &last]), []);
        let mut moved = log[1].clone();
        moved.seq = 3;
        assert_eq!(verify_chain([&log[0], &moved]), Err(ReceiptFault::BrokenLink(3)), "another position");
    }

    #[test]
    fn a_cut_tail_and_a_changed_place_show() {
        let signer = Signer::new(&[5; 32]);
        let (key, first) =
            (signer.public_key(), file(&Signer::new(&[5; 32]), 1, &FIRST_LINK, json!({ "submission": 1 })));
        let second = file(&signer, 2, &unhex(&first.link).unwrap(), json!({ "submission": 2 }));
        let head = LogHead::signed(2, second.link.clone(), 7, &signer);
        assert_eq!(verify_end(&[&first, &second], &head, &[&key]), Ok(()));
        let cut = ReceiptFault::OtherLength { found: 1, signed: 2 };
        assert_eq!(verify_end(&[&first], &head, &[&key]), Err(cut));
        let shorter = LogHead { size: 1, link: first.link.clone(), ..head };
        assert_eq!(verify_end(&[&first], &shorter, &[&key]), Err(ReceiptFault::BadSignature));
        let mut alone = second.with_place(Some(&signer));
        assert_eq!(alone.verify_place(&[&key]), Ok(()));
        alone.seq = 3;
        assert_eq!(alone.verify_place(&[&key]), Err(ReceiptFault::BadPlace(3)));
        alone.place_signature = None;
        assert_eq!(alone.verify_place(&[&key]), Err(ReceiptFault::UnsignedPlace(3)));
    }
}

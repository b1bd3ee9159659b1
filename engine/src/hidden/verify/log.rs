//! Compares the receipts of a reveal with the public log and with the receipts that entrants received.

use std::collections::{BTreeMap, BTreeSet};

use super::{Kept, Verified};
use crate::hidden::canonical::canonical_json;
use crate::hidden::evidence::fact;
use crate::hidden::receipts::{
    LogHead, ReceiptFault, ReceiptFile, gaps, of_other_keys, verify, verify_chain, verify_end, verify_keys,
    verify_signature,
};
use crate::tasks::hex;
use crate::text::counted;
use sha2::{Digest as _, Sha256};

/// Returns the public keys to trust: the key in the epoch's commitment and the keys given to the verifier. A change of
/// the key announced in the log is not trusted, because the writer of the log can announce any key.
pub(super) fn trusted(committed: &str, kept: &Kept) -> BTreeSet<String> {
    kept.keys.iter().cloned().chain([committed.to_owned()]).collect()
}

/// Checks that every receipt of the reveal belongs to this epoch, verifies, and appears only once.
pub(super) fn signatures(epoch: &str, receipts: &[ReceiptFile], trusted: &[&str], found: &mut Verified) {
    let (mut places, mut hashes) = (BTreeSet::new(), BTreeSet::new());
    for others in of_other_keys(receipts, trusted) {
        found.breach("receipts", others.to_string());
    }
    for file in receipts {
        let place = || format!("receipt {}", file.seq);
        match verify(file, trusted) {
            Ok(()) | Err(ReceiptFault::OtherKey { .. }) => {}
            Err(fault) => found.breach(place(), fault.to_string()),
        }
        if file.receipt.as_ref().is_none_or(|receipt| receipt["epoch"] != epoch) {
            found.breach(place(), "does not belong to this epoch");
        }
        if file.seq < 1 {
            found.breach(place(), "has no valid position in the log, which starts at 1");
        }
        if !places.insert(file.seq) || !hashes.insert(&file.hash) {
            found.breach(place(), "appears twice in the reveal");
        }
    }
}

/// Checks that the log is complete, that all kept copies of it agree, and that it has exactly the revealed receipts of
/// the epoch.
pub(super) fn against_log(epoch: &str, receipts: &[ReceiptFile], kept: &Kept, trusted: &[&str], found: &mut Verified) {
    if kept.log.is_empty() {
        return without_log(receipts, &kept.heads, trusted, found);
    }
    let mut log: BTreeMap<i64, &ReceiptFile> = BTreeMap::new();
    for file in &kept.log {
        let known = log.entry(file.seq).or_insert(file);
        if (&known.link, &known.hash, &known.public_key) != (&file.link, &file.hash, &file.public_key) {
            found.breach(
                format!("receipt {} of the log", file.seq),
                "differs between the given pages: the log was rewritten",
            );
        } else if known.receipt.is_none() {
            *known = file;
        }
    }
    let log: Vec<&ReceiptFile> = log.into_values().collect();
    let mut faults = match verify_chain(log.iter().copied()) {
        Ok(_) => Vec::new(),
        Err(ReceiptFault::Gap { .. }) => gaps(&log),
        Err(fault) => vec![fault],
    };
    faults.extend(verify_keys(log.iter().copied()).err());
    faults.extend(log.first().filter(|first| first.seq != 1).map(|_| ReceiptFault::NoBeginning));
    for fault in faults {
        found.breach("log", fault.to_string());
    }
    let mut told = BTreeSet::new();
    for file in &kept.log {
        // Only the epoch's own receipts need a trusted key; others may be older than the key in the epoch's commitment.
        match verify(file, &[&file.public_key]) {
            Ok(()) | Err(ReceiptFault::Withheld) => {}
            Err(fault) if told.insert((file.seq, fault.to_string())) => {
                found.breach(format!("receipt {} of the log", file.seq), fault.to_string());
            }
            Err(_) => {}
        }
    }
    let greatest = kept.heads.iter().max_by_key(|head| head.size);
    match greatest {
        None => found.breach("log", ReceiptFault::NoHead.to_string()),
        Some(head) => {
            if let Err(fault) = verify_end(&log, head, trusted) {
                found.breach("log", fault.to_string());
            }
        }
    }
    for head in &kept.heads {
        let link = log.iter().find(|file| file.seq == head.size).map(|file| file.link.as_str());
        let place = format!("head of {} receipts", head.size);
        if link.is_some_and(|link| link != head.link) {
            found.breach(place, "belongs to another log: the log was rewritten");
        } else if greatest.is_some_and(|greatest| greatest == head) {
            // Verified above.
        } else if !trusted.contains(&head.public_key.as_str()) {
            found
                .unchecked
                .push(format!("{place}: signed with the untrusted key {}; trust it with --key", head.public_key));
        } else if let Err(fault) = head.verify(trusted) {
            found.breach(place, fault.to_string());
        }
    }
    let revealed: BTreeMap<i64, &ReceiptFile> = receipts.iter().map(|file| (file.seq, file)).collect();
    for file in &log {
        let is_of_epoch = file.receipt.as_ref().is_some_and(|receipt| receipt["epoch"] == epoch);
        match revealed.get(&file.seq) {
            None if is_of_epoch => {
                found.breach(format!("receipt {} of the log", file.seq), "is missing from the reveal");
            }
            Some(own) if own.hash != file.hash || own.link != file.link => {
                found.breach(format!("receipt {}", file.seq), "is not the one at this position in the log");
            }
            _ => {}
        }
    }
    let end = receipts.iter().map(|file| file.seq).max().unwrap_or(0);
    let withheld =
        log.iter().filter(|file| file.receipt.is_none() && file.seq < end && !revealed.contains_key(&file.seq));
    let withheld = withheld.count();
    if withheld > 0 {
        found.unchecked.push(format!(
            "{withheld} receipts in the log before this epoch's last: their bodies are withheld, as in open epochs; \
             fetch the log again when no epoch is open: if bodies are still withheld, something is hidden"
        ));
    }
    if greatest.is_none_or(|head| log.last().is_some_and(|last| last.seq >= head.size)) {
        younger(receipts, &log, found);
    }
}

/// Says what is known of a log without receipts: nothing was given, or its signed end is that of another time.
fn without_log(receipts: &[ReceiptFile], heads: &[LogHead], trusted: &[&str], found: &mut Verified) {
    let Some(head) = heads.iter().max_by_key(|head| head.size) else {
        let why = "receipts against the public log: no log pages were given (--receipts)";
        found.unchecked.push(why.to_owned());
        return;
    };
    if let Err(fault) = head.verify(trusted) {
        found.breach("log", fault.to_string());
    }
    if head.size > 0 {
        let states = counted(head.size, "receipt");
        found.breach("log", format!("its signed end states {states}, but the pages have none"));
    } else if !receipts.is_empty() {
        let has = counted(receipts.len(), "receipt");
        found.breach("log", format!("is empty, but the reveal has {has} of it: {SAVE_ALL}"));
    }
}

/// What to do about pages of the log that are missing.
const SAVE_ALL: &str =
    "if you did not save all of its pages, do so, from /v1/receipts?after=0 until next_after is null";

/// Reports the receipts of the epoch that come after the pages of the log. Those before them and in gaps between them were
/// reported with what is missing of the log.
fn younger(receipts: &[ReceiptFile], log: &[&ReceiptFile], found: &mut Verified) {
    let last = log.last().map_or(0, |file| file.seq);
    let mut younger: Vec<i64> = receipts.iter().map(|file| file.seq).filter(|seq| *seq > last).collect();
    younger.sort_unstable();
    let told = match younger.as_slice() {
        [] => return,
        [one] => format!("receipt {one} of the epoch is"),
        [first, .., end] => format!("{} receipts of the epoch, from {first} to {end}, are", younger.len()),
    };
    found.breach("log", format!("{told} after the pages of the log that were given: {SAVE_ALL}"));
}

/// Checks that the reveal contains the receipts that entrants received.
pub(super) fn given(epoch: &str, receipts: &[ReceiptFile], kept: &Kept, trusted: &[&str], found: &mut Verified) {
    let revealed: BTreeSet<&str> = receipts.iter().map(|file| file.hash.as_str()).collect();
    for given in &kept.given {
        let hash = hex(&Sha256::digest(canonical_json(&given.receipt)));
        let what = fact(&given.receipt).map(|fact| format!(" ({fact})")).unwrap_or_default();
        let place = format!("given receipt {}…{what}", &hash[..12]);
        if given.receipt["epoch"] != epoch {
            found.unchecked.push(format!("{place}: belongs to another epoch"));
        } else if verify_signature(&given.receipt, &given.public_key, &given.signature).is_err() {
            found.breach(place, "has no valid signature");
        } else if !trusted.contains(&given.public_key.as_str()) {
            let key = &given.public_key;
            found.breach(place, format!("is signed with {key}, which is no key of this epoch; trust it with --key"));
        } else if !revealed.contains(hash.as_str()) {
            found.breach(place, "is missing from the reveal");
        }
    }
}

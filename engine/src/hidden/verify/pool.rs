//! Checks the pool of an epoch that is bound to a beacon: it derives from the committed round, and was published once.

use std::collections::BTreeSet;

use super::times::SLACK_MS;
use super::{Kept, Verified};
use crate::hidden::FIRST_WITH_KEPT_PART;
use crate::hidden::announcements::{Announcement, EpochFact, announcement};
use crate::hidden::beacon::{Beacon, BoundPool};
use crate::hidden::commitment::Commitment;
use crate::hidden::evidence::{Fact, fact};
use crate::hidden::feedback::Tier;
use crate::hidden::receipts::ReceiptFile;
use crate::hidden::reveal::Reveal;
use crate::hidden::secret::EpochKey;

/// Time after the round at which a pool should be published.
const LATE_MS: i64 = 10 * 60_000;

/// Returns the key that the pool derives from; `None` if the reveal has no pool, or one of another round.
pub(super) fn key_of(
    reveal: &Reveal,
    commitment: &Commitment,
    kept: &Kept,
    key: &EpochKey,
    found: &mut Verified,
) -> Option<EpochKey> {
    if kept.pool.is_some() && kept.pool != reveal.pool {
        found.breach("pool", "the revealed one is not the one that was published after the round");
    }
    let (beacon, pool) = match (&commitment.beacon, &reveal.pool) {
        (None, None) => return Some(key.clone()),
        (None, Some(_)) => {
            found.breach("pool", "the epoch is bound to no beacon, but the reveal has a pool of one");
            return Some(key.clone());
        }
        (Some(_), None) => {
            found
                .unchecked
                .push("the pool: the beacon's round was not brought before the end, so nothing was drawn".to_owned());
            if !reveal.specifications.is_empty() {
                found.breach("pool", "the reveal has specifications, but not the round that they derive from");
            }
            return None;
        }
        (Some(beacon), Some(pool)) => (beacon, pool),
    };
    if !beacon.is_first_from(commitment.opens_at_ms) {
        found.breach("pool", "the committed round is not the first from the opening of the epoch on");
    }
    let late_ms = pool.made_at_ms.saturating_sub(beacon.emitted_at_ms());
    if late_ms > LATE_MS {
        let minutes = late_ms / 60_000;
        found.unchecked.push(format!(
            "the pool: it was published {minutes} minutes after its round, so who has the key could know it for as long"
        ));
    }
    if commitment.root.is_some() {
        found.breach("root", "was committed to before the round, from which it derives");
    }
    if pool.epoch != commitment.epoch {
        found.breach("pool", format!("belongs to the epoch {:?}", pool.epoch));
    }
    if pool.made_at_ms.saturating_add(SLACK_MS) < beacon.emitted_at_ms() {
        found.breach("pool", "was made before the round was emitted");
    }
    if !beacon.is_public() {
        let why = format!(
            "the beacon: {} is not quicknet; whether its servers told a round before its time",
            beacon.chain_hash
        );
        found.unchecked.push(why);
    }
    match beacon.randomness(&pool.round()) {
        Ok(randomness) => Some(beacon.pool_key(key, &randomness)),
        Err(fault) => {
            found.breach("pool", fault.to_string());
            None
        }
    }
}

/// Checks that the log announces the epoch as committed, and the pool of a beacon before the epoch's own receipts.
pub(super) fn announced(reveal: &Reveal, commitment: &Commitment, kept: &Kept, trusted: &[&str], found: &mut Verified) {
    let own = |file: &ReceiptFile| {
        let told = announcement(file.receipt.as_ref()?)?;
        let is_own = match &told {
            Announcement::Epoch(EpochFact { commitment: told, .. }) => told.epoch == commitment.epoch,
            Announcement::Pool(pool) => pool.epoch == commitment.epoch,
            Announcement::BoardAction(_) => false,
        };
        is_own.then_some((file.seq, told))
    };
    for file in kept.log.iter().filter(|file| own(file).is_some() && !trusted.contains(&file.public_key.as_str())) {
        found.breach(format!("receipt {} of the log", file.seq), "announces the epoch with a key that is not trusted");
    }
    let told: Vec<(i64, Announcement)> = kept.log.iter().filter_map(own).collect();
    for (seq, announcement) in &told {
        let is_same = match announcement {
            Announcement::Epoch(fact) => *fact.commitment == *commitment,
            Announcement::Pool(pool) => Some(pool) == reveal.pool.as_ref(),
            Announcement::BoardAction(_) => true,
        };
        if !is_same {
            found.breach(format!("receipt {seq} of the log"), "announces something other than the reveal has");
        }
    }
    let Some(first) = kept.log.iter().map(|file| file.seq).min() else { return };
    if first > 1 {
        let why = format!("announcements in the log: the pages that were given begin with receipt {first}");
        found.unchecked.push(why);
        return;
    }
    let place =
        |is_it: fn(&Announcement) -> bool| told.iter().filter(|(_, told)| is_it(told)).map(|(seq, _)| *seq).min();
    let own = reveal.receipts.iter().flatten().map(|file| file.seq).min();
    let Some(epoch) = place(|told| matches!(told, Announcement::Epoch(_))) else {
        not_announced(commitment, kept, own, found);
        return;
    };
    if let Some(own) = own.filter(|own| *own < epoch) {
        let why = format!("announces the epoch after receipt {own}, which is one of the epoch");
        found.breach(format!("receipt {epoch} of the log"), why);
    }
    let Some(beacon) = &commitment.beacon else { return };
    let pool = place(|told| matches!(told, Announcement::Pool(_)));
    in_order(epoch, pool, beacon, reveal.pool.as_ref(), &told, found);
    // An official entry is in the log before the pool: its time alone could be written back.
    let is_official = |file: &&ReceiptFile| {
        let told = file.receipt.as_ref().and_then(fact);
        matches!(told, Some(Fact::Entry(entry)) if entry.tier == Tier::Official)
    };
    let late = reveal.receipts.iter().flatten().filter(|file| pool.is_some_and(|pool| file.seq > pool));
    for file in late.filter(is_official) {
        found
            .breach(format!("receipt {}", file.seq), "registers an official entry, but entered the log after the pool");
    }
}

/// Says that no announcement of the epoch can be read; `own` is the place of the epoch's first receipt. Pages that are missing
/// before it are reported with the log.
fn not_announced(commitment: &Commitment, kept: &Kept, own: Option<i64>, found: &mut Verified) {
    let is_before = |seq: &i64| *seq >= 1 && own.is_none_or(|own| *seq < own);
    let before: BTreeSet<i64> = kept.log.iter().map(|file| file.seq).filter(is_before).collect();
    let last = own.map_or_else(|| before.last().copied().unwrap_or(0), |own| own.saturating_sub(1));
    if i64::try_from(before.len()) != Ok(last) {
        return;
    }
    // Epochs of the first protocol may be older than announcements.
    if commitment.beacon.is_some() || commitment.protocol() >= FIRST_WITH_KEPT_PART {
        found.breach("log", "does not announce the epoch, or withholds the announcement, which is public at once");
    } else {
        found.unchecked.push(
            "the announcement of the epoch: the log has none; an epoch of the first protocol may be older".to_owned(),
        );
    }
}

/// Checks that the epoch was announced before the round, and the pool after it.
fn in_order(
    epoch: i64,
    pool: Option<i64>,
    beacon: &Beacon,
    made: Option<&BoundPool>,
    told: &[(i64, Announcement)],
    found: &mut Verified,
) {
    let late = told.iter().any(|(_, told)| match told {
        Announcement::Epoch(fact) => fact.committed_at_ms >= beacon.emitted_at_ms(),
        _ => false,
    });
    if late {
        found.breach(format!("receipt {epoch} of the log"), "announces the epoch after the round was emitted");
    }
    match (pool, made) {
        (None, Some(_)) => found.breach("log", "does not announce the pool"),
        (Some(pool), _) if pool < epoch => {
            found.breach(format!("receipt {pool} of the log"), "announces the pool before the epoch");
        }
        _ => {}
    }
}

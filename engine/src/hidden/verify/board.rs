//! Recomputes the boards of an epoch from its reveal.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use super::{Kept, Verified};
use crate::hidden::board::{Answered, BoardRules, Entrant, Row, rows};
use crate::hidden::commitment::Commitment;
use crate::hidden::feedback::{Feedback, Tier};
use crate::hidden::reveal::Reveal;
use crate::hidden::secret::EpochKey;
use crate::tasks::hex;
use crate::text::{agreeing, counted};

/// Computes the rows of a tier from the reveal.
fn made(reveal: &Reveal, commitment: &Commitment, key: &EpochKey, tier: Tier) -> Vec<Row> {
    let mut instances: BTreeMap<&str, Vec<Answered>> = BTreeMap::new();
    for instance in &reveal.instances {
        instances.entry(&instance.entry).or_default().push(Answered {
            salt: hex(&key.derive("receipt", &[instance.id.as_bytes()])),
            family: instance.family.clone(),
            run: instance.run,
            is_sibling: commitment.is_sibling(instance.leaf),
            passes: instance.overall == Some(true),
            is_answered: instance.log_sha256.is_some(),
            has_transcript: instance.transcript_sha256.is_some(),
            is_checked: instance.transcript_checked,
        });
    }
    if commitment.beacon.is_some() && reveal.pool.is_none() {
        return Vec::new();
    }
    let own = reveal.entries.iter().filter(|entry| entry.tier == tier);
    let entrants = own.map(|entry| Entrant {
        id: entry.id.clone(),
        owner: entry.owner.clone().unwrap_or_default(),
        agent: entry.agent.clone(),
        configuration_sha256: entry.configuration_hash.clone(),
        runs: entry.runs,
        completed_at_ms: entry.completed_at_ms,
        instances: instances.remove(entry.id.as_str()).unwrap_or_default(),
    });
    rows(&BoardRules::of(commitment, tier, true), entrants.collect())
}

/// Recomputes the boards that the service shows and compares them.
pub(super) fn check(reveal: &Reveal, commitment: &Commitment, key: &EpochKey, kept: &Kept, found: &mut Verified) {
    if reveal.entries.iter().any(|entry| entry.owner.is_none()) {
        found.unchecked.push("boards: an older program made the reveal, which does not name owners".to_owned());
        return;
    }
    for board in &kept.boards {
        let tier = Tier::ALL.into_iter().find(|tier| board["tier"] == tier.name());
        let (Some(tier), Ok(rows)) = (tier, serde_json::from_value::<Vec<Row>>(board["rows"].clone())) else {
            found.breach("board", "is not a response of GET /v1/epochs/NAME/leaderboard");
            continue;
        };
        let place = format!("board of the {} tier", tier.name());
        if let Some(filter) = board["provenance"].as_str() {
            found.breach(place, format!("has the rows of provenance {filter} alone; fetch it without that parameter"));
            continue;
        }
        if board["epoch"] != commitment.epoch.as_str() {
            found.breach(place, "belongs to another epoch");
            continue;
        }
        let early = match (board["is_released"] == true, commitment.protocol() < 2 || board["is_final"] == true) {
            (false, _) => Some("before its scores were released"),
            (true, false) => Some("before it was final"),
            (true, true) => None,
        };
        if let Some(early) = early {
            match contradiction(reveal, commitment, board, tier, &rows) {
                Some(what) => found.breach(place, what),
                None if kept.boards_follow_reveal => {
                    found.breach(place, "is not final, though the service had published the reveal when it was fetched");
                }
                // It has no signature, so nothing shows when the service sent it.
                None => found.unchecked.push(format!(
                    "{place}: was fetched {early}; fetch it again: a service that has published the reveal has the final board too"
                )),
            }
            continue;
        }
        let made = made(reveal, commitment, key, tier);
        let registered = reveal.entries.iter().filter(|entry| entry.tier == tier).count();
        if board["registered"].as_u64() != Some(registered as u64) {
            found.breach(
                place,
                format!("shows {} registered entries, but the reveal has {registered}", board["registered"]),
            );
            continue;
        }
        if rows.len() != made.len() {
            found.breach(place, format!("has {}, but the reveal gives {}", counted(rows.len(), "row"), made.len()));
            continue;
        }
        match rows.iter().zip(&made).find(|(shown, made)| shown != made) {
            None => found.boards += 1,
            Some((shown, made)) => {
                let detail = format!(
                    "its first differing row is that of agent {:?} of {:?}: {}",
                    shown.agent,
                    shown.owner,
                    differences(shown, made)
                );
                found.breach(place, detail);
            }
        }
    }
}

/// Describes a claim of a board that was true at no time before the end; `None` if there is none.
fn contradiction(reveal: &Reveal, commitment: &Commitment, board: &Value, tier: Tier, rows: &[Row]) -> Option<String> {
    let own = || reveal.entries.iter().filter(|entry| entry.tier == tier);
    let is_entered = |row: &Row| {
        let of_row = || own().filter(|entry| entry.owner.as_deref().unwrap_or_default() == row.owner);
        let has = |id: &String| of_row().any(|entry| entry.id == *id);
        of_row().any(|entry| entry.agent == row.agent && entry.configuration_hash == row.configuration_sha256)
            && row.entries.iter().all(has)
    };
    if commitment.protocol() >= 2 {
        let (Some(is_released), Some(is_final)) = (board["is_released"].as_bool(), board["is_final"].as_bool()) else {
            return Some("does not say whether it is released and final".to_owned());
        };
        // Scores that are told only after the epoch are released with the final board.
        let is_told_at_end = tier.feedback(commitment.dev_feedback) == Feedback::AfterEpoch;
        if is_released != is_final && (is_final || is_told_at_end) {
            let told = |is: bool| if is { "is" } else { "is not" };
            let what = format!(
                "says that it {} released and {} final, which no board ever is",
                told(is_released),
                told(is_final)
            );
            return Some(what);
        }
    }
    if board["is_released"] == false && !rows.is_empty() {
        return Some("has rows, although it says that its scores are not released".to_owned());
    }
    let Some(registered) = board["registered"].as_u64() else {
        return Some("does not say how many entries are registered".to_owned());
    };
    if registered > own().count() as u64 {
        let entries = agreeing(registered, "registered entry", "registered entries");
        return Some(format!("shows {entries}, but the reveal has {}", own().count()));
    }
    if let Some(stranger) = rows.iter().find(|row| !is_entered(row)) {
        let Row { agent, owner, .. } = stranger;
        return Some(format!("has a row of agent {agent:?} of {owner:?}, whose entries the reveal does not have"));
    }
    let mut owners = BTreeSet::new();
    rows.iter().find_map(|row| {
        let impossible = if owners.insert(&row.owner) {
            exceeds(reveal, commitment, tier, row)?
        } else {
            "is not the only row of its owner".to_owned()
        };
        Some(format!("has a row of agent {:?} of {:?} that {impossible}", row.agent, row.owner))
    })
}

/// Returns which number of a row is greater than the reveal allows at any time.
fn exceeds(reveal: &Reveal, commitment: &Commitment, tier: Tier, row: &Row) -> Option<String> {
    let own = || reveal.entries.iter().filter(|entry| row.entries.contains(&entry.id));
    let by_owner = reveal.entries.iter().filter(|entry| entry.tier == tier && entry.owner.as_ref() == Some(&row.owner));
    let instances = own().map(|entry| u64::from(entry.runs) * u64::from(commitment.instances_per_run)).sum();
    let is_own = |id: &String| own().any(|entry| entry.id == *id);
    let passing = reveal.instances.iter().filter(|own| own.overall == Some(true) && is_own(&own.entry)).count();
    let bounds = [
        ("attempts", row.attempts as u64, by_owner.count() as u64),
        ("instances", u64::from(row.of), instances),
        ("passes", u64::from(row.passed), passing as u64),
    ];
    let (name, shown, most) = bounds.into_iter().find(|(_, shown, most)| shown > most)?;
    Some(format!("has {name}: {shown}, where the reveal allows {most} at most"))
}

/// Lists the members in which a shown row differs from the one that the reveal gives.
fn differences(shown: &Row, made: &Row) -> String {
    let value = |row: &Row| serde_json::to_value(row).expect("a row has text keys alone");
    let (shown, made) = (value(shown), value(made));
    let names = shown.as_object().into_iter().chain(made.as_object()).flat_map(serde_json::Map::keys);
    let names: BTreeSet<&String> = names.collect();
    let differing = names.into_iter().filter(|name| shown[name.as_str()] != made[name.as_str()]);
    let told: Vec<String> =
        differing.map(|name| format!("{name} is {}, the reveal gives {}", shown[name], made[name])).collect();
    told.join("; ")
}

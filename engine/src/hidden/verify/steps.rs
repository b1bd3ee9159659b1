//! Compares every entry, draw, answer, grade and failure of a reveal with the receipt that was signed when it happened.

use std::collections::{BTreeMap, BTreeSet};

use super::issued::Issued;
use super::stated::Stated;
use super::{Kept, Verified, log, places, pool, times};
use crate::hidden::commitment::{Commitment, Rules};
use crate::hidden::draw_proof::{DrawMessage, verify};
use crate::hidden::evidence::{DrawFact, EntryFact, Fact, fact, prompts_hash};
use crate::hidden::feedback::Tier;
use crate::hidden::receipts::ReceiptFile;
use crate::hidden::reveal::{Reveal, RevealedEntry, RevealedInstance};
use crate::hidden::{FIRST_WITH_KEPT_PART, FIRST_WITH_PROMPTS};
use crate::text::{agreeing, counted};

/// Compares a reveal with its receipts.
pub(super) fn check(reveal: &Reveal, commitment: &Commitment, kept: &Kept, issued: &Issued<'_>, found: &mut Verified) {
    let receipts = reveal.receipts.as_deref().unwrap_or_default();
    let Some(rules) = &commitment.rules else {
        let why = "steps against receipts: an older program announced the epoch, and it issued no receipts";
        found.unchecked.push(why.to_owned());
        // Receipts may have been issued after an upgrade of the program; the reveal must contain those.
        let keys: Vec<&str> = kept.keys.iter().map(String::as_str).collect();
        let own = receipts
            .iter()
            .map(|file| file.public_key.as_str())
            .chain(kept.given.iter().map(|own| own.public_key.as_str()));
        let trusted: Vec<&str> = if keys.is_empty() { own.collect() } else { keys };
        log::given(&commitment.epoch, receipts, kept, &trusted, found);
        return;
    };
    if reveal.receipts.is_none() {
        found.breach("receipts", "are missing from the reveal");
        return;
    }
    let trusted = log::trusted(&rules.receipt_key, kept);
    let trusted: Vec<&str> = trusted.iter().map(String::as_str).collect();
    let before = found.breaches.len();
    log::signatures(&commitment.epoch, receipts, &trusted, found);
    log::against_log(&commitment.epoch, receipts, kept, &trusted, found);
    log::given(&commitment.epoch, receipts, kept, &trusted, found);
    pool::announced(reveal, commitment, kept, &trusted, found);
    let stated = stated(receipts, found);
    entries(reveal, commitment, rules, &stated, found);
    draws(reveal, commitment, issued, &stated, found);
    answers(reveal, commitment, rules, &stated, found);
    grades(reveal, issued, &stated, found);
    end(receipts, commitment, &stated, found);
    if commitment.protocol() >= FIRST_WITH_KEPT_PART {
        places::check(&reveal.instances, &stated, found);
    }
    times::check(&stated, found);
    times::budget(reveal, commitment, rules, &stated, found);
    if found.breaches.len() == before {
        found.receipts = receipts.len();
    }
}

fn stated<'a>(receipts: &'a [ReceiptFile], found: &mut Verified) -> Stated<'a> {
    let mut stated = Stated::default();
    for file in receipts {
        let Some(receipt) = &file.receipt else { continue };
        let place = || format!("receipt {}", file.seq);
        let fact = fact(receipt);
        let confirmed = fact.as_ref().map(ToString::to_string).unwrap_or_default();
        let is_first = match fact {
            Some(Fact::Entry(fact)) => stated.entries.insert(fact.id.clone(), fact).is_none(),
            Some(Fact::Draw(fact)) => stated.draws.insert((fact.entry.clone(), fact.run), fact).is_none(),
            Some(Fact::Answer(fact)) => stated.answers.insert(fact.instance.clone(), fact).is_none(),
            Some(Fact::Transcript(fact)) => stated.transcripts.insert(fact.instance.clone(), fact).is_none(),
            Some(Fact::Completed(fact)) => {
                stated.completed_at.insert(fact.entry.clone(), file.seq);
                stated.completed.insert(fact.entry.clone(), fact).is_none()
            }
            // A failure may repeat if the same log was sent again.
            Some(Fact::Failure(fact)) => {
                stated.failed.insert(fact.instance);
                true
            }
            Some(Fact::Padding(_)) => {
                stated.padding += 1;
                true
            }
            Some(Fact::Closed(fact)) => {
                stated.closed.push((file.seq, fact));
                true
            }
            None => {
                match receipt["instance"].as_str().filter(|_| receipt.get("overall").is_some()) {
                    Some(instance) => {
                        stated.graded_at.entry(instance.to_owned()).or_default().push(file.seq);
                        stated.grades.entry(instance).or_default().push(receipt);
                    }
                    None => found.breach(place(), "states no fact that this program knows"),
                }
                true
            }
        };
        if !is_first {
            found.breach(place(), format!("states {confirmed} a second time"));
        }
    }
    stated
}

/// Checks that every entry is as registered, ended when its receipt states, and follows the rules, and that none is
/// missing.
fn entries(reveal: &Reveal, commitment: &Commitment, rules: &Rules, stated: &Stated<'_>, found: &mut Verified) {
    let mut seen: BTreeSet<&str> = BTreeSet::new();
    let mut of_owner: BTreeMap<(&str, &str), u32> = BTreeMap::new();
    let mut official: BTreeMap<&str, &str> = BTreeMap::new();
    for entry in &reveal.entries {
        let place = || format!("entry {}", entry.id);
        if !seen.insert(&entry.id) {
            found.breach(place(), "appears twice in the reveal");
        }
        match stated.entries.get(&entry.id) {
            None => found.breach(place(), "has no receipt for its registration"),
            Some(fact) => {
                for what in differences(entry, fact) {
                    found.breach(place(), format!("{what} differs from the registration"));
                }
            }
        }
        let ended = stated.completed.get(&entry.id).map(|fact| (fact.finalized_at_ms, fact.completed_at_ms));
        if ended.is_none() {
            found.breach(place(), "has no receipt for its completion; an epoch that is over has completed all entries");
        } else if ended != entry.finalized_at_ms.zip(entry.completed_at_ms) {
            found.breach(place(), "has other times of finalization or completion than its receipt");
        }
        let is_in_time = match (&commitment.beacon, entry.tier) {
            (None, _) => (commitment.opens_at_ms..commitment.closes_at_ms).contains(&entry.registered_at_ms),
            // An official entry is registered before anybody can know a specification.
            (Some(beacon), Tier::Official) => entry.registered_at_ms < beacon.emitted_at_ms(),
            (Some(_), Tier::Dev) => entry.registered_at_ms < commitment.closes_at_ms,
        };
        if !is_in_time {
            found.breach(place(), "was registered while the epoch took no entries of its tier");
        }
        let owner = entry.owner.as_deref().unwrap_or_default();
        *of_owner.entry((owner, entry.tier.name())).or_default() += 1;
        if entry.tier == Tier::Official && *official.entry(&entry.configuration_hash).or_insert(owner) != owner {
            found.breach(place(), "has a configuration that another owner entered too");
        }
    }
    for ((owner, tier), count) in of_owner {
        let most =
            if tier == Tier::Dev.name() { rules.dev_entries_per_owner } else { rules.official_entries_per_owner };
        if count > most {
            found.breach(
                format!("owner {owner:?}"),
                format!("has {} in the {tier} tier; at most {most} are allowed", agreeing(count, "entry", "entries")),
            );
        }
    }
    for id in stated.entries.keys().filter(|id| !seen.contains(id.as_str())) {
        found.breach(format!("entry {id}"), "was registered but is missing from the reveal");
    }
}

/// Lists the members in which an entry differs from its receipt.
fn differences(entry: &RevealedEntry, fact: &EntryFact) -> Vec<&'static str> {
    let same = [
        ("the owner", entry.owner.as_ref() == Some(&fact.owner)),
        ("the agent", entry.agent == fact.agent),
        ("the configuration", entry.configuration_hash == fact.configuration_sha256),
        ("the tier", entry.tier == fact.tier),
        ("the number of runs", entry.runs == fact.runs),
        ("the time of registration", entry.registered_at_ms == fact.registered_at_ms),
    ];
    same.into_iter().filter(|(_, is_same)| !is_same).map(|(what, _)| what).collect()
}

/// Checks that every run was drawn as its receipt states, and that none is missing.
fn draws(reveal: &Reveal, commitment: &Commitment, issued: &Issued<'_>, stated: &Stated<'_>, found: &mut Verified) {
    let mut runs: BTreeMap<(String, u32), Vec<&RevealedInstance>> = BTreeMap::new();
    for instance in &reveal.instances {
        runs.entry((instance.entry.clone(), instance.run)).or_default().push(instance);
    }
    for (key, instances) in &runs {
        let place = || format!("entry {}", key.0);
        let Some(fact) = stated.draws.get(key) else {
            found.breach(place(), format!("run {} has no receipt for its draw", key.1));
            continue;
        };
        if !instances.iter().map(|own| &own.id).eq(&fact.instances) {
            found.breach(place(), format!("run {} has instances other than those drawn", key.1));
        }
        if instances.iter().any(|own| own.nonce != fact.nonce) {
            found.breach(place(), format!("the nonce of run {} is not the one on its receipt", key.1));
        }
        asked(fact, instances, issued, commitment, found);
        let message = DrawMessage { epoch: &commitment.epoch, entry: &fact.entry, run: fact.run, nonce: &fact.nonce };
        let proven = |key: &String| fact.proof.as_ref().is_some_and(|proof| verify(key, &message, proof).is_some());
        if !commitment.draw_key.as_ref().map_or(fact.proof.is_none(), proven) {
            found.breach(place(), format!("the proof of the draw of run {} does not hold", key.1));
        }
        let opens_at_ms = reveal.pool.as_ref().map_or(commitment.opens_at_ms, |pool| {
            // Clocks of several nodes differ.
            commitment.opens_at_ms.max(pool.made_at_ms - times::SLACK_MS)
        });
        if fact.drawn_at_ms < opens_at_ms || fact.drawn_at_ms >= commitment.closes_at_ms {
            found.breach(place(), format!("run {} was drawn while the epoch was not open", key.1));
        }
    }
    let silent = stated.draws.values().filter(|draw| draw.prompts_sha256.is_empty()).count();
    if silent > 0 && commitment.protocol() < FIRST_WITH_PROMPTS {
        let draws = agreeing(silent, "draw lacks", "draws lack");
        found
            .unchecked
            .push(format!("what was asked: the epoch's protocol did not demand it of receipts, and {draws} it"));
    }
    let owners: BTreeMap<&str, &str> =
        reveal.entries.iter().map(|entry| (entry.id.as_str(), entry.owner.as_deref().unwrap_or_default())).collect();
    let mut held: BTreeMap<&str, u32> = BTreeMap::new();
    for (entry, _) in runs.keys() {
        *held.entry(owners.get(entry.as_str()).copied().unwrap_or_default()).or_default() += 1;
    }
    let most = commitment.rules.as_ref().map_or(u32::MAX, |rules| rules.runs_per_owner);
    for (owner, runs) in held.into_iter().filter(|(_, runs)| *runs > most) {
        found.breach(format!("owner {owner:?}"), format!("drew {}; at most {most} are allowed", counted(runs, "run")));
    }
    for (entry, run) in stated.draws.keys().filter(|key| !runs.contains_key(*key)) {
        found.breach(format!("entry {entry}"), format!("run {run} was drawn but is missing from the reveal"));
    }
}

/// Checks that the entrant was asked what the specifications of the instances ask.
fn asked(
    fact: &DrawFact,
    instances: &[&RevealedInstance],
    issued: &Issued<'_>,
    commitment: &Commitment,
    found: &mut Verified,
) {
    if fact.prompts_sha256.is_empty() && commitment.protocol() < FIRST_WITH_PROMPTS {
        return;
    }
    if fact.prompts_sha256.len() != fact.instances.len() {
        let (prompts, of) = (counted(fact.prompts_sha256.len(), "prompt"), counted(fact.instances.len(), "instance"));
        found
            .breach(format!("entry {}", fact.entry), format!("the receipt of run {} has {prompts} for {of}", fact.run));
    }
    let stated: BTreeMap<&str, &String> = fact.instances.iter().map(String::as_str).zip(&fact.prompts_sha256).collect();
    for instance in instances {
        let Some(specification) = issued.specification(instance.leaf) else { continue };
        let prompts = specification.task.turns.iter().map(|turn| turn.prompt.as_str());
        if stated.get(instance.id.as_str()).is_some_and(|hash| **hash != prompts_hash(prompts)) {
            found.breach(
                format!("instance {}", instance.id),
                "the entrant was asked something else than its specification asks",
            );
        }
    }
}

/// Checks that every answer is the accepted one and came in time, and that none is missing.
fn answers(reveal: &Reveal, commitment: &Commitment, rules: &Rules, stated: &Stated<'_>, found: &mut Verified) {
    let drawn_at: BTreeMap<&str, i64> = stated
        .draws
        .values()
        .flat_map(|draw| draw.instances.iter().map(|id| (id.as_str(), draw.drawn_at_ms)))
        .collect();
    for instance in &reveal.instances {
        let place = || format!("instance {}", instance.id);
        match (&instance.log_sha256, stated.answers.get(&instance.id)) {
            (None, None) => {}
            (None, Some(_)) => found.breach(place(), "was answered, but the reveal has no answer"),
            (Some(_), None) => found.breach(place(), "has an answer but no receipt for it"),
            (Some(log), Some(fact)) => {
                if *log != fact.log_sha256 {
                    found.breach(place(), "has a log other than the one on the receipt of its answer");
                }
                if instance.entry != fact.entry || instance.transcript_sha256 != fact.transcript_sha256 {
                    found.breach(place(), "has an entry or a promised transcript other than on its receipt");
                }
                let expires =
                    drawn_at.get(instance.id.as_str()).map(|at| at + i64::from(rules.instance_seconds) * 1_000);
                let closes = commitment.closes_at_ms;
                if expires.is_none_or(|expires| fact.answered_at_ms >= expires.min(closes)) {
                    found.breach(place(), "was answered after its time limit or after the epoch closed");
                }
            }
        }
    }
    for instance in &reveal.instances {
        let shown = stated.transcripts.get(&instance.id).map(|fact| &fact.transcript_sha256);
        if instance.transcript_checked != shown.is_some()
            || (shown.is_some() && shown != instance.transcript_sha256.as_ref())
        {
            found.breach(format!("instance {}", instance.id), "the reveal and the receipts disagree on its transcript");
        }
    }
    let known: BTreeSet<&str> = reveal.instances.iter().map(|instance| instance.id.as_str()).collect();
    for id in stated.answers.keys().filter(|id| !known.contains(id.as_str())) {
        found.breach(format!("instance {id}"), "was answered but is missing from the reveal");
    }
}

/// Checks that every verdict is the one that was signed at grading, and that a receipt explains each answer without a
/// verdict.
fn grades(reveal: &Reveal, issued: &Issued<'_>, stated: &Stated<'_>, found: &mut Verified) {
    let mut known: BTreeSet<&str> = BTreeSet::new();
    for instance in &reveal.instances {
        known.insert(&instance.id);
        let place = || format!("instance {}", instance.id);
        let grades = stated.grades.get(instance.id.as_str()).map_or(&[][..], Vec::as_slice);
        if instance.overall.is_none() {
            let detail = match (grades.is_empty(), instance.log_sha256.is_some()) {
                (false, _) => "was graded, but the reveal has no grade",
                (true, true) if !stated.failed.contains(&instance.id) => {
                    "has an answer without a grade, and no receipt of a failure explains it"
                }
                _ => continue,
            };
            found.breach(place(), detail);
            continue;
        }
        if grades.is_empty() {
            found.breach(place(), "has a grade but no receipt for it");
        }
        let task = issued.specification(instance.leaf).map(|own| own.task.content_hash());
        for receipt in grades {
            let is_same = receipt["overall"].as_bool() == instance.overall
                && receipt["log_sha256"].as_str() == instance.log_sha256.as_deref()
                && receipt["specification_sha256"].as_str() == task.as_deref();
            if !is_same {
                found.breach(place(), "its verdict, log or specification differs from the receipt of its grade");
            }
        }
    }
    let graded = stated.grades.keys().copied().chain(stated.failed.iter().map(String::as_str));
    for id in graded.filter(|id| !known.contains(id)) {
        found.breach(format!("instance {id}"), "was graded or failed to be graded, but is missing from the reveal");
    }
}

/// Checks the last receipt, which states the number of receipts and the end of the epoch.
fn end(receipts: &[ReceiptFile], commitment: &Commitment, stated: &Stated<'_>, found: &mut Verified) {
    let [(seq, closed)] = stated.closed.as_slice() else {
        found.breach("receipts", format!("{} state the end of the epoch; exactly one must", stated.closed.len()));
        return;
    };
    let others = receipts.len() as u64 - 1;
    if closed.receipts != others {
        let detail = format!("receipt {seq} says that {} came before it, but the reveal has {others}", closed.receipts);
        found.breach("receipts", detail);
    }
    if receipts.iter().any(|file| file.seq > *seq) {
        found.breach("receipts", format!("receipt {seq} states the end of the epoch, but others come after it"));
    }
    let early_ms = commitment.closes_at_ms - closed.closed_at_ms;
    if early_ms < 0 {
        found.breach("receipts", "the epoch was closed after its committed closing time");
    } else if early_ms > 0 {
        let minutes = agreeing((early_ms + 59_999) / 60_000, "minute", "minutes");
        found.remarks.push(format!(
            "the epoch ended {minutes} before its committed end, with the reason {:?}: entrants could not answer after \
             that",
            closed.reason
        ));
    }
}

//! Checks the draws of a reveal: what each run was issued follows from key, entry and nonce.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use super::Verified;
use crate::hidden::feedback::Tier;
use crate::hidden::issue::{Drawing, Lot, Place};
use crate::hidden::reveal::{Reveal, RevealedEntry};
use crate::hidden::secret::EpochKey;
use crate::text::counted;

/// Checks that every instance is the one that key, entry and nonce draw, and that none was issued twice.
pub(super) fn check(reveal: &Reveal, drawing: &Drawing<'_>, key: &EpochKey, found: &mut Verified) {
    let commitment = drawing.commitment;
    if commitment.siblings.is_none() && reveal.instances.iter().any(|own| commitment.is_sibling(own.leaf)) {
        found.breach("siblings", "were drawn, though the commitment has no list of them");
    }
    let mut issued: HashSet<u32> = HashSet::new();
    let mut of_entries: BTreeMap<&str, HashSet<u32>> = BTreeMap::new();
    let mut lots: BTreeMap<(&str, u32, &str), Lot<'_>> = BTreeMap::new();
    let places = Tier::ALL.map(|tier| (tier, drawing.places(tier)));
    let places_of = |tier| places.iter().find(|(own, _)| *own == tier).map_or(&[][..], |(_, places)| places);
    let entry_of: BTreeMap<&str, &RevealedEntry> =
        reveal.entries.iter().map(|entry| (entry.id.as_str(), entry)).collect();
    let mut drawn_for: BTreeMap<(&str, u32), BTreeSet<(&str, u32)>> = BTreeMap::new();
    let mut nonce_of: BTreeMap<(&str, u32), &str> = BTreeMap::new();
    let mut ids: BTreeSet<&str> = BTreeSet::new();
    for (ordinal, instance) in (1..).zip(&reveal.instances) {
        let place = || format!("instance {}", instance.id);
        let Some(entry) = entry_of.get(instance.entry.as_str()) else {
            found.breach(place(), "belongs to an entry that is not in the reveal");
            continue;
        };
        let runs = entry.runs;
        if !(1..=runs).contains(&instance.run) {
            let runs = counted(runs, "run");
            found.breach(place(), format!("belongs to run {}, but its entry registered {runs}", instance.run));
        }
        let of_run = drawn_for.entry((&instance.entry, instance.run)).or_default();
        if !of_run.insert((&instance.family, instance.index)) {
            found.breach(place(), "has the family and index of an earlier instance of the same run");
        }
        if *nonce_of.entry((&instance.entry, instance.run)).or_insert(&instance.nonce) != instance.nonce {
            found.breach(place(), format!("run {} was drawn with more than one nonce", instance.run));
        }
        if !ids.insert(&instance.id) {
            found.breach(place(), "appears twice in the reveal");
        }
        if instance.ordinal != ordinal {
            found.breach(place(), format!("has the ordinal {}, but {ordinal} is next", instance.ordinal));
        }
        let drawn_as = (instance.family.as_str(), instance.index);
        let is_of = |own: &&Place| (own.stratum.family.as_str(), own.index) == drawn_as;
        let Some(drawn_place) = places_of(entry.tier).iter().find(is_of) else {
            let tier = entry.tier.name();
            found.breach(place(), format!("no run of the {tier} tier has instance {} of {:?}", drawn_as.1, drawn_as.0));
            continue;
        };
        let lot = lots
            .entry((&instance.entry, instance.run, &instance.nonce))
            .or_insert_with(|| Lot::of(commitment, key, &instance.entry, instance.run, &instance.nonce));
        let of_entry = of_entries.entry(&instance.entry).or_default();
        let drawn = drawing.leaf(lot, drawn_place, &issued, of_entry);
        if drawn == Some(instance.leaf) {
            found.draws += 1;
        } else {
            let leaf = drawn.map_or_else(|| "none".to_owned(), |leaf| format!("leaf {leaf}"));
            found.breach(place(), format!("leaf {} was issued, but key and nonce draw {leaf}", instance.leaf));
        }
        issued.insert(instance.leaf);
        of_entry.insert(instance.leaf);
    }
    // A draw always issues all instances of a run.
    for ((entry, run), of_run) in &drawn_for {
        let tier = entry_of.get(entry).map(|entry| entry.tier);
        let all = tier.map_or(&[][..], places_of).iter().map(|own| (own.stratum.family.as_str(), own.index));
        for (family, index) in all.filter(|place| !of_run.contains(place)) {
            found.breach(format!("entry {entry}"), format!("run {run} lacks instance {index} of the family {family}"));
        }
    }
}

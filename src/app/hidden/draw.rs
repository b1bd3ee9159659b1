//! The rule that decides on the draw of a run, and draws the leaves of every stratum.

use super::allocation::{NoRoom, Pool};
use crate::store::draws::{DrawDecision, DrawFacts, DrawRefusal, DrawnLeaf, NewDraw};
use plumbline_engine::hidden::issue::Drawing;

/// Decides on a draw. A run is drawn once: the same nonce again counts as the same draw, a different nonce is refused.
#[must_use]
pub fn decide_draw(new: &NewDraw<'_>, facts: &DrawFacts) -> DrawDecision {
    let DrawFacts { entry, epoch, earlier_nonce, holdings, now_ms, .. } = facts;
    if new.run == 0 || new.run > entry.runs {
        return DrawDecision::Refuse(DrawRefusal::NoSuchRun);
    }
    if let Some(earlier) = earlier_nonce {
        let is_same = earlier == new.nonce;
        return if is_same { DrawDecision::Repeat } else { DrawDecision::Refuse(DrawRefusal::OtherNonce) };
    }
    if entry.finalized_at_ms.is_some() || !epoch.is_open(*now_ms) {
        return DrawDecision::Refuse(DrawRefusal::Closed);
    }
    // The secret may have been read before another request published the pool.
    if epoch.commitment.beacon.is_some() && (epoch.pool.is_none() || new.secret.pool.strata.is_empty()) {
        return DrawDecision::Refuse(DrawRefusal::NoPool);
    }
    let pool = Pool { epoch, holdings, now_ms: *now_ms };
    if !pool.has_reserved(&entry.id) {
        match pool.room_for(&entry.owner, entry.tier, 1) {
            Ok(()) => {}
            Err(NoRoom::PoolUsedUp) => return DrawDecision::Refuse(DrawRefusal::Exhausted),
            Err(NoRoom::ShareUsedUp(most)) => return DrawDecision::Refuse(DrawRefusal::ShareUsedUp(most)),
        }
    }
    leaves(new, facts).map_or(DrawDecision::Refuse(DrawRefusal::Exhausted), DrawDecision::Issue)
}

/// Draws the leaves of a run, or returns `None` if a stratum has none left.
fn leaves(new: &NewDraw<'_>, facts: &DrawFacts) -> Option<Vec<DrawnLeaf>> {
    let DrawFacts { entry, epoch, now_ms, .. } = facts;
    let expires_at_ms = (now_ms + epoch.rules.instance_ms).min(epoch.commitment.closes_at_ms);
    let (strata, siblings) = (new.secret.pool.strata.as_slice(), new.siblings);
    let drawing = Drawing { commitment: &epoch.commitment, strata, siblings };
    let (mut issued, mut own) = (facts.issued_leaves.clone(), facts.own_leaves.clone());
    let mut drawn = Vec::new();
    for place in drawing.places(entry.tier) {
        let leaf = drawing.leaf(new.lot, &place, &issued, &own)?;
        issued.insert(leaf);
        own.insert(leaf);
        drawn.push(DrawnLeaf { family: place.stratum.family, family_index: place.index, leaf, expires_at_ms });
    }
    Some(drawn)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::app::hidden::fixtures::{CLOSES_AT_MS, OPENS_AT_MS, entry, epoch, holding};
    use crate::store::secrets::{EpochSecret, PoolFile};
    use plumbline_engine::hidden::GENERATOR_VERSION;
    use plumbline_engine::hidden::beacon::{BoundPool, Chain};
    use plumbline_engine::hidden::feedback::Tier::{Dev, Official};
    use plumbline_engine::hidden::issue::Lot;
    use plumbline_engine::hidden::pool::Stratum;
    use plumbline_engine::hidden::secret::EpochKey;
    use plumbline_engine::hidden::siblings::Siblings;

    fn secret() -> EpochSecret {
        let stratum =
            |family: &str, instances, first, size| Stratum { family: family.to_owned(), instances, first, size };
        let strata = vec![stratum("slabs", 2, 0, 16), stratum("domes", 1, 16, 8)];
        let key = EpochKey::new([3; 32]);
        EpochSecret { pool_key: key.clone(), key, pool: PoolFile { strata, specifications: Vec::new() } }
    }

    fn facts() -> DrawFacts {
        DrawFacts {
            entry: entry("own", "a", Official),
            epoch: epoch(),
            earlier_nonce: None,
            holdings: vec![holding("own", "a", Official, 2, 0)],
            issued_leaves: HashSet::new(),
            own_leaves: HashSet::new(),
            now_ms: OPENS_AT_MS,
        }
    }

    fn decide(run: u32, facts: &DrawFacts) -> DrawDecision {
        let (secret, nonce) = (secret(), "nonce");
        let lot = Lot::of(&facts.epoch.commitment, &secret.key, "own", run, nonce);
        decide_draw(&NewDraw { entry_id: "own", run, nonce, secret: &secret, lot: &lot, siblings: None }, facts)
    }

    fn issued(decision: DrawDecision) -> Vec<DrawnLeaf> {
        match decision {
            DrawDecision::Issue(leaves) => leaves,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_draw_takes_the_leaves_of_every_stratum_that_are_not_issued() {
        let first = issued(decide(1, &facts()));
        let families: Vec<_> = first.iter().map(|own| (own.family.as_str(), own.family_index)).collect();
        assert_eq!(families, [("slabs", 0), ("slabs", 1), ("domes", 0)]);
        assert!(first[0].leaf != first[1].leaf && first[..2].iter().all(|own| own.leaf < 16));
        assert!((16..24).contains(&first[2].leaf));
        assert_eq!(issued(decide(1, &facts())), first, "the same facts give the same leaves");
        let gone: HashSet<u32> = first.iter().map(|own| own.leaf).collect();
        let again = issued(decide(1, &DrawFacts { issued_leaves: gone.clone(), ..facts() }));
        assert!(again.iter().all(|own| !gone.contains(&own.leaf)));
    }

    #[test]
    fn official_runs_draw_siblings_that_do_not_tell_what_others_have() {
        let list = Siblings::of(GENERATOR_VERSION).unwrap();
        let mut facts = facts();
        facts.epoch.commitment.siblings = Some(list.list().clone());
        let (secret, nonce) = (secret(), "nonce");
        let lot = Lot::of(&facts.epoch.commitment, &secret.key, "own", 1, nonce);
        let new = NewDraw { entry_id: "own", run: 1, nonce, secret: &secret, lot: &lot, siblings: Some(list) };
        let drawn = issued(decide_draw(&new, &facts));
        let families: Vec<_> =
            drawn.iter().map(|own| (own.family.as_str(), own.family_index, own.leaf >= 24)).collect();
        // There are no domes on the list.
        let expected =
            [("slabs", 0, false), ("slabs", 1, false), ("slabs", 2, true), ("slabs", 3, true), ("domes", 0, false)];
        assert_eq!(families, expected);
        let named = |leaf| list.specification(&facts.epoch.commitment, leaf).unwrap().task.id.clone();
        let siblings: Vec<u32> = drawn[2..4].iter().map(|own| own.leaf).collect();
        assert_ne!(named(siblings[0]), named(siblings[1]));
        assert!(named(siblings[0]).starts_with("slabs/sibling-"));
        // Others have them already: the same are drawn, under other leaves. The entry itself gets others.
        facts.issued_leaves = siblings.iter().copied().collect();
        let again = issued(decide_draw(&new, &facts));
        assert!(
            again[2..4]
                .iter()
                .zip(&siblings)
                .all(|(own, before)| own.leaf != *before && named(own.leaf) == named(*before))
        );
        facts.own_leaves = facts.issued_leaves.clone();
        let others = issued(decide_draw(&new, &facts));
        assert!(others[2..4].iter().all(|own| siblings.iter().all(|before| named(own.leaf) != named(*before))));
        facts.entry.tier = Dev;
        assert!(issued(decide_draw(&new, &facts)).iter().all(|own| own.leaf < 24));
    }

    #[test]
    fn an_instance_expires_with_its_time_or_the_epoch() {
        for (now_ms, expires_at_ms) in [(OPENS_AT_MS, OPENS_AT_MS + 10_000), (CLOSES_AT_MS - 1, CLOSES_AT_MS)] {
            let mut facts = DrawFacts { now_ms, ..facts() };
            facts.epoch.rules.reservation_ms = None;
            assert!(issued(decide(1, &facts)).iter().all(|own| own.expires_at_ms == expires_at_ms), "{now_ms}");
        }
    }

    #[test]
    fn a_stratum_without_leaves_refuses_the_whole_draw() {
        let decision = decide(1, &DrawFacts { issued_leaves: (16..24).collect(), ..facts() });
        assert_eq!(decision, DrawDecision::Refuse(DrawRefusal::Exhausted));
    }

    #[test]
    fn a_run_is_drawn_once_while_entry_and_epoch_are_open() {
        use DrawDecision::{Refuse, Repeat};
        for (run, earlier, is_finalized, now_ms, expected) in [
            (0, None, false, OPENS_AT_MS, Refuse(DrawRefusal::NoSuchRun)),
            (3, None, false, OPENS_AT_MS, Refuse(DrawRefusal::NoSuchRun)),
            (1, Some("nonce"), false, OPENS_AT_MS, Repeat),
            (2, Some("another"), false, OPENS_AT_MS, Refuse(DrawRefusal::OtherNonce)),
            // What was drawn can be read as long as it is kept.
            (1, Some("nonce"), true, CLOSES_AT_MS, Repeat),
            (1, None, true, OPENS_AT_MS, Refuse(DrawRefusal::Closed)),
            (1, None, false, OPENS_AT_MS - 1, Refuse(DrawRefusal::Closed)),
            (1, None, false, CLOSES_AT_MS, Refuse(DrawRefusal::Closed)),
        ] {
            let mut facts = DrawFacts { earlier_nonce: earlier.map(str::to_owned), now_ms, ..facts() };
            facts.entry.finalized_at_ms = is_finalized.then_some(OPENS_AT_MS);
            assert_eq!(decide(run, &facts), expected, "{run} {earlier:?} {is_finalized} {now_ms}");
        }
    }

    #[test]
    fn a_draw_waits_for_the_pool_of_the_beacon() {
        let mut facts = facts();
        facts.epoch.commitment.beacon = Chain::quicknet().first_round_from(OPENS_AT_MS).ok();
        assert_eq!(decide(1, &facts), DrawDecision::Refuse(DrawRefusal::NoPool));
        let (epoch, signature, root) = ("epoch".to_owned(), String::new(), String::new());
        facts.epoch.pool = Some(BoundPool { epoch, round: 1, signature, root, made_at_ms: OPENS_AT_MS });
        assert_eq!(issued(decide(1, &facts)).len(), 3);
        // The pool was published after the secret was read.
        let secret = EpochSecret { pool: PoolFile::default(), ..secret() };
        let lot = Lot::of(&facts.epoch.commitment, &secret.key, "own", 1, "nonce");
        let new = NewDraw { entry_id: "own", run: 1, nonce: "nonce", secret: &secret, lot: &lot, siblings: None };
        assert_eq!(decide_draw(&new, &facts), DrawDecision::Refuse(DrawRefusal::NoPool));
    }

    #[test]
    fn a_run_without_reservation_needs_room_in_the_pool() {
        let now_ms = OPENS_AT_MS + 500;
        for (others, drawn, refusal) in [
            (0, 0, None),
            (7, 0, None),
            (8, 0, Some(DrawRefusal::Exhausted)),
            (0, 5, Some(DrawRefusal::ShareUsedUp(5))),
        ] {
            let holdings =
                vec![holding("own", "a", Official, 6, drawn), holding("other", "b", Official, others, others)];
            let decision = decide(1, &DrawFacts { holdings, now_ms, ..facts() });
            match refusal {
                Some(refusal) => assert_eq!(decision, DrawDecision::Refuse(refusal), "{others} {drawn}"),
                None => assert_eq!(issued(decision).len(), 3, "{others} {drawn}"),
            }
        }
        // A reserved run needs no more room.
        let holdings = vec![holding("own", "a", Official, 2, 0), holding("other", "b", Official, 8, 8)];
        assert_eq!(issued(decide(1, &DrawFacts { holdings, ..facts() })).len(), 3);
    }
}

//! The rule that decides who may register an entry: open epoch, entries per owner, room in the pool, one configuration.

use super::allocation::{NoRoom, Pool};
use crate::store::registration::{NewEntry, RegistrationFacts, RegistrationRefusal};
use plumbline_engine::hidden::feedback::Tier;

/// Decides on a registration.
///
/// # Errors
/// Returns the reason if the entry may not be registered.
pub fn decide_registration(new: &NewEntry<'_>, facts: &RegistrationFacts) -> Result<(), RegistrationRefusal> {
    let RegistrationFacts { epoch, own, holdings, configuration_holder, now_ms } = facts;
    match (&epoch.commitment.beacon, new.tier) {
        _ if epoch.is_over(*now_ms) => return Err(RegistrationRefusal::NotOpen),
        (None, _) if !epoch.is_open(*now_ms) => return Err(RegistrationRefusal::NotOpen),
        // Official entries are registered before anybody can know a specification.
        (Some(beacon), Tier::Official) if *now_ms >= beacon.emitted_at_ms() || epoch.pool.is_some() => {
            return Err(RegistrationRefusal::AfterBeacon(beacon.emitted_at_ms()));
        }
        _ => {}
    }
    let most = match new.tier {
        Tier::Dev => epoch.rules.dev_entries,
        Tier::Official => epoch.rules.official_entries,
    };
    if own.len() as i64 >= most {
        return Err(RegistrationRefusal::TooMany(most));
    }
    let room = Pool { epoch, holdings, now_ms: *now_ms }.room_for(new.owner, new.tier, new.runs);
    room.map_err(|full| match full {
        NoRoom::PoolUsedUp => RegistrationRefusal::PoolUsedUp,
        NoRoom::ShareUsedUp(most) => RegistrationRefusal::ShareUsedUp(most),
    })?;
    if new.tier == Tier::Dev {
        return Ok(());
    }
    if let Some(first) = own.first() {
        // Whoever has it in this epoch keeps it: earlier programs let two owners register it.
        let is_same = first.agent == new.agent && first.configuration_hash == new.configuration_hash;
        return if is_same { Ok(()) } else { Err(RegistrationRefusal::OtherConfiguration(first.agent.clone())) };
    }
    // An owner with two names would have twice the attempts with one agent. The owner who first registered a
    // configuration keeps it, because its hash may be read on a board.
    if configuration_holder.as_deref().is_some_and(|holder| holder != new.owner) {
        return Err(RegistrationRefusal::ConfigurationTaken);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::hidden::fixtures::{CLOSES_AT_MS, OPENS_AT_MS, entry, epoch, holding};
    use Tier::{Dev, Official};

    fn new(tier: Tier, runs: u32) -> NewEntry<'static> {
        let (agent, configuration_hash) = ("agent", "configuration");
        NewEntry { id: "new", epoch_id: "epoch", owner: "a", agent, configuration_hash, tier, runs }
    }

    fn facts() -> RegistrationFacts {
        let (epoch, own, holdings) = (epoch(), Vec::new(), Vec::new());
        RegistrationFacts { epoch, own, holdings, configuration_holder: None, now_ms: OPENS_AT_MS }
    }

    #[test]
    fn entries_are_registered_while_the_epoch_is_open() {
        for (now_ms, closed, is_open) in [
            (OPENS_AT_MS - 1, false, false),
            (OPENS_AT_MS, false, true),
            (CLOSES_AT_MS - 1, false, true),
            (CLOSES_AT_MS, false, false),
            (OPENS_AT_MS, true, false),
        ] {
            let mut facts = RegistrationFacts { now_ms, ..facts() };
            facts.epoch.closed = closed.then(|| (OPENS_AT_MS, "a reason".to_owned()));
            let expected = if is_open { Ok(()) } else { Err(RegistrationRefusal::NotOpen) };
            assert_eq!(decide_registration(&new(Dev, 1), &facts), expected, "{now_ms} {closed}");
        }
    }

    #[test]
    fn each_tier_takes_so_many_entries_of_an_owner() {
        for (tier, entries, expected) in [
            (Dev, 2, Ok(())),
            (Dev, 3, Err(RegistrationRefusal::TooMany(3))),
            (Official, 1, Ok(())),
            (Official, 2, Err(RegistrationRefusal::TooMany(2))),
        ] {
            let own = (0..entries).map(|i| entry(&i.to_string(), "a", tier)).collect();
            assert_eq!(decide_registration(&new(tier, 1), &RegistrationFacts { own, ..facts() }), expected);
        }
    }

    #[test]
    fn runs_need_room_in_the_pool() {
        for (tier, runs, expected) in [
            (Dev, 1, Ok(())),
            (Dev, 2, Err(RegistrationRefusal::PoolUsedUp)),
            (Official, 5, Ok(())),
            (Official, 6, Err(RegistrationRefusal::ShareUsedUp(5))),
        ] {
            let facts = RegistrationFacts { holdings: vec![holding("other", "b", Dev, 3, 3)], ..facts() };
            assert_eq!(decide_registration(&new(tier, runs), &facts), expected, "{tier:?} {runs}");
        }
    }

    #[test]
    fn official_entries_are_of_one_configuration_which_has_one_owner() {
        let other_agent = || Err(RegistrationRefusal::OtherConfiguration("agent 2".to_owned()));
        let other_configuration = || Err(RegistrationRefusal::OtherConfiguration("agent".to_owned()));
        let taken = || Err(RegistrationRefusal::ConfigurationTaken);
        for (tier, first, holder, expected) in [
            (Official, None, None, Ok(())),
            (Official, Some(("agent", "configuration")), Some("a"), Ok(())),
            (Official, Some(("agent 2", "configuration")), Some("a"), other_agent()),
            (Official, Some(("agent", "another")), None, other_configuration()),
            (Official, None, Some("a"), Ok(())),
            (Official, None, Some("b"), taken()),
            // An earlier program let both register it.
            (Official, Some(("agent", "configuration")), Some("b"), Ok(())),
            // The dev tier takes any configuration.
            (Dev, Some(("agent 2", "another")), None, Ok(())),
            (Dev, None, Some("b"), Ok(())),
        ] {
            let mut facts = facts();
            facts.configuration_holder = holder.map(str::to_owned);
            facts.own.extend(first.map(|(agent, configuration_hash)| {
                let mut own = entry("first", "a", tier);
                (own.agent, own.configuration_hash) = (agent.to_owned(), configuration_hash.to_owned());
                own
            }));
            assert_eq!(decide_registration(&new(tier, 1), &facts), expected, "{tier:?} {first:?} {holder:?}");
        }
    }
}

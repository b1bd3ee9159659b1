//! What the log says of epochs: that one opens, closes, and is settled.

use std::collections::{HashMap, HashSet};

use crate::store::epochs::EpochRow;

/// States of the epochs when they were looked at last.
#[derive(Debug, Default)]
pub(super) struct EpochStates {
    last: Option<HashMap<String, State>>,
    /// Epochs that were not settled at the look before.
    just_settled: HashSet<String>,
}

/// State of an epoch, and whether it is settled.
type State = (&'static str, bool);

impl EpochStates {
    /// Logs what changed since the last look. The first look logs nothing, except epochs that are open.
    pub fn tell(&mut self, epochs: &[EpochRow], now_ms: i64) {
        let states: HashMap<String, State> = epochs
            .iter()
            .map(|epoch| (epoch.id().to_owned(), (epoch.state(now_ms), epoch.settled_at_ms.is_some())))
            .collect();
        self.just_settled.clear();
        for epoch in epochs {
            let id = epoch.id();
            let known = match &self.last {
                Some(before) => before.get(id).copied().unwrap_or(("unknown", false)),
                None if states[id].0 == "open" => ("unknown", false),
                None => states[id],
            };
            if states[id].1 && !known.1 {
                self.just_settled.insert(id.to_owned());
            }
            if let Some(line) = change(known, states[id]) {
                let reason = epoch.closed.as_ref().map_or("its time is over", |(_, reason)| reason);
                let reason = (states[id].0 == "closed").then_some(reason);
                tracing::info!(epoch = id, reason, "{line}");
            }
        }
        self.last = Some(states);
    }

    /// Returns whether an epoch was settled between the last two looks.
    pub fn has_just_settled(&self, id: &str) -> bool {
        self.just_settled.contains(id)
    }
}

/// Returns what to say of an epoch that went from one state to another; `None` if it did not.
fn change(from: State, to: State) -> Option<&'static str> {
    match (from, to) {
        _ if from == to => None,
        (_, ("closed", true)) => {
            Some("an epoch is settled: its results are public, and what it kept secret is revealed with its key")
        }
        (("closed", _), ("closed", false)) => None,
        (_, ("closed", false)) => Some("an epoch has closed; its last answers are graded, then it is settled"),
        (_, ("open", _)) => Some("an epoch is open"),
        (_, ("committed", _)) => Some("an epoch is announced"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_change_is_said_once() {
        let (unknown, committed, open) = (("unknown", false), ("committed", false), ("open", false));
        let (closed, settled) = (("closed", false), ("closed", true));
        for (from, to, begins) in [
            (unknown, committed, Some("an epoch is announced")),
            (committed, open, Some("an epoch is open")),
            (open, open, None),
            (open, closed, Some("an epoch has closed")),
            (closed, closed, None),
            (closed, settled, Some("an epoch is settled")),
            (open, settled, Some("an epoch is settled")),
            (settled, settled, None),
        ] {
            let said = change(from, to);
            assert_eq!(said.is_some(), begins.is_some(), "{from:?} {to:?}");
            assert!(said.is_none_or(|said| said.starts_with(begins.expect("it is said"))), "{from:?} {to:?}");
        }
    }
}

//! Computes the boards of an epoch from its entries and the outcomes of their instances. The service and the verifier
//! share this code.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::feedback::Tier;
use super::ladder::{Attempt, Tally, climb};
use crate::grading::statistics::interval::{Interval, wilson};

/// An entry as a board sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entrant {
    /// Identifier of the entry.
    pub id: String,
    /// Owner that registered the entry.
    pub owner: String,
    /// Name of the evaluated agent.
    pub agent: String,
    /// SHA-256 of the agent's configuration.
    pub configuration_sha256: String,
    /// Number of registered runs.
    pub runs: u32,
    /// Time of completion, when all answers were graded, milliseconds since 1970; `None` before it, and the entry has
    /// no row.
    pub completed_at_ms: Option<i64>,
    /// Issued instances, in the order of issue.
    pub instances: Vec<Answered>,
}

/// An instance as a board sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a fact of its own")]
pub struct Answered {
    /// Secret salt of the instance, in hex.
    pub salt: String,
    /// Whether the answer passes.
    pub passes: bool,
    /// Whether the instance has an answer.
    pub is_answered: bool,
    /// Whether the answer promised a transcript.
    pub has_transcript: bool,
    /// Whether the promised transcript was shown.
    pub is_checked: bool,
}

/// A row of a board: an owner's pooled official entries, or the owner's state on the Ladder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = EpochRowBody)]
pub struct Row {
    /// Rank, from 1; a row shares the rank before it if its interval reaches the score of the first row at that rank.
    pub rank: usize,
    /// Owner that registered the entries.
    pub owner: String,
    /// Name of the evaluated agent.
    pub agent: String,
    /// SHA-256 of the agent's configuration.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub configuration_sha256: String,
    /// Share of instances that pass.
    pub overall: f64,
    /// Wilson interval of that share at 95 % confidence.
    pub interval: Option<Interval>,
    /// Number of instances that pass.
    pub passed: u32,
    /// Number of instances that count.
    pub of: u32,
    /// Number of entries that the owner registered in this tier, finalized or not.
    pub attempts: usize,
    /// `transcript-committed` if every answer promised its transcript, otherwise `nonce-bound`.
    pub provenance: String,
    /// Number of transcripts that were shown and match their promised hash.
    pub transcripts_checked: usize,
    /// Identifiers of the entries behind the row.
    pub entries: Vec<String>,
}

impl Entrant {
    /// Returns the number of instances of the entry, including those of runs that were never drawn.
    const fn all(&self, per_run: u32) -> u32 {
        self.runs * per_run
    }

    fn has_transcripts(&self) -> bool {
        let mut answered = self.instances.iter().filter(|instance| instance.is_answered).peekable();
        answered.peek().is_some() && answered.all(|instance| instance.has_transcript)
    }

    /// Returns the entry as an attempt on the Ladder. Undrawn instances count as failed, half of them as deciding and
    /// half as shown.
    fn attempt(&self, per_run: u32) -> Attempt<'_> {
        let outcomes = self.instances.iter().map(|instance| (instance.salt.as_str(), instance.passes));
        let mut attempt = Attempt::of(&self.configuration_sha256, outcomes);
        let undrawn = self.all(per_run).saturating_sub(self.instances.len() as u32);
        attempt.deciding.of += undrawn.div_ceil(2);
        attempt.shown.of += undrawn / 2;
        attempt
    }
}

/// Computes the rows of a tier's entries, best first; `per_run` is the number of instances in a run.
#[must_use]
pub fn rows(tier: Tier, per_run: u32, entrants: Vec<Entrant>) -> Vec<Row> {
    let mut by_owner: BTreeMap<String, (usize, Vec<Entrant>)> = BTreeMap::new();
    for entrant in entrants {
        let own = by_owner.entry(entrant.owner.clone()).or_default();
        own.0 += 1;
        if entrant.completed_at_ms.is_some() {
            own.1.push(entrant);
        }
    }
    let mut rows: Vec<Row> = by_owner
        .into_values()
        .filter_map(|(attempts, mut own)| {
            own.sort_by(|a, b| (a.completed_at_ms, &a.id).cmp(&(b.completed_at_ms, &b.id)));
            row(tier, per_run, &own, attempts)
        })
        .collect();
    rows.sort_by(|a, b| b.overall.total_cmp(&a.overall).then_with(|| a.owner.cmp(&b.owner)));
    for i in 0..rows.len() {
        let ties = i > 0 && rows[i].interval.is_some_and(|own| own.high >= rows[rows[i - 1].rank - 1].overall);
        rows[i].rank = if ties { rows[i - 1].rank } else { i + 1 };
    }
    rows
}

/// Computes the row of an owner from its complete entries, which are in the order of their completion.
fn row(tier: Tier, per_run: u32, own: &[Entrant], attempts: usize) -> Option<Row> {
    let first = own.first()?;
    let (shown, named) = match tier {
        Tier::Official => {
            let passed = own.iter().flat_map(|own| &own.instances).filter(|instance| instance.passes).count() as u32;
            (Tally { passed, of: own.iter().map(|own| own.all(per_run)).sum() }, first)
        }
        Tier::Dev => {
            let attempts: Vec<Attempt<'_>> = own.iter().map(|own| own.attempt(per_run)).collect();
            let rung = climb(&attempts)?;
            (rung.shown, own.get(rung.attempt)?)
        }
    };
    let is_bound = own.iter().all(Entrant::has_transcripts);
    Some(Row {
        rank: 0,
        owner: first.owner.clone(),
        agent: named.agent.clone(),
        configuration_sha256: named.configuration_sha256.clone(),
        overall: shown.rate(),
        interval: wilson(shown.rate(), f64::from(shown.of)),
        passed: shown.passed,
        of: shown.of,
        attempts,
        provenance: if is_bound { "transcript-committed" } else { "nonce-bound" }.to_owned(),
        transcripts_checked: own.iter().flat_map(|own| &own.instances).filter(|instance| instance.is_checked).count(),
        entries: own.iter().map(|own| own.id.clone()).collect(),
    })
}

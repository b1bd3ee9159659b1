//! Computes the boards of an epoch from its entries and the outcomes of their instances. The service and the verifier
//! share this code.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::commitment::Commitment;
use super::feedback::{Feedback, Tier};
use super::gauge::{Gauge, Place, Tried};
use super::ladder::{Attempt, Tally, climb};
use crate::grading::statistics::interval::{Interval, anytime, wilson};

/// Probability that a board which is looked at again and again is ever misleading.
const ERROR: f64 = 0.05;

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
    /// Name of its family.
    pub family: String,
    /// Number of its run within the entry, from 1.
    pub run: u32,
    /// Whether it is a public sibling, which the gauge alone counts.
    pub is_sibling: bool,
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
    /// Interval of that share at 95 % confidence: Wilson's. On a dev board since version 2 of the protocol it holds at
    /// all looks together, whenever the entrant stopped.
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
    /// How much better the agent solves public siblings than hidden instances; absent without siblings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gauge: Option<Gauge>,
}

/// The rules that a board is made by.
#[derive(Debug, Clone, Copy)]
pub struct BoardRules {
    tier: Tier,
    per_run: u32,
    protocol: u32,
    /// Whether the epoch is over, in protocols whose last board differs.
    is_final: bool,
    /// Whether nothing was told of a dev entry before the epoch was over.
    is_untold: bool,
}

impl BoardRules {
    /// Returns the rules of a tier's board. `is_over`: the epoch is over, and its outcomes no longer change.
    #[must_use]
    pub fn of(commitment: &Commitment, tier: Tier, is_over: bool) -> Self {
        let protocol = commitment.protocol();
        let is_untold = commitment.dev_feedback == Feedback::AfterEpoch;
        Self { tier, per_run: commitment.instances_per_run, protocol, is_final: is_over && protocol >= 2, is_untold }
    }
}

impl Entrant {
    /// Returns the number of instances of the entry, including those of runs that were never drawn.
    const fn all(&self, per_run: u32) -> u32 {
        self.runs.saturating_mul(per_run)
    }

    fn has_transcripts(&self) -> bool {
        let mut answered = self.instances.iter().filter(|instance| instance.is_answered).peekable();
        answered.peek().is_some() && answered.all(|instance| instance.has_transcript)
    }

    /// Returns the entry as an attempt on the Ladder. Undrawn instances count as failed.
    fn attempt(&self, rules: &BoardRules) -> Attempt<'_> {
        let outcomes = self.instances.iter().map(|instance| (instance.salt.as_str(), instance.passes));
        let undrawn = self.all(rules.per_run).saturating_sub(self.instances.len() as u32);
        Attempt::of(rules.protocol, &self.configuration_sha256, outcomes, undrawn)
    }

    /// Returns the outcomes that the gauge is made of.
    fn outcomes(&self) -> impl Iterator<Item = (Place<'_>, Tried)> {
        self.instances.iter().map(|own| {
            let place = Place { entry: &self.id, run: own.run, family: &own.family };
            (place, Tried { is_sibling: own.is_sibling, is_answered: own.is_answered, passes: own.passes })
        })
    }
}

/// Computes the rows of a tier's entries, best first.
#[must_use]
pub fn rows(rules: &BoardRules, entrants: Vec<Entrant>) -> Vec<Row> {
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
            row(rules, &own, attempts)
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
fn row(rules: &BoardRules, own: &[Entrant], attempts: usize) -> Option<Row> {
    let first = own.first()?;
    let at_once = |tally: Tally| (tally, wilson(tally.rate(), f64::from(tally.of)));
    let ((shown, interval), named) = match rules.tier {
        Tier::Official => {
            let hidden = own.iter().flat_map(|own| &own.instances).filter(|instance| !instance.is_sibling);
            let passed = hidden.filter(|instance| instance.passes).count() as u32;
            let of = own.iter().fold(0_u32, |of, own| of.saturating_add(own.all(rules.per_run)));
            (at_once(Tally { passed, of }), first)
        }
        Tier::Dev => {
            let attempts: Vec<Attempt<'_>> = own.iter().map(|own| own.attempt(rules)).collect();
            let rung = climb(rules.protocol, &attempts)?;
            let mut tally = if rules.is_final { rung.kept } else { rung.shown };
            if rules.is_final && rules.is_untold {
                // Nothing was told, so nobody could wait for what would be shown either.
                tally.join(rung.shown);
            }
            // Each move of the board begins a new series, and gets a smaller part of the error: their sum is the error.
            let series = f64::from(rung.moves);
            let part = ERROR / (series * (series + 1.0));
            let shown = match rules.protocol {
                ..2 => at_once(tally),
                _ => (tally, anytime(tally.passed, tally.of, part)),
            };
            (shown, own.get(rung.attempt)?)
        }
    };
    let is_bound = own.iter().all(Entrant::has_transcripts);
    Some(Row {
        rank: 0,
        owner: first.owner.clone(),
        agent: named.agent.clone(),
        configuration_sha256: named.configuration_sha256.clone(),
        overall: shown.rate(),
        interval,
        passed: shown.passed,
        of: shown.of,
        attempts,
        provenance: if is_bound { "transcript-committed" } else { "nonce-bound" }.to_owned(),
        transcripts_checked: own.iter().flat_map(|own| &own.instances).filter(|instance| instance.is_checked).count(),
        entries: own.iter().map(|own| own.id.clone()).collect(),
        gauge: Gauge::of(own.iter().flat_map(Entrant::outcomes)),
    })
}

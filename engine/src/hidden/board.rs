//! The boards of an epoch, from its entries and what their instances came to: made by the service, and again by whoever verifies.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::feedback::Tier;
use super::ladder::{Attempt, Tally, climb};
use crate::grading::statistics::interval::{Interval, wilson};

/// An entry as a board sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entrant {
    /// Its id.
    pub id: String,
    /// Who registered it.
    pub owner: String,
    /// Who is evaluated.
    pub agent: String,
    /// SHA-256 of the configuration.
    pub configuration_sha256: String,
    /// Runs registered.
    pub runs: u32,
    /// When all its answers were graded; none while they are not, and then it is no row.
    pub completed_at_ms: Option<i64>,
    /// Its instances, in the order of issue.
    pub instances: Vec<Answered>,
}

/// An instance as a board sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a fact of its own")]
pub struct Answered {
    /// The instance's salt.
    pub salt: String,
    /// Whether its answer passes.
    pub passes: bool,
    /// Whether it has one.
    pub is_answered: bool,
    /// Whether a transcript was promised with it.
    pub has_transcript: bool,
    /// Whether that was shown.
    pub is_checked: bool,
}

/// A row: an owner's official entries taken together, or where the Ladder has an owner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = EpochRowBody)]
pub struct Row {
    /// Place; a row whose interval reaches the score of the first row of a place shares that place.
    pub rank: usize,
    /// Who registered.
    pub owner: String,
    /// Who was evaluated.
    pub agent: String,
    /// SHA-256 of its configuration.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub configuration_sha256: String,
    /// Share of instances that pass.
    pub overall: f64,
    /// Wilson interval of that share, 95 %.
    pub interval: Option<Interval>,
    /// Instances that pass.
    pub passed: u32,
    /// Instances that count.
    pub of: u32,
    /// Entries that the owner registered in this tier, finalized or not.
    pub attempts: usize,
    /// `nonce-bound` at least; `transcript-committed` where every answer promised its transcript.
    pub provenance: String,
    /// Transcripts that were shown and were those promised.
    pub transcripts_checked: usize,
    /// The entries behind the row.
    pub entries: Vec<String>,
}

impl Entrant {
    /// Instances of the entry, those of runs that were never drawn too.
    const fn all(&self, per_run: u32) -> u32 {
        self.runs * per_run
    }

    fn has_transcripts(&self) -> bool {
        let mut answered = self.instances.iter().filter(|instance| instance.is_answered).peekable();
        answered.peek().is_some() && answered.all(|instance| instance.has_transcript)
    }

    /// The entry as the Ladder sees it. What was not drawn failed, in equal parts of what decides and what is shown.
    fn attempt(&self, per_run: u32) -> Attempt<'_> {
        let outcomes = self.instances.iter().map(|instance| (instance.salt.as_str(), instance.passes));
        let mut attempt = Attempt::of(&self.configuration_sha256, outcomes);
        let undrawn = self.all(per_run).saturating_sub(self.instances.len() as u32);
        attempt.deciding.of += undrawn.div_ceil(2);
        attempt.shown.of += undrawn / 2;
        attempt
    }
}

/// The rows of a tier's entries, best first; `per_run` is how many instances a run has.
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

/// The row of an owner's complete entries, in the order in which they ended.
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

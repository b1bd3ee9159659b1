//! The model of hidden evaluation: one epoch at a time, its entries and their instances.

use std::collections::BTreeMap;

use plumbline::store::draws::DrawRefusal;
use plumbline::store::hidden_answers::AnswerRefusal;
use plumbline::store::registration::RegistrationRefusal;
use plumbline::store::states::SubmissionState;
use plumbline_engine::hidden::feedback::Tier;

use super::model::Model;

/// Specifications in the pool for each instance of a draw: the number of runs that an epoch holds.
pub const RUNS: u32 = 16;
/// Number of runs that one owner may hold.
pub const OWN_RUNS: i64 = 9;
/// Number of entries that an owner may register, in either tier.
pub const OWN_ENTRIES: [i64; 2] = [4, 3];
/// Time for which a run is reserved, for which an instance may be answered, and for which an epoch is open.
pub const RESERVED_MS: i64 = 60;
pub const INSTANCE_MS: i64 = 120;
pub const EPOCH_MS: i64 = 800;

#[derive(Debug, Clone)]
pub struct Epoch {
    pub id: String,
    pub closes_at_ms: i64,
    pub is_closed: bool,
    pub is_settled: bool,
}

impl Epoch {
    fn is_over(&self, now_ms: i64) -> bool {
        self.is_closed || now_ms >= self.closes_at_ms
    }
}

#[derive(Debug, Clone)]
pub struct Entry {
    pub owner: &'static str,
    pub tier: Tier,
    pub configuration: String,
    pub runs: u32,
    pub registered_at_ms: i64,
    /// Nonce of each run that was drawn.
    pub drawn: BTreeMap<u32, String>,
    pub is_finalized: bool,
    pub is_completed: bool,
}

impl Entry {
    fn reserved(&self, now_ms: i64) -> i64 {
        let has_ended = self.is_finalized || self.registered_at_ms + RESERVED_MS <= now_ms;
        if has_ended { 0 } else { i64::from(self.runs) - self.drawn.len() as i64 }
    }

    fn held(&self, now_ms: i64) -> i64 {
        self.drawn.len() as i64 + self.reserved(now_ms)
    }
}

#[derive(Debug, Clone)]
pub struct Instance {
    pub entry: String,
    pub run: u32,
    pub task_hash: String,
    pub expires_at_ms: i64,
    pub transcript: Option<String>,
}

/// Why runs do not fit.
enum NoRoom {
    Pool,
    Share,
}

#[derive(Debug, Default)]
pub struct Hidden {
    pub epoch: Option<Epoch>,
    pub entries: BTreeMap<String, Entry>,
    pub instances: BTreeMap<String, Instance>,
    /// Owner who first registered each configuration, in any epoch.
    holders: BTreeMap<String, &'static str>,
}

impl Hidden {
    pub fn begin(&mut self, id: &str, now_ms: i64) {
        let closes_at_ms = now_ms + EPOCH_MS;
        let epoch = Epoch { id: id.to_owned(), closes_at_ms, is_closed: false, is_settled: false };
        *self = Self { epoch: Some(epoch), holders: std::mem::take(&mut self.holders), ..Self::default() };
    }

    pub fn is_over(&self, now_ms: i64) -> bool {
        self.epoch.as_ref().is_none_or(|epoch| epoch.is_over(now_ms))
    }

    fn room_for(&self, owner: &str, tier: Tier, runs: u32, now_ms: i64) -> Result<(), NoRoom> {
        let held = |counts: &dyn Fn(&Entry) -> bool| -> i64 {
            self.entries.values().filter(|own| counts(own)).map(|own| own.held(now_ms)).sum()
        };
        let (all, runs) = (i64::from(RUNS), i64::from(runs));
        if held(&|own| own.owner == owner) + runs > OWN_RUNS {
            return Err(NoRoom::Share);
        }
        let is_dev_full = tier == Tier::Dev && held(&|own| own.tier == Tier::Dev) + runs > all / 2;
        if is_dev_full || held(&|_| true) + runs > all { Err(NoRoom::Pool) } else { Ok(()) }
    }

    pub fn register(&mut self, id: &str, new: Entry) -> Result<(), RegistrationRefusal> {
        let now_ms = new.registered_at_ms;
        if self.is_over(now_ms) {
            return Err(RegistrationRefusal::NotOpen);
        }
        let is_own = |own: &&Entry| own.owner == new.owner && own.tier == new.tier;
        let most = OWN_ENTRIES[usize::from(new.tier == Tier::Official)];
        if self.entries.values().filter(is_own).count() as i64 >= most {
            return Err(RegistrationRefusal::TooMany(most));
        }
        self.room_for(new.owner, new.tier, new.runs, now_ms).map_err(|full| match full {
            NoRoom::Pool => RegistrationRefusal::PoolUsedUp,
            NoRoom::Share => RegistrationRefusal::ShareUsedUp(OWN_RUNS),
        })?;
        if new.tier == Tier::Official {
            let first = |counts: &dyn Fn(&&Entry) -> bool| {
                self.entries.values().filter(counts).min_by_key(|own| own.registered_at_ms)
            };
            if let Some(own) = first(&|own| is_own(own)).filter(|own| own.configuration != new.configuration) {
                return Err(RegistrationRefusal::OtherConfiguration(own.configuration.clone()));
            }
            if self.holders.get(&new.configuration).is_some_and(|holder| *holder != new.owner) {
                return Err(RegistrationRefusal::ConfigurationTaken);
            }
        }
        self.holders.entry(new.configuration.clone()).or_insert(new.owner);
        self.entries.insert(id.to_owned(), new);
        Ok(())
    }

    /// Draws a run; true if its instances are new.
    pub fn draw(&mut self, entry_id: &str, run: u32, nonce: &str, now_ms: i64) -> Result<bool, DrawRefusal> {
        let entry = &self.entries[entry_id];
        if run == 0 || run > entry.runs {
            return Err(DrawRefusal::NoSuchRun);
        }
        if let Some(earlier) = entry.drawn.get(&run) {
            return if earlier == nonce { Ok(false) } else { Err(DrawRefusal::OtherNonce) };
        }
        if entry.is_finalized || self.is_over(now_ms) {
            return Err(DrawRefusal::Closed);
        }
        if entry.reserved(now_ms) == 0 {
            self.room_for(entry.owner, entry.tier, 1, now_ms).map_err(|full| match full {
                NoRoom::Pool => DrawRefusal::Exhausted,
                NoRoom::Share => DrawRefusal::ShareUsedUp(OWN_RUNS),
            })?;
        }
        self.entries.get_mut(entry_id).expect("the entry is known").drawn.insert(run, nonce.to_owned());
        Ok(true)
    }
}

impl Model {
    /// The submission that counts as the answer to an instance.
    fn answer_to(&self, instance: &str) -> Option<String> {
        let counts = |own: &super::model::Submission| own.instance.as_deref() == Some(instance) && !own.superseded;
        self.submissions.iter().find(|(_, own)| counts(own)).map(|(id, _)| id.clone())
    }

    /// Answers an instance; true if the answer is new, false if it is the same once more. The submission is stored if
    /// it is to be graded.
    pub fn answer_instance(
        &mut self,
        instance_id: &str,
        new: &plumbline::store::submissions::NewSubmission,
        transcript: Option<&str>,
        now_ms: i64,
    ) -> Result<bool, AnswerRefusal> {
        let instance = self.hidden.instances[instance_id].clone();
        let entry = &self.hidden.entries[&instance.entry];
        let before = self.answer_to(instance_id);
        let mut takes_over = None;
        if let Some(id) = before {
            if self.submissions[&id].log != new.log_hash {
                return Err(AnswerRefusal::OtherLog);
            }
            if transcript.is_some() && transcript != instance.transcript.as_deref() {
                return Err(AnswerRefusal::OtherTranscript(instance.transcript));
            }
            if self.submissions[&id].state != SubmissionState::GraderError {
                return Ok(false);
            }
            if entry.is_completed {
                return Err(AnswerRefusal::Closed);
            }
            takes_over = Some(id);
        } else if entry.is_finalized || self.hidden.is_over(now_ms) {
            return Err(AnswerRefusal::Closed);
        } else if now_ms >= instance.expires_at_ms {
            return Err(AnswerRefusal::Expired);
        } else if !self.reserve(new.owner.as_deref()) {
            return Err(AnswerRefusal::QuotaUsedUp);
        }
        if takes_over.is_none() {
            let known = self.hidden.instances.get_mut(instance_id).expect("the instance is known");
            known.transcript = transcript.map(str::to_owned);
        }
        if let Some(id) = &takes_over {
            self.at(id).superseded = true;
        }
        self.put(new, Some(instance_id.to_owned()));
        Ok(takes_over.is_none())
    }

    pub fn finalize(&mut self, entry: &str) -> bool {
        !std::mem::replace(&mut self.hidden.entries.get_mut(entry).expect("the entry is known").is_finalized, true)
    }

    /// Completes entries that may be.
    pub fn complete_entries(&mut self, now_ms: i64) {
        let is_over = self.hidden.is_over(now_ms);
        let waiting: Vec<String> = self
            .hidden
            .entries
            .iter()
            .filter(|(_, own)| own.is_finalized && !own.is_completed)
            .map(|(id, _)| id.clone())
            .collect();
        for id in waiting {
            let answers: Vec<(Option<String>, SubmissionState)> = self
                .submissions
                .values()
                .filter(|own| !own.superseded)
                .filter(|own| own.instance.as_ref().is_some_and(|instance| self.hidden.instances[instance].entry == id))
                .map(|own| (own.owner.clone(), own.state))
                .collect();
            let may = |state: SubmissionState| match state {
                SubmissionState::Graded => true,
                SubmissionState::GraderError => is_over,
                _ => false,
            };
            if answers.iter().all(|(_, state)| may(*state)) {
                self.hidden.entries.get_mut(&id).expect("the entry is known").is_completed = true;
                for (owner, state) in answers {
                    self.settle_unit(owner.as_deref(), state == SubmissionState::Graded);
                }
            }
        }
    }

    pub fn settle(&mut self, now_ms: i64) {
        let is_due = self.hidden.epoch.as_ref().is_some_and(|epoch| epoch.is_over(now_ms) && !epoch.is_settled);
        if !is_due {
            return;
        }
        for entry in self.hidden.entries.values_mut() {
            entry.is_finalized = true;
        }
        self.complete_entries(now_ms);
        let is_settled = self.hidden.entries.values().all(|own| own.is_completed);
        let epoch = self.hidden.epoch.as_mut().expect("there is an epoch that is due");
        (epoch.is_closed, epoch.is_settled) = (true, is_settled);
    }
}

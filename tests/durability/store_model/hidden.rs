//! Steps of hidden evaluation.

use std::sync::Arc;

use plumbline::app::hidden::acceptance::decide_answer;
use plumbline::app::hidden::completion::{publish, settle_epochs};
use plumbline::app::hidden::draw::decide_draw;
use plumbline::app::hidden::registration::decide_registration;
use plumbline::app::submissions::decision::decide_all;
use plumbline::store::draws::{Issued, NewDraw};
use plumbline::store::epochs::{EpochRules, HIDDEN_SUITE};
use plumbline::store::hidden_answers::{Answered, NewAnswer};
use plumbline::store::queue::Lane;
use plumbline::store::registration::{NewEntry, Registered};
use plumbline::store::secrets::{EpochSecret, PoolFile};
use plumbline_engine::hidden::commitment::{Commitment, Rules, Terms, root_of};
use plumbline_engine::hidden::feedback::{Feedback, Tier};
use plumbline_engine::hidden::issue::Lot;
use plumbline_engine::hidden::secret::EpochKey;
use plumbline_engine::hidden::{GENERATOR_VERSION, PROTOCOL};
use plumbline_engine::voxel::Profile;

use super::Scene;
use super::hidden_model::{EPOCH_MS, Entry, INSTANCE_MS, Instance, OWN_ENTRIES, OWN_RUNS, RESERVED_MS, RUNS};

/// Owners of entries.
const OWNERS: [&str; 3] = ["ada", "bea", "cem"];

/// Draws the secret that all epochs of a sequence use: it takes long.
pub fn secret() -> EpochSecret {
    let key = EpochKey::new([7; 32]);
    let pool = PoolFile::draw(GENERATOR_VERSION, &key, RUNS, &|| ()).unwrap();
    EpochSecret { pool_key: key.clone(), key, pool }
}

impl Scene {
    /// Does one thing of hidden evaluation.
    pub(super) async fn hidden_step(&mut self) {
        let is_settled = self.model.hidden.epoch.as_ref().is_none_or(|epoch| epoch.is_settled);
        match self.below(100) {
            _ if is_settled => self.open_epoch().await,
            0..8 => self.register().await,
            8..20 => self.draw().await,
            20..50 => self.answer().await,
            50..80 => self.claim_from(&[Lane::Hidden]).await,
            80..84 => self.finalize().await,
            84..92 => self.publish().await,
            92..99 => self.settle().await,
            _ => self.close_epoch().await,
        }
    }

    async fn open_epoch(&mut self) {
        let name = format!("epoch-{}", self.now_ms);
        let rules = EpochRules {
            instance_ms: INSTANCE_MS,
            dev_entries: OWN_ENTRIES[0],
            official_entries: OWN_ENTRIES[1],
            // The budget of bits has tests of its own.
            budget_bits: 1e9,
            owner_runs: Some(OWN_RUNS),
            reservation_ms: Some(RESERVED_MS),
        };
        let terms = Terms {
            epoch: name.clone(),
            opens_at_ms: self.now_ms,
            closes_at_ms: self.now_ms + EPOCH_MS,
            per_instance: RUNS,
            dev_feedback: Feedback::ScoreOnly,
            rules: Rules {
                instance_seconds: 1,
                dev_entries_per_owner: OWN_ENTRIES[0] as u32,
                official_entries_per_owner: OWN_ENTRIES[1] as u32,
                runs_per_owner: OWN_RUNS as u32,
                reservation_seconds: 1,
                budget_bits: 1_000_000,
                receipt_key: self.store.secrets().signer().unwrap().public_key(),
                profile: Profile::Mindcraft,
                protocol: PROTOCOL,
            },
            beacon: None,
            siblings: None,
        };
        let EpochSecret { key, pool, .. } = &*self.secret;
        let commitment = Commitment::to(&terms, key, &pool.strata, Some(root_of(key, &pool.specifications)));
        assert!(self.store.create_epoch(&commitment, &rules, &self.secret, self.now_ms).await.unwrap());
        self.model.forget_instances();
        self.model.hidden.begin(&name, self.now_ms);
    }

    fn some_entry(&mut self) -> Option<String> {
        let number = self.random.next_u64();
        super::model::some(self.model.hidden.entries.keys(), number)
    }

    async fn register(&mut self) {
        let epoch_id = self.model.hidden.epoch.as_ref().unwrap().id.clone();
        let (id, owner) = (uuid::Uuid::now_v7().to_string(), OWNERS[self.below(OWNERS.len())]);
        let tier = [Tier::Dev, Tier::Official][self.below(2)];
        let configuration = if self.below(3) == 0 { "shared" } else { owner };
        let runs = 1 + self.below(4) as u32;
        let new = NewEntry {
            id: &id,
            epoch_id: &epoch_id,
            owner,
            agent: configuration,
            configuration_hash: configuration,
            tier,
            runs,
        };
        let found = self.store.register_entry(&new, None, decide_registration, self.now_ms).await.unwrap();
        let entry = Entry {
            owner,
            tier,
            configuration: configuration.to_owned(),
            runs,
            registered_at_ms: self.now_ms,
            drawn: std::collections::BTreeMap::new(),
            is_finalized: false,
            is_completed: false,
        };
        let expected = self.model.hidden.register(&id, entry);
        assert_eq!(found, expected.map_or_else(Registered::Refused, |()| Registered::New));
    }

    async fn draw(&mut self) {
        let Some(entry_id) = self.some_entry() else { return };
        let run = self.below(6) as u32;
        let nonce = ["one", "other"][usize::from(self.below(5) == 0)];
        let row = self.store.entry(&entry_id).await.unwrap().unwrap();
        let epoch = self.store.epoch(&row.epoch_id).await.unwrap().unwrap();
        let secret = Arc::clone(&self.secret);
        let lot = Lot::of(&epoch.commitment, &secret.key, &entry_id, run, nonce);
        let new = NewDraw { entry_id: &entry_id, run, nonce, secret: &secret, lot: &lot, siblings: None };
        let found = self.store.issue_instances(&new, decide_draw, self.now_ms).await.unwrap();
        let rows = match (found, self.model.hidden.draw(&entry_id, run, nonce, self.now_ms)) {
            (Issued::Refused(found), Err(expected)) => return assert_eq!(found, expected),
            (Issued::Instances(rows, receipt), Ok(false)) => {
                assert!(receipt.is_some(), "a repeated draw has the receipt of the first");
                let drawn = self.model.hidden.instances.iter();
                let mut expected: Vec<&String> =
                    drawn.filter(|(_, own)| own.entry == entry_id && own.run == run).map(|(id, _)| id).collect();
                let mut found: Vec<&String> = rows.iter().map(|row| &row.id).collect();
                expected.sort();
                found.sort();
                return assert!(!found.is_empty() && found == expected, "{found:?}, not {expected:?}");
            }
            (Issued::Instances(rows, receipt), Ok(true)) => {
                assert!(receipt.is_some(), "a draw has a receipt");
                rows
            }
            (found, expected) => panic!("{found:?}, not {expected:?}"),
        };
        assert_eq!(rows.len(), epoch.commitment.instances_per_run as usize);
        for row in rows {
            assert!(row.expires_at_ms == epoch.commitment.closes_at_ms.min(self.now_ms + INSTANCE_MS), "{row:?}");
            let instance = Instance {
                entry: entry_id.clone(),
                run,
                task_hash: row.task_hash,
                expires_at_ms: row.expires_at_ms,
                transcript: None,
            };
            assert!(self.model.hidden.instances.insert(row.id, instance).is_none());
        }
    }

    async fn answer(&mut self) {
        let number = self.random.next_u64();
        let Some(id) = super::model::some(self.model.hidden.instances.keys(), number) else { return };
        let instance = &self.model.hidden.instances[&id];
        let (owner, task_hash) = (self.model.hidden.entries[&instance.entry].owner, instance.task_hash.clone());
        let mut submission = self.submission(None, Some(owner));
        (submission.suite_id, submission.task_hash, submission.lane) =
            (HIDDEN_SUITE.to_owned(), task_hash, Lane::Hidden);
        // Most repeat what was said first.
        ["one", "other"][usize::from(self.below(5) == 0)].clone_into(&mut submission.log_hash);
        let transcript = [None, Some("shown"), Some("another")][self.below(3)];
        let new = NewAnswer { instance_id: &id, submission: &submission, transcript_hash: transcript };
        let found = self.store.answer_instance(&new, decide_answer, decide_all, self.now_ms).await.unwrap();
        match (&found, self.model.answer_instance(&id, &submission, transcript, self.now_ms)) {
            (Answered::New(_), Ok(true)) | (Answered::Same(Some(_)), Ok(false)) => {}
            (Answered::Refused(found), Err(expected)) => assert_eq!(*found, expected),
            (found, expected) => panic!("{found:?}, not {expected:?}"),
        }
    }

    async fn finalize(&mut self) {
        let Some(entry) = self.some_entry() else { return };
        let expected = self.model.finalize(&entry);
        assert_eq!(self.store.finalize_entry(&entry, self.now_ms).await.unwrap(), expected);
    }

    async fn publish(&mut self) {
        publish(&self.store, self.now_ms).await.unwrap();
        self.model.complete_entries(self.now_ms);
    }

    async fn settle(&mut self) {
        settle_epochs(&self.store, self.now_ms).await.unwrap();
        self.model.settle(self.now_ms);
    }

    async fn close_epoch(&mut self) {
        let id = self.model.hidden.epoch.as_ref().unwrap().id.clone();
        let expected = !self.model.hidden.is_over(self.now_ms);
        assert_eq!(self.store.close_epoch(&id, "for the test", self.now_ms).await.unwrap(), expected);
        self.model.hidden.epoch.as_mut().unwrap().is_closed |= expected;
    }

    /// Compares what is stored of hidden evaluation.
    pub(super) async fn compare_hidden(&self) {
        let Some(expected) = &self.model.hidden.epoch else { return };
        let found = self.store.epoch(&expected.id).await.unwrap().unwrap();
        let found = (found.closed.is_some(), found.settled_at_ms.is_some());
        assert_eq!(found, (expected.is_closed, expected.is_settled), "{expected:?}");
        for (id, expected) in &self.model.hidden.entries {
            let found = self.store.entry(id).await.unwrap().unwrap();
            let found = (found.finalized_at_ms.is_some(), found.completed_at_ms.is_some());
            assert_eq!(found, (expected.is_finalized, expected.is_completed), "{id}: {expected:?}");
            let outcomes = self.store.outcomes_of_entry(id).await.unwrap();
            assert_eq!(outcomes.len(), self.model.hidden.instances.values().filter(|own| own.entry == *id).count());
            for outcome in outcomes {
                let graded = self.model.graded_answer(&outcome.instance);
                let variant = outcome.scores.map(|scores| self.variant_of(1, &scores));
                assert_eq!(variant, graded, "{}", outcome.instance);
            }
        }
    }

    /// Closes the epoch, so that it can be settled once its answers are graded.
    pub(super) async fn end_epoch(&mut self) {
        if self.model.hidden.epoch.is_some() {
            self.close_epoch().await;
        }
    }
}

//! Feedback to entrants: its content and its timing. All feedback on hidden instances passes through the function
//! [`told`].

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::checks::Criterion;
use crate::grading::ProblemScores;

/// Amount of feedback on a finalized entry while its epoch is open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Feedback {
    /// No feedback before the epoch is over.
    AfterEpoch,
    /// The number of instances that pass and the total number.
    ScoreOnly,
    /// The same, and for each criterion the number of instances that pass and the number to which it applies.
    Criteria,
    /// Everything, including each check's measured and required values.
    Full,
}

/// Tier of an entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Tier {
    /// For development: fresh draws, coarse feedback, and a board kept by the Ladder.
    Dev,
    /// Pre-registered: the score is published after the epoch closes and ranked with its confidence interval.
    Official,
}

impl Tier {
    /// Both tiers.
    pub const ALL: [Self; 2] = [Self::Dev, Self::Official];

    /// Returns the name of the tier, as it appears in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dev => "dev",
            Self::Official => "official",
        }
    }

    /// Returns the feedback on entries of this tier while the epoch is open; `dev` is the level set for the dev tier.
    #[must_use]
    pub const fn feedback(self, dev: Feedback) -> Feedback {
        match self {
            Self::Dev => dev,
            Self::Official => Feedback::AfterEpoch,
        }
    }
}

/// What the outcome of an instance counts for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Counts {
    /// For the score, which is told as the tier's feedback says.
    Told,
    /// For the final board of the dev tier: it is told only when the epoch is over.
    Kept,
    /// For the gauge alone.
    Sibling,
}

/// The outcome of one instance of a finalized entry. An unanswered instance has no scores and counts as failed.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// What it counts for.
    pub counts: Counts,
    /// Identifier of the instance.
    pub instance: String,
    /// Scores of the checks; `None` without a graded answer.
    pub scores: Option<ProblemScores>,
}

impl Outcome {
    /// Returns whether the instance passes.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.scores.as_ref().is_some_and(ProblemScores::overall)
    }
}

/// Builds the feedback on an entry: null while nothing may be released, and everything once the epoch is over.
#[must_use]
pub fn told(feedback: Feedback, is_epoch_over: bool, outcomes: &[Outcome]) -> Value {
    let level = if is_epoch_over { Feedback::Full } else { feedback };
    if level == Feedback::AfterEpoch {
        return Value::Null;
    }
    let (siblings, hidden): (Vec<&Outcome>, Vec<&Outcome>) =
        outcomes.iter().partition(|own| own.counts == Counts::Sibling);
    let (kept, hidden): (Vec<&Outcome>, Vec<&Outcome>) =
        hidden.into_iter().partition(|own| own.counts == Counts::Kept && !is_epoch_over);
    let passed = hidden.iter().filter(|outcome| outcome.passes()).count();
    let mut told =
        json!({ "passed": passed, "of": hidden.len(), "overall": passed as f64 / hidden.len().max(1) as f64 });
    if !kept.is_empty() {
        told["told_later"] = kept.len().into();
    }
    if !siblings.is_empty() {
        let passed = siblings.iter().filter(|outcome| outcome.passes()).count();
        told["siblings"] = json!({ "passed": passed, "of": siblings.len() });
    }
    if level >= Feedback::Criteria {
        // The criteria of unanswered instances are unknown, so these instances count in the score only.
        let per_criterion = Criterion::ALL.into_iter().map(|criterion| {
            let answered = hidden.iter().filter_map(|outcome| outcome.scores.as_ref());
            let holds: Vec<bool> = answered.filter_map(|scores| scores.holds(|own| own == criterion)).collect();
            let passed = holds.iter().filter(|holds| **holds).count();
            (criterion.name().to_owned(), json!({ "passed": passed, "of": holds.len() }))
        });
        told["criteria"] = Value::Object(per_criterion.collect());
    }
    if level == Feedback::Full {
        let each = |outcome: &&Outcome| {
            let mut own = json!({ "instance": outcome.instance, "passes": outcome.passes(),
                                  "answered": outcome.scores.is_some() });
            if outcome.counts == Counts::Sibling {
                own["sibling"] = true.into();
            }
            own
        };
        told["instances"] = hidden.iter().chain(&siblings).map(each).collect();
    }
    told
}

/// Returns an upper bound on the bits released by publishing the result of an entry with `answered` answers: the base-2
/// logarithm of the number of possible results. The board shows the score of one part beside that of all that is told.
/// With d and s answers in the two parts there are (d + 1)(s + 1) results, at most (n/2 + 1)² as d + s is at most n.
#[must_use]
pub fn released_bits(feedback: Feedback, answered: usize) -> f64 {
    let score = 2.0 * (answered as f64 / 2.0 + 1.0).log2();
    match feedback {
        Feedback::AfterEpoch => 0.0,
        Feedback::ScoreOnly => score,
        Feedback::Criteria => score * (1 + Criterion::ALL.len()) as f64,
        // Covers at least the verdict on each instance; the information in its evidence cannot be counted.
        Feedback::Full => answered as f64 * 64.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcomes() -> Vec<Outcome> {
        let scores = |score: f64| Some(ProblemScores { number: 1, rows: vec![(Criterion::Shape, score)] });
        let outcome = |scores| Outcome { counts: Counts::Told, instance: "i".to_owned(), scores };
        vec![outcome(scores(1.0)), outcome(scores(0.5)), outcome(None)]
    }

    #[test]
    fn each_level_tells_more_than_the_one_before() {
        let told = |feedback| told(feedback, false, &outcomes());
        assert_eq!(told(Feedback::AfterEpoch), Value::Null);
        assert_eq!(told(Feedback::ScoreOnly), json!({ "passed": 1, "of": 3, "overall": 1.0 / 3.0 }));
        assert_eq!(told(Feedback::Criteria)["criteria"]["shape"], json!({ "passed": 1, "of": 2 }));
        assert!(told(Feedback::Criteria).get("instances").is_none());
        assert_eq!(told(Feedback::Full)["instances"].as_array().unwrap().len(), 3);
    }

    #[test]
    fn what_is_kept_is_told_after_the_epoch_alone_and_siblings_apart() {
        let [mut kept, mut sibling, told_now] = <[Outcome; 3]>::try_from(outcomes()).unwrap();
        (kept.counts, sibling.counts) = (Counts::Kept, Counts::Sibling);
        let all = [kept, sibling, told_now];
        let open = told(Feedback::ScoreOnly, false, &all);
        let siblings = json!({ "passed": 0, "of": 1 });
        assert_eq!(open, json!({ "passed": 0, "of": 1, "overall": 0.0, "told_later": 1, "siblings": siblings }));
        let over = told(Feedback::ScoreOnly, true, &all);
        assert_eq!((&over["passed"], &over["of"], &over["told_later"]), (&json!(1), &json!(2), &Value::Null));
        assert_eq!(over["instances"][2]["sibling"], json!(true));
    }

    #[test]
    fn after_the_epoch_everything_is_told() {
        assert!(told(Feedback::AfterEpoch, true, &outcomes())["instances"].is_array());
    }
}

//! Standings: the finished runs of a suite, ordered and compared.

use std::collections::HashMap;
use std::sync::Arc;

use super::fingerprints::Fingerprint;
use super::outcomes::{Outcomes, Places};
use super::statistics::comparison::McNemar;
use super::statistics::interval::{Interval, clustered};
use super::statistics::ranks::{Comparisons, RankRange, range};
use super::summary::Summary;
use crate::tasks::{Task, Track};

/// Facts about a suite's tasks that standings need.
#[derive(Debug)]
pub struct Field {
    /// Number of the cluster of each task; tasks that are wordings of one problem share a cluster.
    cluster_of: Vec<usize>,
    clusters: usize,
    /// Name of the wording of each task; `None` if its problem has only one.
    wordings: Vec<Option<String>>,
    test: McNemar,
}

impl Field {
    /// Derives the facts from the tasks of a suite, in its order.
    #[must_use]
    pub fn of(tasks: &[Task]) -> Self {
        let mut numbers: HashMap<String, usize> = HashMap::new();
        let mut members: Vec<Vec<&str>> = Vec::new();
        let mut cluster_of = Vec::with_capacity(tasks.len());
        for task in tasks {
            let next = numbers.len();
            let number = *numbers.entry(problem(task)).or_insert(next);
            if number == members.len() {
                members.push(Vec::new());
            }
            members[number].push(&task.id);
            cluster_of.push(number);
        }
        let heads: Vec<Option<usize>> = members.iter().map(|ids| common_head(ids)).collect();
        let wording = |(task, cluster): (&Task, &usize)| heads[*cluster].map(|head| task.id[head..].to_owned());
        Self {
            wordings: tasks.iter().zip(&cluster_of).map(wording).collect(),
            clusters: members.len(),
            cluster_of,
            test: McNemar::up_to(tasks.len()),
        }
    }

    /// Returns the name of the wording of the task at this position, or `None` if its problem has only one.
    #[must_use]
    pub fn wording(&self, place: usize) -> Option<&str> {
        self.wordings[place].as_deref()
    }

    /// Returns the 95 % interval of the share of tasks solved. Unanswered tasks count as not solved.
    #[must_use]
    pub fn interval(&self, outcomes: &Outcomes) -> Option<Interval> {
        let solved: Vec<f64> =
            (0..self.cluster_of.len()).map(|place| f64::from(u8::from(outcomes.is_solved(place)))).collect();
        self.interval_of_mean(&solved)
    }

    /// Returns the 95 % interval of the mean of values from 0 to 1, one for each task.
    ///
    /// Wilson's interval supposes values of 0 and 1, which vary most, so that it is too wide for others.
    #[must_use]
    pub fn interval_of_mean(&self, values: &[f64]) -> Option<Interval> {
        let mut clusters = vec![(0.0, 0_u32); self.clusters];
        for (value, cluster) in values.iter().zip(&self.cluster_of) {
            let (sum, of) = &mut clusters[*cluster];
            *sum += value;
            *of += 1;
        }
        clustered(&clusters)
    }

    /// Compares two runs on the tasks that both answered or skipped. Returns the p-value, and the numbers of tasks that
    /// only the one and only the other solves.
    #[must_use]
    pub fn compare(&self, one: &Standing, other: &Standing) -> (f64, usize, usize) {
        let (only_one, only_other) = Places::discordant((&one.solved, &one.answered), (&other.solved, &other.answered));
        (self.test.p_value(only_one, only_other), only_one, only_other)
    }

    /// Returns the range of ranks that a run may have among others, if p-values up to `threshold` show a difference.
    #[must_use]
    pub fn places(&self, one: &Standing, all: &[Arc<Standing>], threshold: f64) -> RankRange {
        let tested = all.iter().filter(|other| other.run != one.run && one.can_be_compared(other));
        let others = tested.map(|other| {
            if let Some(p) = self.decided(one, other, threshold) {
                return (other.solved_count > one.solved_count, p);
            }
            let (p, only_one, only_other) = self.compare(one, other);
            (only_other > only_one, p)
        });
        range(others, threshold)
    }

    /// Returns a p-value on the same side of `threshold` as that of two runs, if the numbers of tasks solved decide it.
    /// For runs that cover all tasks, the numbers of tasks that only the one and only the other solves have a known
    /// difference, and the p-value grows with their sum. This saves most of the counting.
    fn decided(&self, one: &Standing, other: &Standing, threshold: f64) -> Option<f64> {
        if !(one.is_whole && other.is_whole) {
            return None;
        }
        let difference = one.solved_count.abs_diff(other.solved_count);
        let least = self.test.p_value(difference, 0);
        if least > threshold {
            return Some(least);
        }
        // The sum is greatest if no task is solved by both.
        let most = (one.solved_count + other.solved_count).min(one.outcomes.len());
        let shared = (most - difference) / 2;
        let greatest = self.test.p_value(shared + difference, shared);
        (greatest <= threshold).then_some(greatest)
    }

    /// Adds a run's comparisons with others, or takes them back if `is_new` is false.
    pub fn count(&self, comparisons: &mut Comparisons, one: &Standing, others: &[Arc<Standing>], is_new: bool) {
        for other in others.iter().filter(|other| one.can_be_compared(other)) {
            let (_, only_one, only_other) = self.compare(one, other);
            // No test can distinguish runs that solve the same tasks, so such a pair is no hypothesis (Tarone,
            // Biometrics 46, 1990, 515-522), and no number of empty runs makes it harder to distinguish others.
            if only_one + only_other == 0 {
                continue;
            }
            comparisons.count(&self.test, only_one, only_other, is_new);
        }
    }

    /// Returns the greatest p-value that shows a difference.
    #[must_use]
    pub fn threshold(&self, comparisons: &Comparisons) -> f64 {
        comparisons.threshold(&self.test)
    }
}

/// Returns a key of the task's problem that is the same for all its wordings.
fn problem(task: &Task) -> String {
    if task.parameters.is_empty() {
        return task.id.clone();
    }
    format!("{}/{}", task.family(), serde_json::to_string(&task.parameters).expect("parameters are JSON"))
}

/// Returns the offset at which the wordings of these ids begin: after the last dash of their common beginning.
fn common_head(ids: &[&str]) -> Option<usize> {
    let [first, rest @ ..] = ids else { return None };
    if rest.is_empty() {
        return None;
    }
    let shared = |id: &&str| first.bytes().zip(id.bytes()).take_while(|(a, b)| a == b).count();
    let most = rest.iter().map(shared).min()?;
    first[..most].rfind('-').map(|dash| dash + 1)
}

/// A finished run, ready to be compared.
#[derive(Debug, Clone)]
pub struct Standing {
    finished: Finished,
    /// The 95 % interval of its overall rate.
    pub interval: Option<Interval>,
    solved: Places,
    answered: Places,
    solved_count: usize,
    is_whole: bool,
}

/// A finished run as it is stored.
#[derive(Debug, Clone)]
pub struct Finished {
    /// Identifier of the run.
    pub run: String,
    /// Name of the agent that built.
    pub agent: String,
    /// Time from which this result holds, in milliseconds since 1970.
    pub since_ms: i64,
    /// Time at which the run finished, in milliseconds since 1970.
    pub finished_at_ms: i64,
    /// Summary of the run.
    pub summary: Summary,
    /// Outcome of the run on each task.
    pub outcomes: Outcomes,
    /// Owner who began the run; `None` if the service was open to everybody.
    pub owner: Option<String>,
    /// Origin of its logs, such as `self-reported`.
    pub provenance: String,
    /// Profile of its submissions: its name, or `mixed`.
    pub profile: String,
    /// Track of its prompts.
    pub track: Track,
    /// End of its embargo, in milliseconds since 1970; until then, `agent` is an alias.
    pub anonymous_until_ms: Option<i64>,
    /// Fingerprint of its logs; `None` if the run finished before fingerprints were stored.
    pub fingerprint: Option<Fingerprint>,
}

impl Finished {
    /// Returns whether the run has another owner than `other` and is near-identical with it.
    #[must_use]
    pub fn resembles(&self, other: &Self) -> bool {
        let are_near = || self.fingerprint.as_ref().zip(other.fingerprint.as_ref()).is_some_and(|(a, b)| a.is_near(b));
        self.owner != other.owner && are_near()
    }
}

impl std::ops::Deref for Standing {
    type Target = Finished;

    fn deref(&self) -> &Finished {
        &self.finished
    }
}

impl Standing {
    /// Returns the standing after its embargo: with the name of the agent.
    #[must_use]
    pub fn revealed(&self, agent: &str) -> Self {
        let finished = Finished { agent: agent.to_owned(), anonymous_until_ms: None, ..self.finished.clone() };
        Self { finished, ..self.clone() }
    }

    /// Prepares a finished run for comparisons.
    #[must_use]
    pub fn of(field: &Field, finished: Finished) -> Self {
        let outcomes = &finished.outcomes;
        let tasks = outcomes.len();
        Self {
            interval: field.interval(outcomes),
            solved: Places::picked(tasks, |place| outcomes.is_solved(place)),
            answered: Places::picked(tasks, |place| outcomes.is_answered(place) || outcomes.is_skipped(place)),
            solved_count: (0..tasks).filter(|place| outcomes.is_solved(*place)).count(),
            is_whole: outcomes.covered() == tasks,
            finished,
        }
    }

    /// Returns whether both runs were prompted alike, and answered or skipped some task in common. Otherwise nothing is
    /// known about which is better.
    fn can_be_compared(&self, other: &Self) -> bool {
        if self.track != other.track {
            return false;
        }
        (self.is_whole && other.is_whole && !self.outcomes.is_empty()) || self.answered.common(&other.answered) > 0
    }

    /// Returns whether the run answered, or skipped on purpose, at least this share of the tasks.
    #[must_use]
    pub fn covers(&self, share: f64) -> bool {
        self.outcomes.covered() as f64 + 1e-9 >= share * self.outcomes.len() as f64
    }

    /// Counts the tasks that the run skips.
    #[must_use]
    pub fn skipped(&self) -> usize {
        (0..self.outcomes.len()).filter(|place| self.outcomes.is_skipped(*place)).count()
    }

    /// Returns the share of tasks solved, or `None` without tasks.
    #[must_use]
    pub fn rate(&self) -> Option<f64> {
        self.summary.problem_level.overall.rate
    }

    /// Counts the tasks that were answered and graded.
    #[must_use]
    pub fn answered(&self) -> usize {
        (0..self.outcomes.len()).filter(|place| self.outcomes.is_answered(*place)).count()
    }
}

/// Sorts runs by their rate, the best first. Runs with equal rates are sorted by the time at which they finished.
pub fn order(standings: &mut [Arc<Standing>]) {
    let rate = |standing: &Standing| standing.rate().unwrap_or(-1.0);
    standings.sort_by(|a, b| {
        rate(b).total_cmp(&rate(a)).then(a.finished_at_ms.cmp(&b.finished_at_ms)).then_with(|| a.run.cmp(&b.run))
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checks::Criterion;
    use crate::grading::ProblemScores;
    use crate::tasks::embedded;

    #[test]
    fn wordings_of_a_problem_are_one_cluster() {
        let suite = embedded::latest().unwrap();
        let field = Field::of(&suite.tasks);
        let place = |id: &str| suite.tasks.iter().position(|task| task.id == id).unwrap();
        let [raise, courses, other] = ["walls/5x1x5-raise", "walls/5x1x5-courses", "walls/7x1x5-raise"].map(place);
        assert_eq!(field.cluster_of[raise], field.cluster_of[courses]);
        assert_ne!(field.cluster_of[raise], field.cluster_of[other]);
        assert_eq!([field.wording(raise), field.wording(courses)], [Some("raise"), Some("courses")]);
        assert!(field.clusters < suite.tasks.len());
        assert_eq!(suite.tasks.len(), field.wordings.len());
    }

    #[test]
    fn runs_that_the_data_cannot_separate_share_places() {
        let suite = embedded::latest().unwrap();
        let tasks = &suite.tasks[..100];
        let field = Field::of(tasks);
        let run = |name: &str, solved: std::ops::Range<usize>| {
            let problems: Vec<ProblemScores> = tasks
                .iter()
                .enumerate()
                .map(|(place, task)| ProblemScores {
                    number: task.number,
                    rows: vec![(Criterion::Shape, f64::from(u8::from(solved.contains(&place))))],
                })
                .collect();
            let finished = Finished {
                run: name.to_owned(),
                agent: name.to_owned(),
                since_ms: 0,
                finished_at_ms: 0,
                summary: Summary::of(&problems),
                outcomes: Outcomes::of(tasks, &problems, &[]),
                owner: None,
                provenance: String::new(),
                profile: String::new(),
                track: Track::Specified,
                anonymous_until_ms: None,
                fingerprint: None,
            };
            let outcomes = finished.outcomes.clone();
            assert_eq!(Outcomes::from_bytes(&outcomes.to_bytes(), tasks.len()), Some(outcomes));
            Arc::new(Standing::of(&field, finished))
        };
        // Once ordered, the first two differ in two tasks each way; the last lacks forty that the first solves.
        let mut all = vec![run("d", 0..30), run("a", 0..70), run("b", 2..72), run("c", 4..68)];
        order(&mut all);
        let names: Vec<&str> = all.iter().map(|standing| standing.run.as_str()).collect();
        assert_eq!(names, ["a", "b", "c", "d"]);
        let mut comparisons = Comparisons::default();
        for (i, one) in all.iter().enumerate() {
            field.count(&mut comparisons, one, &all[..i], true);
        }
        let threshold = field.threshold(&comparisons);
        let places = all.iter().map(|one| field.places(one, &all, threshold));
        let places: Vec<(usize, usize)> = places.map(|range| (range.first, range.last)).collect();
        assert_eq!(places, [(1, 3), (1, 3), (1, 3), (4, 4)]);
        assert_eq!(field.compare(&all[0], &all[1]), (1.0, 2, 2));
        // Deciding by the numbers solved agrees with counting.
        for (one, other) in all.iter().flat_map(|one| all.iter().map(move |other| (one, other))) {
            for level in [1e-12, 1e-6, 1e-3, threshold, 0.5] {
                let p = field.compare(one, other).0;
                assert!(field.decided(one, other, level).is_none_or(|decided| (decided <= level) == (p <= level)));
            }
        }
        assert!(all[0].interval.is_some_and(|interval| interval.low < 0.7 && interval.high > 0.7));
    }
}

//! Outcomes of a run on each task, compact enough to keep those of all runs in memory.

use super::summary::ProblemScores;
use crate::checks::{Criterion, Dimension};
use crate::tasks::Task;

const ANSWERED: u16 = 1;
const OVERALL: u16 = 1 << 1;
const ACCURATE: u16 = 1 << 2;
/// Bit of the first criterion; the others follow in the paper's order.
const FIRST_CRITERION: usize = 3;
/// Bit of a task that the run skips on purpose, as its owner said.
const SKIPPED: u16 = 1 << 10;

/// Outcomes of a run: what passes on each task, in the order of the suite.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcomes {
    codes: Vec<u16>,
}

impl Outcomes {
    /// Computes outcomes from the scores of a run's problems and the numbers of the tasks that it skips.
    #[must_use]
    pub fn of(tasks: &[Task], problems: &[ProblemScores], skipped: &[u32]) -> Self {
        let by_number: std::collections::HashMap<u32, &ProblemScores> =
            problems.iter().map(|problem| (problem.number, problem)).collect();
        let code = |task: &Task| match by_number.get(&task.number) {
            Some(problem) => code(problem),
            None if skipped.contains(&task.number) => SKIPPED,
            None => 0,
        };
        Self { codes: tasks.iter().map(code).collect() }
    }

    /// Encodes the outcomes as two bytes per task, little-endian.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        self.codes.iter().flat_map(|code| code.to_le_bytes()).collect()
    }

    /// Decodes outcomes. Returns `None` if the bytes are not those of `tasks` tasks.
    #[must_use]
    pub fn from_bytes(bytes: &[u8], tasks: usize) -> Option<Self> {
        (bytes.len() == 2 * tasks)
            .then(|| Self { codes: bytes.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect() })
    }

    /// Returns whether the task at this position in the suite was answered and graded.
    #[must_use]
    pub fn is_answered(&self, place: usize) -> bool {
        self.codes[place] & ANSWERED != 0
    }

    /// Returns whether the run skips the task at this position, which then counts as failed.
    #[must_use]
    pub fn is_skipped(&self, place: usize) -> bool {
        self.codes[place] & SKIPPED != 0
    }

    /// Counts the tasks that were answered, or skipped on purpose.
    #[must_use]
    pub fn covered(&self) -> usize {
        self.codes.iter().filter(|code| **code & (ANSWERED | SKIPPED) != 0).count()
    }

    /// Returns whether the task at this position passes overall.
    #[must_use]
    pub fn is_solved(&self, place: usize) -> bool {
        self.codes[place] & OVERALL != 0
    }

    /// Returns whether the accuracy of the task at this position passes.
    #[must_use]
    pub fn is_accurate(&self, place: usize) -> bool {
        self.codes[place] & ACCURATE != 0
    }

    /// Returns whether the task at this position has checks of a criterion and all of them scored 1.
    #[must_use]
    pub fn holds(&self, place: usize, criterion: Criterion) -> bool {
        self.codes[place] & bit(criterion) != 0
    }

    /// Returns the number of tasks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.codes.len()
    }

    /// Returns whether there are no tasks.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.codes.is_empty()
    }
}

fn bit(criterion: Criterion) -> u16 {
    let place = Criterion::ALL.iter().position(|c| *c == criterion).unwrap_or_default();
    1 << (FIRST_CRITERION + place)
}

fn code(problem: &ProblemScores) -> u16 {
    let mut code = ANSWERED;
    if problem.overall() {
        code |= OVERALL;
    }
    if problem.holds(|c| c.dimension() == Dimension::Accuracy) == Some(true) {
        code |= ACCURATE;
    }
    for criterion in Criterion::ALL {
        if problem.holds(|c| c == criterion) == Some(true) {
            code |= bit(criterion);
        }
    }
    code
}

/// A set of tasks, by their positions in the suite.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Places {
    words: Vec<u64>,
}

impl Places {
    /// Returns the set of the positions below `tasks` for which `wanted` holds.
    pub fn picked(tasks: usize, wanted: impl Fn(usize) -> bool) -> Self {
        let mut words = vec![0_u64; tasks.div_ceil(64)];
        for place in (0..tasks).filter(|place| wanted(*place)) {
            words[place / 64] |= 1 << (place % 64);
        }
        Self { words }
    }

    /// Counts the tasks that are in both sets.
    #[must_use]
    pub fn common(&self, other: &Self) -> usize {
        self.words.iter().zip(&other.words).map(|(a, b)| (a & b).count_ones() as usize).sum()
    }

    /// Counts, among the tasks that both runs answered, those that only the one solves and those that only the other
    /// does. Each run is given as its solved and its answered tasks.
    #[must_use]
    pub fn discordant(one: (&Self, &Self), other: (&Self, &Self)) -> (usize, usize) {
        let ((solved, answered), (other_solved, other_answered)) = (one, other);
        let (mut only_one, mut only_other) = (0, 0);
        for (i, common) in answered.words.iter().zip(&other_answered.words).map(|(a, b)| a & b).enumerate() {
            let (a, b) = (solved.words[i] & common, other_solved.words[i] & common);
            only_one += (a & !b).count_ones() as usize;
            only_other += (b & !a).count_ones() as usize;
        }
        (only_one, only_other)
    }
}

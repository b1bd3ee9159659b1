//! Comparison of two runs of a board.

use std::sync::Arc;

use super::cache::Board;
use super::read;
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use plumbline_engine::grading::outcomes::Outcomes;
use plumbline_engine::grading::standings::Standing;

/// Comparison of two runs on the problems that both answered or skipped; skipped problems count as failed.
#[derive(Debug)]
pub struct Comparison {
    /// Board of both runs.
    pub board: Arc<Board>,
    /// First run.
    pub a: Arc<Standing>,
    /// Second run.
    pub b: Arc<Standing>,
    /// Problems that both runs answered or skipped, counted by who solves them.
    pub split: Split,
    /// Two-sided p-value of McNemar's exact test: the probability of a split at least this uneven between equal agents.
    pub p_value: f64,
}

/// Common problems of two runs, by who solves them.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// Number of common problems.
    pub common: usize,
    /// Number of common problems that both runs solve.
    pub both: usize,
    /// Number of common problems that neither run solves.
    pub neither: usize,
    /// Common problems that only the first run solves, by their positions in the suite.
    pub only_a: Vec<usize>,
    /// Common problems that only the second run solves, by their positions in the suite.
    pub only_b: Vec<usize>,
}

impl Split {
    /// Splits the problems that both runs answered or skipped, which are the ones that are tested.
    fn of(a: &Outcomes, b: &Outcomes) -> Self {
        let covers = |run: &Outcomes, place| run.is_answered(place) || run.is_skipped(place);
        let mut split = Self::default();
        for place in (0..a.len()).filter(|place| covers(a, *place) && covers(b, *place)) {
            split.common += 1;
            match (a.is_solved(place), b.is_solved(place)) {
                (true, true) => split.both += 1,
                (false, false) => split.neither += 1,
                (true, false) => split.only_a.push(place),
                (false, true) => split.only_b.push(place),
            }
        }
        split
    }
}

/// Compares two runs of a board.
///
/// # Errors
/// Returns an error if there is no such suite, if its board lacks one of the runs, if they are of different tracks, or
/// if the database fails.
pub async fn compare(app: &App, suite: &str, a: &str, b: &str) -> AppResult<Comparison> {
    let board = read::board(app, suite).await?;
    let (a, b) = (Arc::clone(read::standing(&board, a)?), Arc::clone(read::standing(&board, b)?));
    if a.track != b.track {
        let detail = format!(
            "{} has {} prompts and {} has {} prompts: only runs of one track are compared",
            a.run,
            a.track.name(),
            b.run,
            b.track.name()
        );
        return Err(AppError::wrong_parameter("b", detail));
    }
    let (split, p_value) = (Split::of(&a.outcomes, &b.outcomes), board.field.compare(&a, &b).0);
    Ok(Comparison { board, a, b, split, p_value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_engine::checks::Criterion;
    use plumbline_engine::grading::ProblemScores;
    use plumbline_engine::tasks::embedded;

    #[test]
    fn skipped_problems_are_common_and_failed() {
        let suite = embedded::latest().unwrap();
        let tasks = &suite.tasks[..5];
        let solved = |places: &[usize]| -> Vec<ProblemScores> {
            let problem = |place: &usize| ProblemScores {
                number: tasks[*place].number,
                rows: vec![(Criterion::Shape, 1.0), (Criterion::PhysicalPlausibility, 1.0)],
            };
            places.iter().map(problem).collect()
        };
        let number = |place: usize| tasks[place].number;
        // The last problem is neither answered nor skipped by the second run.
        let a = Outcomes::of(tasks, &solved(&[0, 1, 4]), &[number(2), number(3)]);
        let b = Outcomes::of(tasks, &solved(&[0, 3]), &[number(1), number(2)]);
        let expected = Split { common: 4, both: 1, neither: 1, only_a: vec![1], only_b: vec![3] };
        assert_eq!(Split::of(&a, &b), expected);
    }
}

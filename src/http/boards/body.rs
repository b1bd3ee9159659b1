//! The body of a leaderboard.

use serde::Serialize;

use crate::app::boards::leaderboard::{BoardPage, Row, Withdrawn};
use crate::app::runs::body::{RunProfile, RunProvenance};
use crate::clock::rfc3339;
use plumbline_engine::grading::statistics::interval::Interval;
use plumbline_engine::grading::statistics::ranks::RankRange;
use plumbline_engine::grading::summary::{CheckRate, Graded, PerCriterion, ProblemRate};
use plumbline_engine::tasks::Track;
use plumbline_engine::tasks::reported::ReportedRow;

/// A row of a leaderboard: a finished run.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct BoardRow {
    /// Rank by overall rate; runs with the same rate share a rank. Null for a run that covers too little of the suite.
    pub rank: Option<usize>,
    /// Range of ranks that the data allow: only runs that are significantly better or worse are certain to rank before
    /// or after this one, by McNemar's exact test on the common problems, with Holm's procedure over all pairs of the
    /// board at 5 %. Null for a run that covers too little of the suite.
    pub places: Option<RankRange>,
    /// Identifier of the run.
    #[schema(format = Uuid)]
    pub run: String,
    /// Name of the agent.
    pub agent: String,
    /// Problems that pass accuracy, physical plausibility and dependency, of all problems.
    pub overall: ProblemRate,
    /// Wilson interval of the overall rate at 95 % confidence; the wordings of one problem form a cluster.
    pub interval: Option<Interval>,
    /// Problems that pass material, shape and size, of the problems to which any of them applies.
    pub accuracy: ProblemRate,
    /// Problems that pass, by criterion and dimension.
    pub problems: PerCriterion<ProblemRate>,
    /// Scores of the checks, by criterion and dimension.
    pub checks: PerCriterion<CheckRate>,
    /// Mean efficiency and mean structural stability.
    pub graded: Graded,
    /// Graded problems, of all problems.
    pub coverage: ProblemRate,
    /// Number of problems that the run skips deliberately; they count as failed.
    pub skipped: usize,
    /// Number of runs of this suite that the agent has begun, in any state.
    pub attempts: usize,
    /// Origin of the logs.
    #[schema(value_type = RunProvenance, example = "self-reported")]
    pub provenance: String,
    /// Profile of its submissions: `published`, `mindcraft`, or `mixed`.
    #[schema(value_type = RunProfile, example = "mindcraft")]
    pub profile: String,
    /// Track of its prompts. Ranks compare runs of one track.
    pub track: Track,
    /// Finished runs of other owners with near-identical logs: nearly the same blocks in nearly the same order.
    #[schema(value_type = Vec<uuid::Uuid>)]
    pub similar_to: Vec<String>,
    /// Time at which the run finished.
    #[schema(format = DateTime)]
    pub finished_at: String,
    /// End of the run's embargo; until then, `agent` is an alias. Absent without an embargo.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(format = DateTime)]
    pub anonymous_until: Option<String>,
}

/// A run that its owner withdrew from the board.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct WithdrawnRow {
    /// Identifier of the run.
    #[schema(format = Uuid)]
    pub run: String,
    /// Name of the agent.
    pub agent: String,
    /// Track of its prompts.
    pub track: Track,
    /// Number of runs of this suite that the agent has begun, in any state.
    pub attempts: usize,
    /// Time of the withdrawal.
    #[schema(format = DateTime)]
    pub at: String,
    /// Reason that the owner gave.
    pub reason: String,
}

impl From<Row> for BoardRow {
    fn from(row: Row) -> Self {
        let Row { standing, rank, places, coverage, attempts, similar_to, copied_from: _ } = row;
        let levels = &standing.summary.problem_level;
        Self {
            rank,
            places,
            run: standing.run.clone(),
            agent: standing.agent.clone(),
            overall: levels.overall,
            interval: standing.interval,
            accuracy: levels.per.accuracy,
            problems: levels.per,
            checks: standing.summary.check_level,
            graded: standing.summary.graded,
            coverage,
            skipped: standing.skipped(),
            attempts,
            provenance: standing.provenance.clone(),
            profile: standing.profile.clone(),
            track: standing.track,
            similar_to,
            finished_at: rfc3339(standing.finished_at_ms),
            anonymous_until: standing.anonymous_until_ms.map(rfc3339),
        }
    }
}

impl From<Withdrawn> for WithdrawnRow {
    fn from(Withdrawn { standing, attempts, at_ms, reason }: Withdrawn) -> Self {
        let (run, agent, track) = (standing.run.clone(), standing.agent.clone(), standing.track);
        Self { run, agent, track, attempts, at: rfc3339(at_ms), reason }
    }
}

/// A page of a leaderboard.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BoardBody {
    /// `name@version` of the suite.
    #[schema(example = "mineceraft@4")]
    pub suite: String,
    /// Number of problems in the suite.
    #[schema(example = 723)]
    pub tasks: usize,
    /// Number of rows that match the filters, on all pages.
    #[schema(example = 3)]
    pub total: usize,
    /// Share of the suite that a run must answer, or skip deliberately, to be compared with other runs.
    #[schema(example = 1.0, minimum = 0, maximum = 1)]
    pub minimum_coverage: f64,
    /// Number of finished runs that cover less; `coverage=incomplete` lists them.
    #[schema(example = 0)]
    pub incomplete: usize,
    /// Rows of this page.
    pub rows: Vec<BoardRow>,
    /// Value of `after` for the next page; null on the last page.
    #[schema(format = Uuid)]
    pub next_after: Option<String>,
    /// Results on this suite that others report; they were not graded by this service. Listed only beside the track
    /// `brief`, whose prompts are as short as theirs.
    pub reported: Vec<ReportedRow>,
    /// Runs that match the filters and that their owners, or the operator for runs without one, withdrew, latest first, at most 100; absent if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub withdrawn: Vec<WithdrawnRow>,
}

impl From<BoardPage> for BoardBody {
    fn from(page: BoardPage) -> Self {
        let suite = &page.board.entry.suite;
        Self {
            suite: suite.id(),
            tasks: suite.tasks.len(),
            total: page.total,
            minimum_coverage: page.board.least_coverage,
            incomplete: page.incomplete,
            rows: page.rows.into_iter().map(BoardRow::from).collect(),
            next_after: page.next_after,
            reported: page.reported,
            withdrawn: page.withdrawn.into_iter().map(WithdrawnRow::from).collect(),
        }
    }
}

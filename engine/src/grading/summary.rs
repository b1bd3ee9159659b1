//! The summary of a run: scores per check and per problem (`docs/rules.md#scores`; paper, appendix "Overall Accuracy").
//!
//! Its keys are those of published summaries: `check_level`, `problem_level`, `graded`, `passed_runs`.

use serde::{Deserialize, Serialize};

use crate::checks::{Criterion, Dimension};

/// Scores of one problem, with one row per check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProblemScores {
    /// Number of the problem in its suite.
    pub number: u32,
    /// Criterion and score of each check, over all turns in order.
    pub rows: Vec<(Criterion, f64)>,
}

impl ProblemScores {
    /// Returns whether every check that `wanted` picks scored 1, or `None` if it picks none.
    #[must_use]
    pub fn holds(&self, wanted: impl Fn(Criterion) -> bool) -> Option<bool> {
        let mut picked = self.rows.iter().filter(|(criterion, _)| wanted(*criterion)).peekable();
        picked.peek().is_some().then(|| picked.all(|(_, score)| *score >= 1.0))
    }

    /// Returns the mean score of a criterion's checks, or `None` if it has none.
    fn mean(&self, wanted: Criterion) -> Option<f64> {
        let scores: Vec<f64> = self.rows.iter().filter(|(c, _)| *c == wanted).map(|(_, score)| *score).collect();
        (!scores.is_empty()).then(|| scores.iter().sum::<f64>() / scores.len() as f64)
    }

    fn accuracy(&self) -> Option<bool> {
        self.holds(|c| c.dimension() == Dimension::Accuracy)
    }

    /// Returns whether the problem passes overall (`docs/rules.md#scores`).
    #[must_use]
    pub fn overall(&self) -> bool {
        self.holds(Criterion::decides).unwrap_or(true)
    }
}

/// Scores of checks, over all problems.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, utoipa::ToSchema)]
pub struct CheckRate {
    /// Sum of the scores.
    pub sum: f64,
    /// Number of checks.
    pub rows: u64,
    /// Number of checks that scored 1.
    pub rows_at_1: u64,
    /// Mean score; null if there are no checks.
    #[schema(minimum = 0, maximum = 1)]
    pub mean: Option<f64>,
}

/// Share of the problems that pass, among those to which a criterion or dimension applies.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ProblemRate {
    /// Number of problems that pass.
    pub pass: u64,
    /// Number of problems to which the criterion or dimension applies.
    pub of: u64,
    /// `pass` divided by `of`; null if `of` is 0.
    #[schema(minimum = 0, maximum = 1)]
    pub rate: Option<f64>,
}

/// A mean over problems.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, utoipa::ToSchema)]
pub struct GradedMean {
    /// Number of problems.
    pub n: u64,
    /// Mean of their scores; null if there are no problems.
    #[schema(minimum = 0, maximum = 1)]
    pub mean: Option<f64>,
}

/// One value per criterion and per dimension.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PerCriterion<T> {
    /// Material of the blocks.
    pub material: T,
    /// Shape of the build.
    pub shape: T,
    /// Size of the build.
    pub size: T,
    /// Physical plausibility: nothing floats.
    pub physical_plausibility: T,
    /// Structural stability: the greatest stress, compared with the reference.
    pub structural_stability: T,
    /// Efficiency: little movement between blocks.
    pub efficiency: T,
    /// Dependency: the order of construction.
    pub dependency: T,
    /// Accuracy: material, shape and size.
    pub accuracy: T,
    /// Safety: physical plausibility and structural stability.
    pub safety: T,
    /// Planning: efficiency and dependency.
    pub planning: T,
}

impl<T> PerCriterion<T> {
    fn from_fn(mut value: impl FnMut(&dyn Fn(Criterion) -> bool) -> T) -> Self {
        let mut one = |wanted: Criterion| value(&|c| c == wanted);
        let (material, shape, size) = (one(Criterion::Material), one(Criterion::Shape), one(Criterion::Size));
        let physical_plausibility = one(Criterion::PhysicalPlausibility);
        let structural_stability = one(Criterion::StructuralStability);
        let (efficiency, dependency) = (one(Criterion::Efficiency), one(Criterion::Dependency));
        let mut all = |wanted: Dimension| value(&|c| c.dimension() == wanted);
        Self {
            material,
            shape,
            size,
            physical_plausibility,
            structural_stability,
            efficiency,
            dependency,
            accuracy: all(Dimension::Accuracy),
            safety: all(Dimension::Safety),
            planning: all(Dimension::Planning),
        }
    }

    /// Returns the value of one criterion.
    #[must_use]
    pub const fn criterion(&self, criterion: Criterion) -> &T {
        match criterion {
            Criterion::Material => &self.material,
            Criterion::Shape => &self.shape,
            Criterion::Size => &self.size,
            Criterion::PhysicalPlausibility => &self.physical_plausibility,
            Criterion::StructuralStability => &self.structural_stability,
            Criterion::Efficiency => &self.efficiency,
            Criterion::Dependency => &self.dependency,
        }
    }
}

/// Problem-level rates.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ProblemLevel {
    /// Rates per criterion and dimension.
    #[serde(flatten)]
    pub per: PerCriterion<ProblemRate>,
    /// Rate at which accuracy, physical plausibility and dependency all pass, as far as they apply, over all problems.
    pub overall: ProblemRate,
}

/// Means of the graded criteria over problems.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Graded {
    /// Efficiency, over the problems that have such checks.
    pub efficiency: GradedMean,
    /// Structural stability, over the problems that have such checks.
    pub stress: GradedMean,
    /// Efficiency, over those of them whose accuracy passes.
    pub efficiency_accurate: GradedMean,
    /// Structural stability, over those of them whose accuracy passes.
    pub stress_accurate: GradedMean,
}

/// Numbers, in the suite, of the problems that pass.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PassedRuns {
    /// Problems whose accuracy passes.
    pub accuracy: Vec<u32>,
    /// Problems whose physical plausibility passes.
    pub physical_plausibility: Vec<u32>,
    /// Problems whose dependency passes.
    pub dependency: Vec<u32>,
    /// Problems that pass overall.
    pub overall: Vec<u32>,
}

/// The summary of a run.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Summary {
    /// Scores of checks, per criterion and dimension.
    pub check_level: PerCriterion<CheckRate>,
    /// Rates of problems that pass, per criterion and dimension and overall.
    pub problem_level: ProblemLevel,
    /// Means of the graded criteria.
    pub graded: Graded,
    /// Numbers of the problems that pass.
    pub passed_runs: PassedRuns,
}

impl Summary {
    /// Summarises problems in the order of their numbers.
    #[must_use]
    pub fn of(problems: &[ProblemScores]) -> Self {
        Self::with_unanswered(problems, &[])
    }

    /// Summarises problems. Those in `unanswered` count as failed at the problem level, without scored checks.
    ///
    /// The rows of an unanswered problem only show which criteria apply to it.
    #[must_use]
    pub fn with_unanswered(problems: &[ProblemScores], unanswered: &[ProblemScores]) -> Self {
        let mut problems: Vec<&ProblemScores> = problems.iter().collect();
        problems.sort_by_key(|problem| problem.number);
        let failed = |holds: &dyn Fn(&ProblemScores) -> Option<bool>| {
            unanswered.iter().filter(|problem| holds(problem).is_some()).count() as u64
        };
        let rate = |holds: &dyn Fn(&ProblemScores) -> Option<bool>| {
            let answers: Vec<bool> = problems.iter().filter_map(|problem| holds(problem)).collect();
            let pass = answers.iter().filter(|holds| **holds).count() as u64;
            problem_rate(pass, answers.len() as u64 + failed(holds))
        };
        let passed = |holds: &dyn Fn(&ProblemScores) -> Option<bool>| {
            problems.iter().filter(|p| holds(p) == Some(true)).map(|p| p.number).collect()
        };
        let plausibility = |p: &ProblemScores| p.holds(|c| c == Criterion::PhysicalPlausibility);
        let dependency = |p: &ProblemScores| p.holds(|c| c == Criterion::Dependency);
        let overall = |p: &ProblemScores| Some(p.overall());
        let accurate = |p: &&&ProblemScores| p.accuracy() == Some(true);
        let mean = |criterion: Criterion| graded_mean(problems.iter().filter_map(|p| p.mean(criterion)));
        let mean_accurate =
            |criterion: Criterion| graded_mean(problems.iter().filter(accurate).filter_map(|p| p.mean(criterion)));
        Self {
            check_level: PerCriterion::from_fn(|wanted| check_rate(&problems, wanted)),
            problem_level: ProblemLevel {
                per: PerCriterion::from_fn(|wanted| rate(&|p| p.holds(wanted))),
                overall: rate(&overall),
            },
            graded: Graded {
                efficiency: mean(Criterion::Efficiency),
                stress: mean(Criterion::StructuralStability),
                efficiency_accurate: mean_accurate(Criterion::Efficiency),
                stress_accurate: mean_accurate(Criterion::StructuralStability),
            },
            passed_runs: PassedRuns {
                accuracy: passed(&ProblemScores::accuracy),
                physical_plausibility: passed(&plausibility),
                dependency: passed(&dependency),
                overall: passed(&overall),
            },
        }
    }
}

fn check_rate(problems: &[&ProblemScores], wanted: &dyn Fn(Criterion) -> bool) -> CheckRate {
    let scores = problems.iter().flat_map(|p| &p.rows).filter(|(criterion, _)| wanted(*criterion));
    let mut rate = CheckRate::default();
    for (_, score) in scores {
        rate.sum += score;
        rate.rows += 1;
        rate.rows_at_1 += u64::from(*score >= 1.0);
    }
    rate.mean = (rate.rows > 0).then(|| rate.sum / rate.rows as f64);
    rate
}

fn problem_rate(pass: u64, of: u64) -> ProblemRate {
    ProblemRate { pass, of, rate: (of > 0).then(|| pass as f64 / of as f64) }
}

fn graded_mean(scores: impl Iterator<Item = f64>) -> GradedMean {
    let scores: Vec<f64> = scores.collect();
    let n = scores.len() as u64;
    GradedMean { n, mean: (n > 0).then(|| scores.iter().sum::<f64>() / n as f64) }
}

//! Rewards: one number from scores, by a scheme that the trainer chooses.

use serde::{Deserialize, Serialize};

use super::Scores;
use super::baseline::Baseline;
use crate::checks::Criterion;

/// Scheme that turns scores into a number in [0, 1].
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Scheme {
    /// 1 if the problem passes overall (`docs/rules.md#scores`), else 0.
    #[default]
    Strict,
    /// The mean, over the criteria that apply, of the mean score of their checks. Doing nothing earns much of it.
    Mean,
    /// The gain over a log that does nothing ([`Baseline::shaped`]), for training.
    Shaped,
    /// The weighted mean, over the criteria that apply and have a weight, of the mean score of their checks.
    Weighted(Vec<(Criterion, f64)>),
}

impl Scheme {
    /// Returns the name of the scheme in the API.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Strict => "strict",
            Self::Mean => "mean",
            Self::Shaped => "shaped",
            Self::Weighted(_) => "weighted",
        }
    }

    /// Computes the reward of scores. Returns `None` if no criterion that applies has a weight. [`Self::Shaped`]
    /// needs the `baseline` of the task, and returns `None` unless it can be beaten.
    #[must_use]
    pub fn reward(&self, scores: &Scores, baseline: Option<&Baseline>) -> Option<f64> {
        let weight = |criterion: Criterion| match self {
            Self::Strict | Self::Mean | Self::Shaped => 1.0,
            Self::Weighted(weights) => {
                weights.iter().find(|(of, _)| *of == criterion).map_or(0.0, |(_, weight)| *weight)
            }
        };
        if *self == Self::Strict {
            return Some(f64::from(scores.overall));
        }
        if *self == Self::Shaped {
            return baseline.filter(|baseline| baseline.can_be_beaten()).map(|baseline| baseline.shaped(scores));
        }
        let total: f64 = scores.criteria.iter().map(|c| weight(c.criterion)).sum();
        let sum: f64 = scores.criteria.iter().map(|c| weight(c.criterion) * c.mean).sum();
        (total > 0.0).then(|| sum / total)
    }
}

/// Components of a reward: the mean score of each criterion that applies, and overall success.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct RewardComponents {
    /// 1 if the problem passes overall, else 0.
    #[schema(minimum = 0, maximum = 1)]
    pub overall: f64,
    /// Mean score of the material checks; absent if the criterion does not apply, like the ones below.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0, maximum = 1)]
    pub material: Option<f64>,
    /// Mean score of the shape checks.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0, maximum = 1)]
    pub shape: Option<f64>,
    /// Mean score of the size checks.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0, maximum = 1)]
    pub size: Option<f64>,
    /// Mean score of the physical plausibility checks.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0, maximum = 1)]
    pub physical_plausibility: Option<f64>,
    /// Mean score of the structural stability checks.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0, maximum = 1)]
    pub structural_stability: Option<f64>,
    /// Mean score of the efficiency checks.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0, maximum = 1)]
    pub efficiency: Option<f64>,
    /// Mean score of the dependency checks.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0, maximum = 1)]
    pub dependency: Option<f64>,
}

impl RewardComponents {
    /// Returns the components if there is nothing to grade: 0 for each criterion that applies.
    #[must_use]
    pub fn none_of(criteria: &[Criterion]) -> Self {
        let none = |wanted| criteria.contains(&wanted).then_some(0.0);
        Self {
            overall: 0.0,
            material: none(Criterion::Material),
            shape: none(Criterion::Shape),
            size: none(Criterion::Size),
            physical_plausibility: none(Criterion::PhysicalPlausibility),
            structural_stability: none(Criterion::StructuralStability),
            efficiency: none(Criterion::Efficiency),
            dependency: none(Criterion::Dependency),
        }
    }

    /// Returns the components of scores.
    #[must_use]
    pub fn of(scores: &Scores) -> Self {
        let mean = |wanted| scores.criteria.iter().find(|c| c.criterion == wanted).map(|c| c.mean);
        Self {
            overall: f64::from(scores.overall),
            material: mean(Criterion::Material),
            shape: mean(Criterion::Shape),
            size: mean(Criterion::Size),
            physical_plausibility: mean(Criterion::PhysicalPlausibility),
            structural_stability: mean(Criterion::StructuralStability),
            efficiency: mean(Criterion::Efficiency),
            dependency: mean(Criterion::Dependency),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builders::build;
    use crate::builders::saboteurs::find;
    use crate::elasticity::Control;
    use crate::grading::score_log;
    use crate::tasks::embedded;

    #[test]
    fn schemes_agree_on_a_good_wall_and_differ_on_a_wide_one() {
        let suite = embedded::latest().unwrap();
        let task = suite.tasks.iter().find(|task| task.id == "walls/5x1x5-raise").unwrap();
        let good = build(task).unwrap();
        // Extra blocks spoil one check of three for material, one course of five for shape, one of two for size, and
        // movement.
        let wide = find("widen").unwrap().spoil(good.clone());
        let scores = |log| score_log(task, log, &Control::unhurried()).unwrap();
        let (good, wide) = (scores(&good), scores(&wide));
        let efficiency = wide.criteria.iter().find(|c| c.criterion == Criterion::Efficiency).unwrap().mean;
        let weights = |of: &[(Criterion, f64)]| Scheme::Weighted(of.to_vec());
        for scheme in [Scheme::Strict, Scheme::Mean, weights(&[(Criterion::Size, 2.0)])] {
            assert_eq!(scheme.reward(&good, None), Some(1.0));
        }
        assert_eq!(Scheme::Strict.reward(&wide, None), Some(0.0));
        assert_eq!(Scheme::Mean.reward(&wide, None), Some((2.0 / 3.0 + 0.8 + 0.5 + 1.0 + efficiency) / 5.0));
        assert_eq!(
            weights(&[(Criterion::Material, 3.0), (Criterion::PhysicalPlausibility, 1.0)]).reward(&wide, None),
            Some(3.0 / 4.0)
        );
        assert_eq!(weights(&[(Criterion::Dependency, 1.0)]).reward(&wide, None), None, "walls have no order");
        assert_eq!(RewardComponents::of(&wide).size, Some(0.5));
        assert_eq!(RewardComponents::of(&wide).dependency, None);
    }
}

//! The reward scheme of a request to grade.

use std::ops::RangeInclusive;

use serde_json::Value;

use crate::app::limits::LIMITS;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::reward::Scheme;
use plumbline_engine::intake::Faults;

/// Scheme that turns a report into a reward.
#[derive(Debug, utoipa::ToSchema)]
#[serde(untagged)]
pub enum SchemeBody {
    /// A scheme, by its name.
    Named(SchemeName),
    /// Weights, for the weighted mean over the criteria that apply.
    Weighted(WeightsBody),
}

/// Name of a reward scheme.
#[derive(Debug, Clone, Copy, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SchemeName {
    /// 1 if the problem passes, else 0.
    Strict,
    /// Gain over a log that does nothing, for training: 0 for an empty log or a single block, 1 if all checks pass.
    Shaped,
    /// Mean of the criteria that apply. An empty log earns 0.29 on average over Lite, so a model may learn to do
    /// nothing.
    Mean,
}

/// Weights of criteria.
#[derive(Debug, utoipa::ToSchema)]
pub struct WeightsBody {
    /// Weight of each criterion: 0, or between 1e-9 and 1e9. Criteria that are not listed have 0.
    #[schema(example = json!({ "material": 1, "shape": 2 }))]
    pub weights: std::collections::BTreeMap<Criterion, f64>,
}

/// Weights above 0 that are allowed.
const WEIGHTS: RangeInclusive<f64> = LIMITS.reward_weight_min..=LIMITS.reward_weight_max;

/// Returns the scheme with this name. A scheme of weights has none.
pub fn scheme_named(name: &str) -> Option<Scheme> {
    [Scheme::Strict, Scheme::Mean, Scheme::Shaped].into_iter().find(|scheme| scheme.name() == name)
}

/// Reads a scheme: `"strict"`, `"shaped"`, `"mean"`, or `{"weights": {criterion: weight}}`. A member that is null is
/// absent.
pub fn read_scheme(value: &Value, faults: &mut Faults) -> Option<Scheme> {
    if let Some(scheme) = value.as_str().and_then(scheme_named) {
        return Some(scheme);
    }
    match value {
        Value::Object(members)
            if members.values().filter(|value| !value.is_null()).count() == 1
                && members.get("weights").is_some_and(Value::is_object) => {}
        _ => {
            faults.add("expected \"strict\", \"shaped\", \"mean\" or {\"weights\": {\"material\": 1, …}}");
            return None;
        }
    }
    faults.enter_key("weights");
    let mut weights = Vec::new();
    let given = value["weights"].as_object().into_iter().flatten().filter(|(_, weight)| !weight.is_null());
    for (name, weight) in given {
        let criterion = Criterion::ALL.into_iter().find(|criterion| criterion.name() == name);
        let number = weight.as_f64().filter(|weight| *weight == 0.0 || WEIGHTS.contains(weight));
        match (criterion, number) {
            (Some(criterion), Some(weight)) => weights.push((criterion, weight)),
            (None, _) => {
                let known = Criterion::ALL.map(Criterion::name).join(", ");
                faults.add_at(name, format!("not a criterion; there are {known}"));
            }
            (_, None) => faults.add_at(name, "expected 0, or a number between 1e-9 and 1e9"),
        }
    }
    if faults.is_empty() && weights.iter().all(|(_, weight)| *weight == 0.0) {
        faults.add("no weight is above 0");
    }
    faults.leave();
    Some(Scheme::Weighted(weights))
}

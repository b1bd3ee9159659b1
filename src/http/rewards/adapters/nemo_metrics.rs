//! NeMo Gym's `POST /aggregate_metrics`: statistics over the rows of an evaluation.
//!
//! The numbers at the top level of a row and in its `response.usage` count (true is 1), except those whose names begin
//! with an underscore. Rows with the same `_ng_task_index` form a group. Rows with `mask_sample` are left out.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use axum::Json;
use axum::extract::State;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::nemo_gym::object;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::http::extract::body::JsonBody;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// Statistics over the rows of an evaluation.
#[derive(Debug, Default, Serialize, utoipa::ToSchema)]
pub struct AggregateMetrics {
    /// Statistics of each task, with its `_ng_task_index`.
    #[schema(value_type = Vec<Object>)]
    pub group_level_metrics: Vec<Map<String, Value>>,
    /// Statistics of all rows: `mean/reward`, `max/reward`, `min/reward`, `median/reward` and `std/reward`; the same
    /// for each other number.
    #[schema(value_type = Object)]
    pub agent_metrics: Map<String, Value>,
    /// The means of `agent_metrics`.
    #[schema(value_type = Object)]
    pub key_metrics: Map<String, Value>,
}

/// Computes statistics of verified rows.
///
/// NeMo Gym requests them from a resources server after an evaluation.
#[utoipa::path(
    post, path = "/aggregate_metrics", operation_id = "aggregate_metrics", tag = "rewards",
    summary = "NeMo Gym: compute statistics of verified rows",
    request_body(content = Object, content_type = "application/json",
                 example = json!({ "verify_responses": [{ "_ng_task_index": 0, "reward": 1.0 }] })),
    responses(
        (status = 200, description = "The statistics", body = AggregateMetrics,
         example = json!({ "group_level_metrics": [{ "_ng_task_index": 0, "mean/reward": 1.0 }],
                           "agent_metrics": { "mean/reward": 1.0 }, "key_metrics": { "mean/reward": 1.0 } })),
    )
)]
pub async fn aggregate_metrics(
    State(state): State<AppState>,
    caller: Caller,
    body: JsonBody,
) -> AppResult<Json<AggregateMetrics>> {
    caller.require(Scope::Grade)?;
    let room = state.free_json.wait_for(body.bytes.clone(), caller.who(), Instant::now()).await?;
    // Whoever waits for memory takes no place from others.
    let place = state.grader.admit_batch(caller.who())?;
    let work = tokio::task::spawn_blocking(move || {
        let _held = (place, room);
        let request = object(&body.bytes)?;
        let Some(rows) = request.get("verify_responses").and_then(Value::as_array) else {
            let mut faults = Faults::new();
            faults.add_at("verify_responses", "expected an array of rows");
            return Err(AppError::faulty(faults));
        };
        let names: BTreeSet<String> = rows.iter().flat_map(numbers).map(|(name, _)| name).collect();
        if names.len() > LIMITS.metric_names {
            let mut faults = Faults::new();
            faults.add_at(
                "verify_responses",
                format!("{} different numbers; at most {} are allowed", names.len(), LIMITS.metric_names),
            );
            return Err(AppError::faulty(faults));
        }
        Ok(Json(aggregate(rows)))
    });
    work.await.map_err(|error| AppError::internal(&error))?
}

type Columns = BTreeMap<String, Vec<f64>>;

fn aggregate(rows: &[Value]) -> AggregateMetrics {
    let (mut all, mut groups) = (Columns::new(), BTreeMap::<u64, Columns>::new());
    for row in rows.iter().filter(|row| row["mask_sample"] != true) {
        let numbers = numbers(row);
        let group = row["_ng_task_index"].as_u64().map(|index| groups.entry(index).or_default());
        for columns in std::iter::once(&mut all).chain(group) {
            for (name, value) in &numbers {
                columns.entry(name.clone()).or_default().push(*value);
            }
        }
    }
    let agent_metrics = figures(&all);
    let is_mean = |(name, _): &(&String, &Value)| name.starts_with("mean/");
    let key_metrics = agent_metrics.iter().filter(is_mean).map(|(name, value)| (name.clone(), value.clone())).collect();
    let group_level_metrics = groups.iter().map(|(index, columns)| {
        let mut figures = figures(columns);
        figures.insert("_ng_task_index".to_owned(), json!(index));
        figures
    });
    AggregateMetrics { group_level_metrics: group_level_metrics.collect(), agent_metrics, key_metrics }
}

/// Returns the numbers at the top of a row, and those of the model's usage, which win over others of the same name.
fn numbers(row: &Value) -> BTreeMap<String, f64> {
    let number = |value: &Value| value.as_f64().or_else(|| value.as_bool().map(f64::from));
    let top = row.as_object().into_iter().flatten();
    let usage = row["response"]["usage"].as_object().into_iter().flatten();
    top.chain(usage)
        .filter(|(name, _)| !name.starts_with('_') && *name != "mask_sample")
        .filter_map(|(name, value)| Some((name.chars().take(LIMITS.material_chars).collect(), number(value)?)))
        .collect()
}

fn figures(columns: &Columns) -> Map<String, Value> {
    let mut figures = Map::new();
    for (name, values) in columns {
        let mut sorted = values.clone();
        sorted.sort_by(f64::total_cmp);
        let count = sorted.len() as f64;
        let mean = sorted.iter().sum::<f64>() / count;
        let middle = sorted.len() / 2;
        let median = if sorted.len().is_multiple_of(2) {
            f64::midpoint(sorted[middle - 1], sorted[middle])
        } else {
            sorted[middle]
        };
        // Sample standard deviation, as the framework computes it; 0 for a single value.
        let squares = sorted.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        let std = if sorted.len() > 1 { (squares / (count - 1.0)).sqrt() } else { 0.0 };
        let (min, max) = (sorted[0], sorted[sorted.len() - 1]);
        for (figure, value) in [("mean", mean), ("max", max), ("min", min), ("median", median), ("std", std)] {
            figures.insert(format!("{figure}/{name}"), json!(value));
        }
    }
    figures
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_of_numbers_at_the_top() {
        let rows = [
            json!({ "_ng_task_index": 0, "reward": 1.0, "overall": true, "reward_components": { "size": 1 } }),
            json!({ "_ng_task_index": 0, "reward": 0.0, "overall": false, "total_tokens": 3,
                    "response": { "usage": { "total_tokens": 12 } } }),
            json!({ "_ng_task_index": 3, "reward": 0.5, "overall": false, "note": "x" }),
            json!({ "_ng_task_index": 3, "reward": 0.0, "mask_sample": true }),
        ];
        let made = aggregate(&rows);
        assert_eq!(made.agent_metrics["mean/reward"], json!(0.5));
        assert_eq!(made.agent_metrics["std/reward"], json!(0.5));
        assert_eq!(made.agent_metrics["median/reward"], json!(0.5));
        assert_eq!(made.agent_metrics["mean/overall"], json!(1.0 / 3.0));
        assert_eq!(made.agent_metrics["min/total_tokens"], json!(12.0));
        assert!(!made.agent_metrics.keys().any(|name| name.contains("size") || name.contains("_ng")));
        assert_eq!(made.key_metrics.len(), 3);
        assert_eq!(made.group_level_metrics[1]["_ng_task_index"], json!(3));
        assert_eq!(made.group_level_metrics[1]["mean/reward"], json!(0.5));
        assert!(aggregate(&[]).agent_metrics.is_empty());
    }
}

//! What checks found, in the words of the pages.

use serde_json::Value;

use super::claims::{Args, plain, range, sentence};
use plumbline_engine::grading::report::CheckReport;
use plumbline_engine::text::counted;

/// Says what a check found in one sentence, without what it requires.
#[must_use]
pub fn found(check: &CheckReport) -> String {
    let measured = Args(&check.finding.measured);
    let told = match &*check.name {
        "shape.level_has" => level_found(measured),
        "size.is_equal" | "size.is_geq" | "size.is_leq" | "size.all_dimensions_geq" => extents_found(measured),
        "material.is_made_of" => check.finding.measured.as_f64().map(|share| format!("{} % are", plain(share * 100.0))),
        _ => None,
    };
    // What was built under the ground has no upper surface.
    if check.finding.summary.ends_with("upper surface [] along x, [] along z") {
        return "Nothing of it stands above the ground".to_owned();
    }
    let summary = check.finding.summary.split("; required").next().unwrap_or_default();
    sentence(&told.unwrap_or_else(|| in_good_number(&summary.replace("y=", "y = "))))
}

/// Writes what a check measured or required in words and numbers, such as "blocks at least 4, parts 1".
#[must_use]
pub fn values(value: &Value) -> String {
    told(value).unwrap_or_else(|| "nothing in particular".to_owned())
}

/// Writes a value; `None` if it says nothing, such as a bound that is not set.
fn told(value: &Value) -> Option<String> {
    match value {
        Value::Null => None,
        Value::Bool(holds) => Some(if *holds { "yes" } else { "no" }.to_owned()),
        // Long fractions are for programs, which read the report.
        Value::Number(number) => number.as_f64().map(plain),
        Value::String(text) => Some(text.replace('_', " ").trim().to_owned()),
        Value::Array(list) if list.is_empty() => Some("none".to_owned()),
        Value::Array(list) => Some(list.iter().filter_map(told).collect::<Vec<_>>().join(", ")),
        Value::Object(members) if members.keys().all(|name| matches!(name.as_str(), ">=" | "<=")) => {
            let bound = |name: &str| value.get(name).and_then(Value::as_f64);
            // No count is below 0, so a bound of 0 says nothing.
            range(bound(">=").filter(|min| *min > 0.0), bound("<="))
        }
        Value::Object(members) => {
            let member = |(name, value): (&String, &Value)| {
                let name = name.replace('_', " ").replace(">=", "at least").replace("<=", "at most");
                let is_many = value.as_array().is_some_and(|list| list.len() > 1);
                Some(if is_many { format!("{name}: ({})", told(value)?) } else { format!("{name}: {}", told(value)?) })
            };
            let all: Vec<String> = members.iter().filter_map(member).collect();
            (!all.is_empty()).then(|| all.join("; "))
        }
    }
}

/// Puts a count of one in the singular: summaries of reports count without looking.
fn in_good_number(text: &str) -> String {
    let one = text.strip_prefix("1 blocks").map(|rest| format!("1 block{rest}"));
    one.unwrap_or_else(|| text.to_owned())
        .replace("of 1 blocks float", "of 1 block floats")
        .replace(" 1 blocks", " 1 block")
}

fn level_found(measured: Args<'_>) -> Option<String> {
    let (blocks, parts) = (measured.number("blocks")? as i64, measured.number("parts")? as i64);
    if blocks == 0 {
        return Some("no block".to_owned());
    }
    let widest: Vec<f64> = measured.0.get("widest")?.as_array()?.iter().filter_map(Value::as_f64).collect();
    let [wide, deep] = *widest.as_slice() else { return None };
    let parts = if parts == 1 { "in one part".to_owned() } else { format!("in {} parts", plain(parts as f64)) };
    Some(format!("{} {parts}; the widest measures {} × {}", counted(blocks, "block"), plain(wide), plain(deep)))
}

fn extents_found(measured: Args<'_>) -> Option<String> {
    let [x, y, z] = ["x", "y", "z"].map(|axis| measured.number(axis));
    Some(format!("{} × {} in plan and {} high", plain(x?), plain(z?), counted(y? as i64, "block")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_engine::checks::Criterion;
    use plumbline_engine::checks::evidence::Finding;
    use serde_json::json;

    #[test]
    fn values_are_told_without_the_signs_of_programs() {
        for (value, wanted) in [
            (json!({ "<=": 10, ">=": 10 }), "10"),
            (json!({ "<=": 218, ">=": 0 }), "at most 218"),
            (json!({ "<=": null, ">=": 49 }), "at least 49"),
            (
                json!({ "blocks": { "<=": 4, ">=": 4 }, "parts": { "<=": null, ">=": 0 }, "size": { ">=": null }, "y": 0 }),
                "blocks: 4; y: 0",
            ),
            (json!({ "blocks": 20, "parts": 1, "widest": [2, 10] }), "blocks: 20; parts: 1; widest: (2, 10)"),
            (json!({ "of": "oak_planks", "share >=": 0.5 }), "of: oak planks; share at least: 0.5"),
            (json!({ "symmetric": false }), "symmetric: no"),
            (json!([]), "none"),
            (json!(0.123_456), "0.12"),
            (json!(null), "nothing in particular"),
            (json!({}), "nothing in particular"),
        ] {
            assert_eq!(values(&value), wanted, "{value}");
        }
    }

    #[test]
    fn findings_are_told_without_what_was_required() {
        let told = |name: &str, measured: Value, summary: &str| {
            let finding = Finding::binary(false, measured, json!({}), summary);
            found(&CheckReport { name: name.to_owned().into(), args: json!({}), criterion: Criterion::Shape, finding })
        };
        let none = json!({ "blocks": 0, "parts": 0, "widest": [0, 0] });
        assert_eq!(told("shape.level_has", none, "0 blocks in 0 separate parts"), "No block");
        let one = json!({ "blocks": 1, "parts": 1, "widest": [1, 1] });
        assert_eq!(told("shape.level_has", one, ""), "1 block in one part; the widest measures 1 × 1");
        let extents = json!({ "x": 4.0, "y": 6.0, "z": 4.0 });
        assert_eq!(told("size.is_equal", extents, "spans 4 x 4"), "4 × 4 in plan and 6 blocks high");
        assert_eq!(told("material.is_made_of", json!(0.325), ""), "32.5 % are");
        assert_eq!(told("size.max_y_is_geq", json!(2), "highest y is 2; required >= 12"), "Highest y is 2");
        assert_eq!(
            told("shape.climbs_to", json!(-1), "the climb ends at y=-1; required 4"),
            "The climb ends at y = -1"
        );

        assert_eq!(told("material.count_is_within", json!(1), "1 blocks"), "1 block");
        let floats = told("physical_plausibility.is_ground_connected", json!(1), "1 of 1 blocks float");
        assert_eq!(floats, "1 of 1 block floats");
    }
}

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

/// Writes what a check required in words and numbers, such as "blocks: at least 4; y: 0".
#[must_use]
pub fn asked(required: &Value) -> String {
    told(required).unwrap_or_else(|| "nothing in particular".to_owned())
}

/// Writes what a check measured in words and numbers, such as "blocks: 4; parts: 1".
#[must_use]
pub fn built(measured: &Value) -> String {
    told(measured).unwrap_or_else(|| "nothing that can be measured".to_owned())
}

/// Writes a value; `None` if it says nothing, such as a bound that is not set.
fn told(value: &Value) -> Option<String> {
    match value {
        Value::Null => None,
        Value::Bool(holds) => Some(if *holds { "yes" } else { "no" }.to_owned()),
        Value::Number(number) => number.as_f64().map(number_of),
        Value::String(text) => Some(text.replace('_', " ").trim().trim_start_matches('#').to_owned()),
        Value::Array(list) if list.is_empty() => Some("none".to_owned()),
        Value::Array(list) => Some(list.iter().filter_map(told).collect::<Vec<_>>().join(", ")),
        Value::Object(members) if !members.is_empty() && members.keys().all(|name| sign(name).is_some()) => {
            let bound = |name: &str| value.get(name).and_then(Value::as_f64);
            let is_range = members.keys().all(|name| matches!(name.as_str(), ">=" | "<="))
                && members.values().all(|bound| bound.is_null() || bound.is_number());
            if is_range {
                // No count is below 0, so a bound of 0 says nothing.
                return range(bound(">=").filter(|min| *min != 0.0), bound("<="));
            }
            let side = |(name, value): (&String, &Value)| Some(format!("{}{}", sign(name)?, told(value)?));
            let all: Vec<String> = members.iter().filter_map(side).collect();
            (!all.is_empty()).then(|| all.join(" and "))
        }
        Value::Object(members) => {
            let member = |(name, value): (&String, &Value)| {
                let (name, sign) = match name.rsplit_once(' ') {
                    Some((name, end)) => sign(end).map_or((name, ""), |sign| (name, sign)),
                    None => (name.as_str(), ""),
                };
                let is_many = value.as_array().is_some_and(|list| list.len() > 1);
                let told = told(value)?;
                let told = if is_many { format!("({told})") } else { told };
                Some(format!("{}: {sign}{told}", name.replace('_', " ")))
            };
            let all: Vec<String> = members.iter().filter_map(member).collect();
            (!all.is_empty()).then(|| all.join("; "))
        }
    }
}

/// Returns the words for a sign of comparison, with a space where one is needed.
fn sign(text: &str) -> Option<&'static str> {
    Some(match text {
        ">=" => "at least ",
        "<=" => "at most ",
        ">" => "more than ",
        "<" => "less than ",
        "==" => "",
        _ => return None,
    })
}

/// Writes a number: with two digits after the point, or with as many as tell it from 0 and from 1.
fn number_of(number: f64) -> String {
    let short = plain(number);
    let is_told = short.parse::<f64>().is_ok_and(|short| (short - number).abs() < 1e-4);
    if is_told || number.abs() >= 10.0 { short } else { format!("{number:.4}") }
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
            (json!({ "<=": null, ">=": -5 }), "at least -5"),
            (json!({ "<=": { "xz": [20, 20], "y": null } }), "at most xz: (20, 20)"),
            (json!({ "==": { "xz": [7, 7], "y": 1 } }), "xz: (7, 7); y: 1"),
            (json!({ ">": 3 }), "more than 3"),
            (json!({ "blocks": { "<=": 4, ">=": 4 }, "parts": { "<=": null, ">=": 0 }, "y": 0 }), "blocks: 4; y: 0"),
            (json!({ "blocks": 20, "parts": 1, "widest": [2, 10] }), "blocks: 20; parts: 1; widest: (2, 10)"),
            (json!({ "of": "#red_concrete", "share >=": 0.5 }), "of: red concrete; share: at least 0.5"),
            (json!({ "symmetric": false }), "symmetric: no"),
            (json!([]), "none"),
            (json!(0.499_6), "0.4996"),
            (json!(12.345_6), "12.35"),
            (json!(null), "nothing in particular"),
            (json!({}), "nothing in particular"),
        ] {
            assert_eq!(asked(&value), wanted, "{value}");
        }
        assert_eq!(built(&json!(null)), "nothing that can be measured");
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

//! What checks found, in the words of the pages.

use serde_json::Value;

use super::arguments::{Args, plain, range};
use super::claims::{claim, pascals, sentence};
use plumbline_engine::grading::advisory::Advisory;
use plumbline_engine::grading::report::{CheckReport, TurnReport};
use plumbline_engine::text::counted;

/// Says what a check found in one sentence, without what it requires.
#[must_use]
pub fn found(check: &CheckReport) -> String {
    let measured = Args(&check.finding.measured);
    let told = match &*check.name {
        "shape.level_has" => level_found(measured),
        "size.is_equal" | "size.is_leq" | "size.all_dimensions_geq" => extents_found(measured),
        "material.is_made_of" => {
            check.finding.measured.as_f64().map(|share| format!("{} of the blocks are", percent(share)))
        }
        STRESS => stress_found(check),
        EQUILIBRIUM => built(check).map(|greatest| format!("the greatest stress in equilibrium is {greatest}")),
        _ => None,
    };
    // What was built under the ground has no upper surface.
    let is_empty = |line: &str| check.finding.measured[line].as_array().is_some_and(Vec::is_empty);
    if is_empty("along_x") && is_empty("along_z") {
        return "Nothing of it stands above the ground".to_owned();
    }
    let summary = check.finding.summary.split("; required").next().unwrap_or_default();
    sentence(&told.unwrap_or_else(|| readable(&in_good_number(&summary.replace("y=", "y = ")))))
}

/// Check whose values are pressures by both methods.
const STRESS: &str = "structural_stability.stress_score";
/// Check whose values are pressures in equilibrium.
const EQUILIBRIUM: &str = "structural_stability.equilibrium_score";

/// Returns whether a check measures a pressure.
fn is_pressure(check: &CheckReport) -> bool {
    matches!(&*check.name, STRESS | EQUILIBRIUM)
}

/// Returns whether a check measures a share of blocks.
fn is_share(check: &CheckReport) -> bool {
    matches!(&*check.name, "material.is_made_of" | "material.is_all_material_equal_to")
        || check.args.get("ratio_threshold").is_some()
}

/// Writes what a check required in words and numbers, such as "blocks: at least 4; y: 0"; `None` if nothing in particular.
#[must_use]
pub fn asked(check: &CheckReport) -> Option<String> {
    let required = &check.finding.required;
    let most = is_pressure(check).then(|| required.get("<=").and_then(Value::as_f64)).flatten();
    most.map(|most| format!("at most {}", pascals(most))).or_else(|| {
        let name = if is_share(check) && required.get("of").is_none() { "share" } else { "" };
        told_as(name, required)
    })
}

/// Writes what a check measured in words and numbers, such as "blocks: 4; parts: 1"; `None` if it measured nothing.
#[must_use]
pub fn built(check: &CheckReport) -> Option<String> {
    let measured = &check.finding.measured;
    match measured.as_f64() {
        Some(pa) if is_pressure(check) => Some(pa).filter(|pa| *pa > 0.0).map(pascals),
        Some(_) if is_share(check) => told_as("share", measured),
        _ => told(measured),
    }
}

/// Writes an advisory with the check that it is about in words.
#[must_use]
pub fn note(turns: &[TurnReport], advisory: &Advisory) -> String {
    let turn = turns.iter().find(|turn| turn.turn == advisory.turn);
    let check = turn.zip(advisory.check).and_then(|(turn, at)| turn.checks.get(at as usize));
    let named = check.and_then(|check| Some((check, advisory.detail.strip_prefix(&*check.name)?)));
    match named {
        Some((check, rest)) => format!("“{}”{}", claim(&check.name, &check.args), readable(rest)),
        None => sentence(&advisory.detail),
    }
}

/// Returns what to call the blocks that a check shows: they explain a fault, or where it looked.
#[must_use]
pub fn marked(check: &CheckReport) -> &'static str {
    if check.finding.holds() { "marked block" } else { "flagged block" }
}

/// Says which stress was found, and which in equilibrium.
fn stress_found(check: &CheckReport) -> Option<String> {
    let figures = check.finding.stress.as_ref()?;
    let beside = figures.fem.max_von_mises_pa.map(|pa| format!("; in equilibrium it is {}", pascals(pa)));
    let found = match built(check) {
        Some(greatest) => format!("the greatest stress is {greatest} by the published method, which counts"),
        None if figures.sph.is_undefined => "the published method gives no stress here, which scores 0".to_owned(),
        None => "the published method finds no stress, which scores 0".to_owned(),
    };
    Some(found + &beside.unwrap_or_default())
}

/// Writes names of blocks and of their kinds as people do: `#beds`, `oak_planks`. What is quoted stays as it is written.
fn readable(text: &str) -> String {
    let mut text = text.to_owned();
    for (tag, one) in [("#beds", "bed"), ("#doors", "door")] {
        text = text.replace(&format!("blocks of {tag}"), &format!("{one}s")).replace(&format!("block of {tag}"), one);
    }
    let is_name = |word: &str| {
        (word.contains('_') || word.starts_with('#'))
            && word.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '_' | '#'))
    };
    let words = text.split(' ').map(|word| {
        let bare = word.trim_matches(|c: char| matches!(c, ',' | ';' | ':' | '.' | '(' | ')'));
        if is_name(bare) {
            word.replace(bare, bare.trim_start_matches(['#', '_']).replace('_', " ").trim_end())
        } else {
            word.to_owned()
        }
    });
    words.collect::<Vec<_>>().join(" ")
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
            let side = |(name, value): (&String, &Value)| Some(format!("{}{}", sign(name)?, grouped(value)?));
            let all: Vec<String> = members.iter().filter_map(side).collect();
            (!all.is_empty()).then(|| all.join(" and "))
        }
        Value::Object(members) => {
            let member = |(name, value): (&String, &Value)| {
                // Reports of earlier programs have names of two words.
                let ends = name.rsplit_once(' ').and_then(|(name, end)| Some((name, sign(end)?)));
                let (name, sign) = ends.unwrap_or((name, ""));
                let told = if value.is_array() { grouped(value)? } else { told_as(name, value)? };
                Some(format!("{}: {sign}{told}", name.replace('_', " ")))
            };
            let all: Vec<String> = members.iter().filter_map(member).collect();
            (!all.is_empty()).then(|| all.join("; "))
        }
    }
}

/// Writes a value, and a list of several in brackets.
fn grouped(value: &Value) -> Option<String> {
    let is_many = value.as_array().is_some_and(|list| list.len() > 1);
    told(value).map(|told| if is_many { format!("({told})") } else { told })
}

/// Writes a share as a percentage that is 0 % and 100 % only where the share is.
fn percent(share: f64) -> String {
    let short = plain(share * 100.0);
    match short.as_str() {
        "100" if share < 1.0 => "99.99 %".to_owned(),
        "0" if share > 0.0 => "0.01 %".to_owned(),
        _ => format!("{short} %"),
    }
}

/// Writes a value by its name: shares are percentages.
fn told_as(name: &str, value: &Value) -> Option<String> {
    match value.as_f64() {
        Some(share) if matches!(name, "share" | "cover") => Some(percent(share)),
        _ => match value.as_object() {
            Some(bounds) if matches!(name, "share" | "cover") => {
                let side =
                    |(bound, value): (&String, &Value)| Some(format!("{}{}", sign(bound)?, told_as(name, value)?));
                let all: Vec<String> = bounds.iter().filter_map(side).collect();
                (!all.is_empty()).then(|| all.join(" and "))
            }
            _ => told(value),
        },
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
            (json!({ "of": "#red_concrete", "share >=": 0.5 }), "of: red concrete; share: at least 50 %"),
            (json!({ "cover": { ">=": 0.9 }, "clear": 2 }), "clear: 2; cover: at least 90 %"),
            (json!({ "clear levels": 3, "deck": true }), "clear levels: 3; deck: yes"),
            (json!({ "size": { ">=": [2, 3] } }), "size: at least (2, 3)"),
            (json!({ "symmetric": false }), "symmetric: no"),
            (json!([]), "none"),
            (json!(0.499_6), "0.4996"),
            (json!(12.345_6), "12.35"),
        ] {
            assert_eq!(told(&value).as_deref(), Some(wanted), "{value}");
        }
        assert_eq!(told(&json!(null)), None);
        assert_eq!(told(&json!({})), None);
    }

    #[test]
    fn findings_are_told_without_what_was_required() {
        let made = |name: &str, measured: Value, summary: &str| {
            let finding = Finding::binary(false, measured, json!({}), summary);
            CheckReport { name: name.to_owned().into(), args: json!({}), criterion: Criterion::Shape, finding }
        };
        let told = |name: &str, measured: Value, summary: &str| found(&made(name, measured, summary));
        let none = json!({ "blocks": 0, "parts": 0, "widest": [0, 0] });
        assert_eq!(told("shape.level_has", none, "0 blocks in 0 separate parts"), "No block");
        let one = json!({ "blocks": 1, "parts": 1, "widest": [1, 1] });
        assert_eq!(told("shape.level_has", one, ""), "1 block in one part; the widest measures 1 × 1");
        let extents = json!({ "x": 4.0, "y": 6.0, "z": 4.0 });
        assert_eq!(told("size.is_equal", extents, "spans 4 x 4"), "4 × 4 in plan and 6 blocks high");
        assert_eq!(told("material.is_made_of", json!(0.325), ""), "32.5 % of the blocks are");
        assert_eq!(told("size.max_y_is_geq", json!(2), "highest y is 2; required >= 12"), "Highest y is 2");
        assert_eq!(
            told("shape.climbs_to", json!(-1), "the climb ends at y=-1; required 4"),
            "The climb ends at y = -1"
        );

        let buried = json!({ "clear": 0, "closed": true, "falls_to_all_sides": false, "along_x": [], "along_z": [] });
        assert_eq!(told("shape.is_vault", buried, "flat"), "Nothing of it stands above the ground");
        assert_eq!(told("material.count_is_within", json!(1), "1 blocks"), "1 block");
        let floats = told("physical_plausibility.is_ground_connected", json!(1), "1 of 1 blocks float");
        assert_eq!(floats, "1 of 1 block floats");

        let mut stress = made(STRESS, json!(61_557_000.0), "greatest von Mises stress 61557000.00 Pa");
        stress.finding.required = json!({ "<=": 62_000.0 });
        assert_eq!((asked(&stress), built(&stress)), (Some("at most 62 kPa".to_owned()), Some("61.56 MPa".to_owned())));
        stress.finding.measured = json!(0.0);
        assert_eq!(built(&stress), None, "no stress is no measurement of 0");
        let mut equilibrium = made(EQUILIBRIUM, json!(2_285.7), "greatest von Mises stress 2285.70 Pa in equilibrium");
        equilibrium.finding.required = json!({ "<=": 1_000 });
        assert_eq!(
            (asked(&equilibrium), built(&equilibrium)),
            (Some("at most 1 kPa".to_owned()), Some("2.29 kPa".to_owned()))
        );
        assert_eq!(found(&equilibrium), "The greatest stress in equilibrium is 2.29 kPa");

        let mut share = made("material.is_made_of", json!(0.325), "");
        assert_eq!(built(&share).as_deref(), Some("32.5 %"));
        share.finding.required = json!({ "of": "#red_concrete", "share >=": 0.5 });
        assert_eq!(asked(&share).as_deref(), Some("of: red concrete; share: at least 50 %"));
        let mut side = made("material.is_min_x_material_equal_to", json!(1.0), "");
        (side.args, side.finding.required) = (json!({ "ratio_threshold": 0.5 }), json!({ ">=": 0.5 }));
        assert_eq!((asked(&side).as_deref(), built(&side).as_deref()), (Some("at least 50 %"), Some("100 %")));
        assert_eq!([1.0, 0.999_96, 0.000_01, 0.0].map(percent), ["100 %", "99.99 %", "0.01 %", "0 %"]);

        let told = |summary: &str| told("shape.walks_out", json!(null), summary);
        assert_eq!(told("1 of 2 blocks of #beds, and \"_door\""), "1 of 2 beds, and \"_door\"");
        assert_eq!(told("1 block of #doors to start from"), "1 door to start from");
        assert_eq!(told("oak_planks begins before #red is complete"), "Oak planks begins before red is complete");
        assert_eq!(told("at y = -1: no block"), "At y = -1: no block");
    }
}

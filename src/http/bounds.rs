//! Bounds in the OpenAPI document that are limits of the service, taken from where they are enforced.
//!
//! An attribute of utoipa takes a literal only, so it cannot name a limit.

use utoipa::openapi::path::Parameter;
use utoipa::openapi::{Components, RefOr, Schema};

use crate::app::limits::LIMITS;
use plumbline_engine::intake::MAX_FILES;

/// A bound on a value.
#[derive(Debug, Clone, Copy)]
enum Bound {
    /// Fewest and most characters of a string.
    Chars(usize, usize),
    /// Most characters of a string.
    MaxChars(usize),
    /// Most items of a list.
    MaxItems(usize),
    /// Least and greatest number.
    Range(i32, i32),
    /// Greatest number.
    Max(u64),
}

use Bound::{Chars, Max, MaxChars, MaxItems, Range};

/// Bounds of the members of bodies, by schema and member.
const BOUNDS: [(&str, &str, Bound); 26] = [
    ("InlineTask", "turns", MaxItems(LIMITS.turns)),
    ("InlineTurn", "checks", MaxItems(LIMITS.grade_inline_checks)),
    ("NewAnswerBody", "turns", MaxItems(LIMITS.turns)),
    ("NewBoardAction", "reason", MaxChars(LIMITS.reason_chars)),
    ("NewDraw", "nonce", Chars(LIMITS.nonce_min_chars, LIMITS.nonce_max_chars)),
    ("NewEntryBody", "agent", MaxChars(LIMITS.agent_chars)),
    ("NewEntryBody", "runs", Max(LIMITS.entry_runs as u64)),
    ("NewEvent", "material", MaxChars(LIMITS.material_chars)),
    ("NewEvent", "x", Range(-LIMITS.horizontal, LIMITS.horizontal)),
    ("NewEvent", "y", Range(LIMITS.min_y, LIMITS.max_y)),
    ("NewEvent", "z", Range(-LIMITS.horizontal, LIMITS.horizontal)),
    ("NewGrade", "deadline_ms", Max(LIMITS.grade_max_deadline_ms)),
    ("NewGrade", "suite", MaxChars(LIMITS.suite_chars)),
    ("NewGrade", "turns", MaxItems(LIMITS.turns)),
    ("NewKey", "expires_days", Max(LIMITS.key_days.unsigned_abs())),
    ("NewRunBody", "agent", MaxChars(LIMITS.agent_chars)),
    ("NewRunBody", "suite", MaxChars(LIMITS.suite_chars)),
    ("NewSubmissionBody", "suite", MaxChars(LIMITS.suite_chars)),
    ("NewSubmissionBody", "turns", MaxItems(LIMITS.turns)),
    ("NewTurn", "events", MaxItems(LIMITS.events)),
    ("NewTurn", "rows", MaxItems(LIMITS.events)),
    ("NewWebhook", "url", MaxChars(LIMITS.webhook_url_chars)),
    ("NewWithdrawal", "reason", MaxChars(LIMITS.reason_chars)),
    ("RewardQuery", "labels", MaxItems(LIMITS.grade_batch_logs)),
    ("RewardQuery", "prompts", MaxItems(LIMITS.grade_batch_logs)),
    ("RewardQuery", "query", MaxItems(LIMITS.grade_batch_logs)),
];

/// Sets the bounds of the members of bodies.
pub fn set_in_bodies(components: &mut Components) {
    for (body, member, bound) in BOUNDS {
        let Some(RefOr::T(Schema::Object(body))) = components.schemas.get_mut(body) else {
            unreachable!("the document has an object {body}");
        };
        set(body.properties.get_mut(member), bound);
    }
    let Some(RefOr::T(Schema::OneOf(code))) = components.schemas.get_mut("ActionCode") else {
        unreachable!("action code is one text or several");
    };
    // Action code has at least as many bytes as characters.
    let bounds = [MaxChars(LIMITS.action_text_bytes), MaxItems(MAX_FILES)];
    for (form, bound) in code.items.iter_mut().zip(bounds) {
        set(Some(form), bound);
    }
}

/// Sets the bounds of a parameter: each list takes the same `limit`.
pub fn set_in_parameter(parameter: &mut RefOr<Parameter>) {
    if let RefOr::T(parameter) = parameter
        && parameter.name == "limit"
    {
        set(parameter.schema.as_mut(), Max(LIMITS.page_items.into()));
    }
}

fn set(schema: Option<&mut RefOr<Schema>>, bound: Bound) {
    match (schema, bound) {
        (Some(RefOr::T(Schema::Array(list))), MaxItems(most)) => list.max_items = Some(most),
        (Some(RefOr::T(Schema::Object(value))), bound) => match bound {
            Chars(least, most) => (value.min_length, value.max_length) = (Some(least), Some(most)),
            MaxChars(most) => value.max_length = Some(most),
            Range(least, most) => (value.minimum, value.maximum) = (Some(least.into()), Some(most.into())),
            Max(most) => value.maximum = Some(most.into()),
            MaxItems(_) => unreachable!("only a list has items"),
        },
        (_, bound) => unreachable!("no schema takes the bound {bound:?}"),
    }
}

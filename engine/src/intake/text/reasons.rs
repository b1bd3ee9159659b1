//! Reasons why a text has no answer, in words for its author.

use super::bare_code::calls_skills;
use super::fences::{Fence, fences};
use super::thinking::without_thoughts;
use super::{begin_of, code_fences, json};
use crate::intake::not_json::{message, remedy};
use crate::text::line_of;

/// Says why a text has no answer: what it has instead, and what to write.
pub(super) fn why_none(text: &str, fences: &[Fence], json: &json::Scanned) -> String {
    if let Some(at) = json.unfinished {
        return format!("the JSON that begins on line {} is incomplete", line_of(text, at));
    }
    if json.is_given_up {
        return "too many brackets that are not JSON; put the answer into a code fence".to_owned();
    }
    if let Some(why) = faulty_json(text, fences) {
        return why;
    }
    if json.other_values > 0 {
        return NO_LOG.to_owned();
    }
    match fences.last() {
        Some(fence) if text[fence.content.clone()].trim().is_empty() => "the last code fence is empty".to_owned(),
        Some(fence) if !fence.language.is_empty() => {
            format!("the last code fence is {:?}, which is neither JSON nor JavaScript", fence.language)
        }
        _ if is_command(text) => "a command is sent by code, as bot.chat('/fill 0 0 0 4 4 0 stone')".to_owned(),
        _ => NOTHING.to_owned(),
    }
}

/// Returns whether a text begins with a command that builds, and not with a path or a comment.
fn is_command(text: &str) -> bool {
    let command = text.trim_start().strip_prefix('/').and_then(|rest| rest.split_whitespace().next());
    command.is_some_and(|name| ["fill", "setblock", "clone"].contains(&name.strip_prefix("minecraft:").unwrap_or(name)))
}

/// Why an object with a member for each turn is no answer.
pub(super) const NAMED_TURNS: &str = "the JSON in the answer has a member for each turn; expected one list, as {\"turns\": [{\"events\": […]}, {\"events\": […]}]}";

/// Why JSON of another form is no answer.
pub const NO_LOG: &str = "the JSON in the answer is not a block log: expected an object with turns, events, rows or action_code, or an array of events";

/// Explains what is wrong with a text that was meant as JSON: the last fence, or the whole text, if it begins and ends with
/// brackets.
fn faulty_json(text: &str, fences: &[Fence]) -> Option<String> {
    let range = match fences.last() {
        None => 0..text.len(),
        Some(fence) if ["", "json", "jsonc", "json5"].contains(&fence.language.as_str()) => fence.content.clone(),
        Some(_) => return None,
    };
    let (begin, meant) = (range.end - text[range.clone()].trim_start().len(), text[range].trim());
    if !meant.starts_with(['{', '[']) || !meant.ends_with(['}', ']']) {
        return None;
    }
    let error = serde_json::from_str::<serde::de::IgnoredAny>(meant).err()?;
    let message = message(&error);
    let what = message.split(" at line ").next().unwrap_or(&message);
    if what == "trailing characters" {
        return None;
    }
    let line = line_of(text, begin) + error.line().saturating_sub(1);
    let remedy = remedy(meant.as_bytes(), &error).map(|remedy| format!(": {remedy}")).unwrap_or_default();
    Some(format!("the JSON is not valid in line {line}: {what}{remedy}"))
}

/// Reason for a text that has nothing like an answer.
const NOTHING: &str = "there is neither a block log as JSON nor action code in the answer";

/// Returns what a text without action code has instead, if that is like an answer.
#[must_use]
pub fn why_no_answer(text: &str) -> Option<String> {
    let (shown, _) = without_thoughts(text);
    let json = json::logs_in(&shown);
    let why = why_none(&shown, &fences(&shown), &json);
    (json.logs.is_empty() && why != NOTHING).then_some(why)
}

/// Returns why a text, without thoughts, has no answer, if all that could be one is JSON that the end of the text cuts off.
#[must_use]
pub fn cut_off_json(text: &str) -> Option<String> {
    let (shown, _) = without_thoughts(text);
    let fences = fences(&shown);
    let json = json::logs_in(&shown);
    let at = json.unfinished.filter(|_| json.logs.is_empty())?;
    let is_code =
        code_fences(&shown, &fences, &[]).any(|range| begin_of(&shown, &range) < at) || calls_skills(&shown[..at]);
    (!is_code).then(|| why_none(&shown, &fences, &json))
}

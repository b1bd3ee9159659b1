//! Finds the answer in a language model's output: a block log as JSON or action code, alone, fenced or in prose.
//!
//! The last complete answer outside thinking tags counts; fenced answers have no precedence over bare ones. An answer
//! is JSON in the form of a log (an object with `turns`, `events`, `rows` or `action_code`, or a list of turns or of
//! events), or code: a fence of JavaScript, or lines that call `skills`.

mod bare_code;
pub mod fences;
mod json;
pub mod marks;
mod reasons;
pub mod template;
pub mod thinking;

pub use json::WASTE_BYTES;
pub use reasons::{NO_LOG, cut_off_json, why_no_answer};

use std::ops::Range;

use super::LogLimits;
use super::code::{SentLog, on_its_lines};
use crate::text::line_of;
use bare_code::{calls_skills, is_script_start, regions};
use fences::{Fence, fences};
use reasons::{NAMED_TURNS, why_none};
use thinking::{left_out, without_thoughts};

/// The kind of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnswerKind {
    /// A block log as JSON.
    Log,
    /// Action code in JavaScript.
    Code,
}

/// An answer found in a text.
#[derive(Debug, Clone)]
pub struct FoundAnswer {
    /// The log. An answer in code is a log of one turn with that code.
    pub sent: SentLog,
    /// Whether the answer is a log or code.
    pub kind: AnswerKind,
    /// Line on which the answer begins, from 1.
    pub line: usize,
    /// Number of earlier answers, which do not count.
    pub passed_over: usize,
    /// Line on which JSON begins after the answer that the end of the text cuts off, from 1.
    pub cut_off: Option<usize>,
    /// What of the text was not read because a thought begins there that never ends.
    pub left_out: Option<String>,
}

/// Finds the last complete answer in `text` and reads it.
///
/// # Errors
/// Returns a human-readable reason if the text holds no answer that can be graded.
pub fn read_answer(text: &str, limits: LogLimits) -> Result<FoundAnswer, String> {
    let (shown, ends_in_thought) = without_thoughts(text);
    let fences = fences(&shown);
    let json = json::logs_in(&shown);
    let mut candidates: Vec<(AnswerKind, Range<usize>)> =
        json.logs.iter().map(|range| (AnswerKind::Log, range.clone())).collect();
    candidates.extend(code_fences(&shown, &fences, &json.logs).map(|range| (AnswerKind::Code, range)));
    candidates.extend(regions(&shown, &fences, &json.logs).map(|range| (AnswerKind::Code, range)));
    // What looks like code within JSON that is cut off is a part of it.
    candidates.retain(|(_, range)| json.unfinished.is_none_or(|at| begin_of(&shown, range) < at));
    // Strings within JSON may look like code.
    let other = other_json(&shown, &fences, &json);
    if other
        .is_some_and(|other| candidates.iter().all(|(_, range)| other.start <= range.start && range.end <= other.end))
    {
        return Err(NO_LOG.to_owned());
    }
    // JSON data within code ends before the code, so the code is chosen.
    let Some((kind, range)) = candidates.iter().max_by_key(|(_, range)| (range.end, range.start)).cloned() else {
        let left_out = left_out(text);
        let is_all = shown.trim().is_empty();
        return Err(match left_out {
            None if text.trim().is_empty() => "the answer has no text; what a tool call says is not read".to_owned(),
            None if is_all => "the answer has nothing but thoughts".to_owned(),
            Some(why) if is_all || ends_in_thought => why,
            Some(why) => format!("{}; {why}", why_none(&shown, &fences, &json)),
            None if calls_skills(text) && !calls_skills(&shown) => {
                format!("{}; its thoughts, which hold code, were left out", why_none(&shown, &fences, &json))
            }
            None => why_none(&shown, &fences, &json),
        });
    };
    if json.named_turns.as_ref().is_some_and(|named| named.start <= range.start && range.end <= named.end) {
        return Err(NAMED_TURNS.to_owned());
    }
    let sent = match kind {
        AnswerKind::Code => SentLog::of_code(on_its_lines(&shown, range.clone())),
        AnswerKind::Log => json::read(&shown[range.clone()], limits)
            .map_err(|why| format!("{why} (in the JSON that begins on line {})", line_of(&shown, range.start)))?,
    };
    let passed_over = candidates.iter().filter(|(_, other)| other.end < range.start).count();
    let cut_off = json.unfinished.filter(|at| *at >= range.end).map(|at| line_of(&shown, at));
    let left_out = if ends_in_thought { left_out(text) } else { None };
    Ok(FoundAnswer { sent, kind, line: line_of(&shown, range.start), passed_over, cut_off, left_out })
}

/// Returns where the text of a range begins, without the white space before it.
fn begin_of(text: &str, range: &Range<usize>) -> usize {
    range.end - text[range.clone()].trim_start().len()
}

/// Returns whether a text, without thoughts, is JSON that is no block log: a list or an object, alone or in the only fence.
#[must_use]
pub fn is_other_json(text: &str) -> bool {
    let (shown, _) = without_thoughts(text);
    other_json(&shown, &fences(&shown), &json::logs_in(&shown)).is_some()
}

/// Returns where a text has JSON that is no block log and all that the text, or its only fence, has.
fn other_json(text: &str, fences: &[Fence], json: &json::Scanned) -> Option<Range<usize>> {
    let place = match fences {
        [] => 0..text.len(),
        [fence] => fence.content.clone(),
        _ => return None,
    };
    let alone = text[place.clone()].trim();
    let is_json = alone.starts_with(['{', '[']) && serde_json::from_str::<serde::de::IgnoredAny>(alone).is_ok();
    (is_json && json.logs.is_empty()).then_some(place)
}

/// Returns the contents of the fences of action code: those that call `skills` or, if none does, all of JavaScript.
fn code_fences<'t>(
    text: &'t str,
    fences: &'t [Fence],
    logs: &'t [Range<usize>],
) -> impl Iterator<Item = Range<usize>> + 't {
    let is_blank = |fence: &Fence| text[fence.content.clone()].trim().is_empty();
    let is_code = |fence: &&Fence| match fence.language.as_str() {
        // A text often ends where a fence was opened; that says nothing about what came before.
        _ if is_blank(fence) => false,
        "js" | "javascript" | "jsx" | "mjs" | "cjs" | "ts" | "typescript" | "node" => true,
        "" => {
            let content = text[fence.content.clone()].trim_start();
            let first = logs.partition_point(|log| log.start < fence.content.start);
            let holds_log = logs.get(first).is_some_and(|log| log.start < fence.content.end);
            let is_log = holds_log && content.starts_with(['{', '[']);
            !is_log && (is_script_start(content) || calls_skills(content))
        }
        _ => false,
    };
    let all: Vec<Range<usize>> = fences.iter().filter(is_code).map(|fence| fence.content.clone()).collect();
    let any_calls = all.iter().any(|range| calls_skills(&text[range.clone()]));
    all.into_iter().filter(move |range| !any_calls || calls_skills(&text[range.clone()]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: LogLimits = LogLimits { max_turns: 4, max_events: 10, max_materials: 5, max_material_chars: 20 };

    #[test]
    fn an_empty_fence_is_no_answer() {
        let code = "```js\nawait skills.placeBlock(bot, 'stone', 0, 0, 0);\n```\n";
        for empty in ["```js\n", "```js\n```\n", "```\n \n\n```"] {
            let found = read_answer(&format!("{code}{empty}"), LIMITS).unwrap();
            assert_eq!((found.kind, found.line, found.passed_over), (AnswerKind::Code, 2, 0), "{empty:?}");
            assert_eq!(read_answer(empty, LIMITS).unwrap_err(), "the last code fence is empty");
        }
    }

    /// Returns the number of events of the log that is found, or its code without the surrounding line breaks.
    fn found(text: &str) -> Result<String, String> {
        read_answer(text, LIMITS).map(|found| match found.kind {
            AnswerKind::Log if found.sent.codes.is_empty() => format!("{} events", found.sent.log.event_count()),
            _ => found.sent.codes.iter().map(|code| code.files[0].trim()).collect::<Vec<_>>().join(" | "),
        })
    }

    fn events(count: usize) -> String {
        let event = |i| format!(r#"{{"action":"place","x":{i},"y":0,"z":0,"material":"stone"}}"#);
        format!("[{}]", (0..count).map(event).collect::<Vec<_>>().join(","))
    }

    #[test]
    fn logs_are_found_in_every_form_and_surrounding() {
        let (list, turn) = (events(1), format!(r#"{{"events":{}}}"#, events(1)));
        for text in [
            list.clone(),
            turn.clone(),
            format!("[{turn}]"),
            format!(r#"{{"turns":[{turn}],"thoughts":"none"}}"#),
            r#"{"palette":["stone"],"rows":[[0,0,0,0]]}"#.to_owned(),
            r#"{"palette":["stone"],"turns":[[[0,0,0,0]]]}"#.to_owned(),
            format!("Here it is:\n```json\n{turn}\n```\nDone."),
            format!("```\n[1, 2]\n```\nand then\n```json\n{list}\n```"),
            format!("I place [one] block: {turn} and stop."),
            format!("Say [a] [b] [c] [d] [e] [f] [g] [h] [i] [j] [k] [l] [m] [n] [o] [p] [q] {{r}}, then {turn}"),
            format!("My plan: [0, 1, 2] and {{\"walls\": 4}}. {turn}"),
            format!("```json\n{{\"answer\": {turn}}}\n```"),
        ] {
            assert_eq!(found(&text).as_deref(), Ok("1 events"), "{text}");
        }
    }

    #[test]
    fn the_last_complete_answer_counts() {
        let (one, two) = (format!(r#"{{"events":{}}}"#, events(1)), format!(r#"{{"events":{}}}"#, events(2)));
        let code = "await skills.placeBlock(bot, 'stone', 0, 0, 0);";
        for (text, expected) in [
            (format!("<think>{one}</think>{two}"), "2 events"),
            (format!("{one}</think>{two}"), "2 events"),
            (format!("{two}\n<think>or rather {one}</think>"), "2 events"),
            (format!("```json\n{one}\n```\nNo, better: {two}"), "2 events"),
            (format!("{one}\nas JSON:\n```json\n{two}\n```"), "2 events"),
            (format!("{two} {{\"events\": [{{"), "2 events"),
            (format!("```json\n{one}\n```\n```js\n{code}\n```"), code),
            (format!("```js\n{code}\n```\n```json\n{one}\n```"), "1 events"),
            (format!("```js\n{code}\n```\nRun it with\n```js\nmain()\n```"), code),
            (format!("{{\"turn1\": {one}, \"turn2\": {one}}}\nAs asked: {two}"), "2 events"),
            (
                format!("```js\nconst blocks = {};\n{code}\n```", events(3)),
                &format!("const blocks = {};\n{code}", events(3)),
            ),
            (format!("Here:\n{code}\nThat is all."), code),
            (format!("{code}\nAs JSON:\n{one}"), "1 events"),
            (format!("```\n{code}\n```"), code),
            (format!("Plan:\n```json\n{{\"steps\": [\"a\"]}}\n```\n{code}"), code),
            (format!("```js\n{code}"), code),
            (format!(r#"{{"turns": [{{"action_code": "{code}"}}]}}"#), code),
            (format!(r#"{{"action_code": "{code}"}}"#), code),
            (format!(r#"{{"action_code": ["{code}"]}}"#), code),
            (
                format!("```js\n{code}\nconst more = [{{\"x\": 1}}, {{\"x\":"),
                &format!("{code}\nconst more = [{{\"x\": 1}}, {{\"x\":"),
            ),
        ] {
            assert_eq!(found(&text).as_deref(), Ok(expected), "{text}");
        }
        let text = format!("{one}\n\nrather\n{two}");
        let answer = read_answer(&text, LIMITS).unwrap();
        assert_eq!((answer.line, answer.passed_over, answer.cut_off), (4, 1, None));
        let text = format!("Like {one}:\n```json\n{{\"events\": [{{\"action\":");
        assert_eq!(read_answer(&text, LIMITS).unwrap().cut_off, Some(3));
    }

    #[test]
    fn characters_without_width_hide_no_line_of_code() {
        let code = "(async (bot) => {\n  await skills.placeBlock(bot, 'stone', 0, 0, 0);\n})";
        for before in ["\u{feff}", "\u{200b}", " \u{feff}\n"] {
            let found = read_answer(&format!("{before}{code}"), LIMITS).unwrap();
            assert!(found.sent.codes[0].files[0].contains("(async (bot)"), "{before:?}");
        }
    }

    #[test]
    fn code_keeps_its_lines() {
        let text = "Sure!\n\n```js\nfirst();\nawait skills.wait(bot, 1);\n```\n";
        let code = read_answer(text, LIMITS).unwrap().sent.codes.remove(0).files.remove(0);
        assert_eq!(code.lines().nth(3), Some("first();"));
    }

    #[test]
    fn what_is_no_answer_is_told() {
        for (text, why) in [
            ("I cannot do this.", "there is neither a block log as JSON nor action code in the answer"),
            (" \n", "the answer has no text; what a tool call says is not read"),
            ("// I cannot.", "there is neither a block log as JSON nor action code in the answer"),
            ("<think>A wall.</think>\n", "the answer has nothing but thoughts"),
            ("/home/me/build.js", "there is neither a block log as JSON nor action code in the answer"),
            ("/fill 0 0 0 4 4 0 stone", "a command is sent by code, as bot.chat('/fill 0 0 0 4 4 0 stone')"),
            (
                "<think>{\"events\": []}",
                "the answer ends inside a thinking tag that is never closed: <think> in line 1",
            ),
            (
                "{\"events\": []}\n</think>",
                "everything before </think> in line 2 was taken for thoughts, and no answer follows",
            ),
            ("So:\n{\"events\": [{\"action\":", "the JSON that begins on line 2 is incomplete"),
            (
                "{\"plan\": [1, 2]}",
                "the JSON in the answer is not a block log: expected an object with turns, events, rows or action_code, or an array of events",
            ),
            (
                "So:\n```json\n{\"events\": [{\"x\": 1},]}\n```",
                "the JSON is not valid in line 3: expected value: JSON has no comma after the last value",
            ),
            (
                "{'events': []}",
                "the JSON is not valid in line 1: key must be a string: JSON has straight double quotes around names and strings",
            ),
            ("{\"plan\": 1}\n{\"b\": 2}", NO_LOG),
            ("{\"code\": \"await skills.wait(bot, 1);\"}", NO_LOG),
            (
                "```python\n[x for x in y]\n```",
                "the last code fence is \"python\", which is neither JSON nor JavaScript",
            ),
            ("```python\nprint(1)\n```", "the last code fence is \"python\", which is neither JSON nor JavaScript"),
            (
                "{\"events\":[{\"action\":\"place\",\"x\":0.5,\"y\":0,\"z\":0,\"material\":\"stone\"}]}",
                "/events/0/x: 0.5 is not an integer (in the JSON that begins on line 1)",
            ),
            (
                "Two:\n[{\"events\":[]},{\"events\":[{\"action\":\"place\",\"x\":0,\"y\":0,\"z\":0,\"block\":7}]}]",
                "/1/events/0/block: unknown field; an event has action, x, y, z and material; /1/events/0/material: missing: an event that places a block needs a material (in the JSON that begins on line 2)",
            ),
            (
                "[{\"action\":\"place\",\"x\":0,\"y\":\"a\",\"z\":0,\"material\":\"stone\"}]",
                "/0/y: expected an integer, found \"a\" (in the JSON that begins on line 1)",
            ),
            ("{\"turns\":[{\"events\":[]},{\"events\":[", "the JSON that begins on line 1 is incomplete"),
            ("[{\"phase\":\"floor\",\"events\":[]},{\"phase\":", "the JSON that begins on line 1 is incomplete"),
            ("{\"action_code\": \"await skills.wait(bot, 1);", "the JSON that begins on line 1 is incomplete"),
            ("```\n{\"action_code\": \"await skills.wait(bot, 1);", "the JSON that begins on line 2 is incomplete"),
            ("{\"turn1\":{\"events\":[]},\"turn2\":{\"events\":[]}}", NAMED_TURNS),
            (
                "<think>```js\nawait skills.wait(bot, 1);\n```</think>I have written the code above.",
                "there is neither a block log as JSON nor action code in the answer; its thoughts, which hold code, were left out",
            ),
        ] {
            assert_eq!(found(text), Err(why.to_owned()), "{text}");
        }
    }

    #[test]
    fn brackets_without_end_are_given_up() {
        let begun = std::time::Instant::now();
        for text in [
            "[".repeat(200_000),
            "[1,".repeat(200_000),
            "{\"a\":[".repeat(100_000),
            "{} ".repeat(100_000),
            "<".repeat(1 << 20),
            "</think>".repeat(1 << 17),
            format!("{}{}", "{\"rows\":[]}".repeat(18_000), "\n".repeat(200_000)),
        ] {
            let _ = found(&text);
        }
        assert!(begun.elapsed().as_secs() < 60, "work is bounded");
    }
}

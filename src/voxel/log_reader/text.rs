//! Finding a block log in what a language model wrote: JSON, alone, in a code fence or after some words.

use serde::Deserialize;
use serde_json::value::RawValue;

use super::{LogLimits, Turns};
use crate::voxel::tolerant::read_document;
use crate::voxel::{BlockLog, Faults};

/// Places in running text at which JSON may begin that are tried.
const TRIES: usize = 16;

/// What tells the form of a log; all else in the object may be anything.
#[derive(Deserialize)]
struct Members<'a> {
    #[serde(borrow)]
    turns: Option<&'a RawValue>,
    #[serde(borrow)]
    events: Option<&'a RawValue>,
    #[serde(borrow)]
    rows: Option<&'a RawValue>,
}

/// The log in `text`: an object with `turns`, one turn, a list of turns, or a list of events. Of several code fences the
/// last that holds one counts.
///
/// # Errors
/// Why there is none, in words.
pub fn read_log_in_text(text: &str, limits: LogLimits) -> Result<BlockLog, String> {
    let mut why = "there is no JSON in the answer".to_owned();
    let fenced: Vec<&str> = text.split("```").skip(1).step_by(2).collect();
    let candidates = fenced.into_iter().rev().map(without_language).chain([text]);
    for candidate in candidates {
        let starts = candidate.char_indices().filter(|(_, c)| matches!(c, '{' | '[')).map(|(at, _)| at);
        for start in starts.take(TRIES) {
            let mut values = serde_json::Deserializer::from_str(&candidate[start..]).into_iter::<&RawValue>();
            let Some(Ok(value)) = values.next() else { continue };
            match read(value.get(), limits) {
                Ok(Some(log)) => return Ok(log),
                Ok(None) => {}
                Err(fault) => why = fault,
            }
            // What lies inside the value is not a log of its own.
            if value.get().len() > 2 {
                break;
            }
        }
    }
    Err(why)
}

/// A fence's content without the name of its language.
fn without_language(fence: &str) -> &str {
    match fence.split_once('\n') {
        Some((first, rest)) if !first.contains(['{', '[']) => rest,
        _ => fence,
    }
}

/// The log that a JSON value is; none where it has not the form of one.
fn read(json: &str, limits: LogLimits) -> Result<Option<BlockLog>, String> {
    let turns = if json.starts_with('{') {
        let Ok(members) = serde_json::from_str::<Members<'_>>(json) else { return Ok(None) };
        match members {
            Members { turns: Some(turns), .. } => turns.get().to_owned(),
            Members { events: Some(events), .. } => format!("[{{\"events\":{}}}]", events.get()),
            Members { rows: Some(_), .. } => format!("[{json}]"),
            Members { .. } => return Ok(None),
        }
    } else {
        let first: Option<Members<'_>> = serde_json::from_str::<Vec<&RawValue>>(json)
            .ok()
            .and_then(|items| items.first().and_then(|item| serde_json::from_str(item.get()).ok()));
        match first {
            Some(Members { turns: None, events: None, rows: None }) => format!("[{{\"events\":{json}}}]"),
            Some(_) => json.to_owned(),
            None => return Ok(None),
        }
    };
    let mut faults = Faults::new();
    let log = read_document(turns.as_bytes(), Turns { faults: &mut faults, limits, codes: None })
        .map_err(|e| e.to_string())?;
    match log {
        Some(log) if faults.is_empty() => Ok(Some(log)),
        _ => {
            Err(faults.list().first().map_or_else(|| "the log has faults".to_owned(), |fault| format!("turns{fault}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: LogLimits = LogLimits { max_turns: 4, max_events: 10, max_materials: 5, max_material_chars: 20 };

    fn blocks(text: &str) -> Result<usize, String> {
        read_log_in_text(text, LIMITS).map(|log| log.event_count())
    }

    #[test]
    fn logs_are_found_in_every_form_and_surrounding() {
        let event = r#"{"action":"place","x":0,"y":0,"z":0,"material":"stone"}"#;
        let turn = format!(r#"{{"events":[{event}]}}"#);
        for text in [
            format!("[{event}]"),
            turn.clone(),
            format!("[{turn}]"),
            format!(r#"{{"turns":[{turn}],"thoughts":"none"}}"#),
            r#"{"palette":["stone"],"rows":[[0,0,0,0]]}"#.to_owned(),
            format!("Here it is:\n```json\n{turn}\n```\nDone."),
            format!("```\n[1, 2]\n```\nand then\n```json\n[{event}]\n```"),
            format!("I place [one] block: {turn} and stop."),
        ] {
            assert_eq!(blocks(&text), Ok(1), "{text}");
        }
    }

    #[test]
    fn what_is_no_log_is_told() {
        assert_eq!(blocks("I cannot do this.").unwrap_err(), "there is no JSON in the answer");
        let fault = blocks(r#"{"events":[{"action":"place","x":0.5,"y":0,"z":0,"material":"stone"}]}"#).unwrap_err();
        assert!(fault.starts_with("turns/0/events/0/x: "), "{fault}");
        assert!(blocks(&"[".repeat(100_000)).is_err());
    }
}

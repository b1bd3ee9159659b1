//! JSON in prose: finds and reads values in the form of a block log.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;
use serde_json::value::RawValue;

use crate::intake::Faults;
use crate::intake::code::SentLog;
use crate::intake::stored::StoredLog;
use crate::intake::tolerant::read_document;
use crate::intake::{LogLimits, Turns};
use crate::text::counted;

/// Fixed part, in bytes, of the budget for reading brackets that begin no JSON, and JSON that is not a log. The rest of
/// the budget is the size of the text times `WASTE_TIMES`.
pub const WASTE_BYTES: usize = 1 << 20;
const WASTE_TIMES: usize = 16;
/// Number of faults that a reason names.
const TOLD: usize = 3;

/// The result of scanning a text for logs.
#[derive(Debug, Default)]
pub(super) struct Scanned {
    /// Byte ranges of the values in the form of a log, in order.
    pub logs: Vec<Range<usize>>,
    /// Number of non-empty JSON objects that are not logs. Lists do not count.
    pub other_values: usize,
    /// Byte offset of the value that is cut off by the end of the text, and of which everything that follows is a part.
    pub unfinished: Option<usize>,
    /// Byte range of the last object that has a member for each turn, which is no form of a log.
    pub named_turns: Option<Range<usize>>,
    /// Whether the scan stopped before the end of the text, because its budget was used up.
    pub is_given_up: bool,
}

/// Looks for a log at every opening bracket outside the logs already found.
pub(super) fn logs_in(text: &str) -> Scanned {
    let mut scanned = Scanned::default();
    let mut left = WASTE_BYTES + WASTE_TIMES * text.len();
    let mut at = 0;
    while let Some(begin) = text[at..].find(['{', '[']).map(|next| at + next) {
        let rest = &text[begin..];
        let mut values = serde_json::Deserializer::from_str(rest).into_iter::<&RawValue>();
        let read = match values.next() {
            Some(Ok(value)) if has_form_of_log(value.get()) => {
                at = begin + value.get().len();
                scanned.logs.push(begin..at);
                continue;
            }
            Some(Ok(value)) => {
                // Empty braces of a script and lists in prose are not meant as JSON.
                let is_object = value.get().starts_with('{') && value.get().contains('"');
                scanned.other_values += usize::from(is_object);
                if is_object && has_named_turns(value.get()) {
                    scanned.named_turns = Some(begin..begin + value.get().len());
                }
                value.get().len()
            }
            Some(Err(error)) => {
                // A bracketed word in prose is a syntax error; a value cut off by the end of the text is JSON so far.
                if error.is_eof() && rest.contains('"') {
                    scanned.unfinished = Some(begin);
                    break;
                }
                offset_of(rest, &error)
            }
            None => 1,
        };
        at = begin + 1;
        let Some(rest) = left.checked_sub(read + 1) else {
            scanned.is_given_up = true;
            break;
        };
        left = rest;
    }
    scanned
}

/// Returns the byte offset in `text` at which the parser met the error.
fn offset_of(text: &str, error: &serde_json::Error) -> usize {
    let lines: usize = text.split_inclusive('\n').take(error.line().saturating_sub(1)).map(str::len).sum();
    lines + error.column()
}

/// The members by which the form of a log is recognised. Other members of the object are ignored.
#[derive(Deserialize)]
struct Members<'a> {
    #[serde(borrow)]
    turns: Option<&'a RawValue>,
    #[serde(borrow)]
    events: Option<&'a RawValue>,
    #[serde(borrow)]
    rows: Option<&'a RawValue>,
    #[serde(borrow)]
    action_code: Option<&'a RawValue>,
}

impl Members<'_> {
    fn is_turn(&self) -> bool {
        let is_list = |value: Option<&RawValue>| value.is_some_and(|value| value.get().starts_with('['));
        let is_text = |value: Option<&RawValue>| value.is_some_and(|value| value.get().starts_with('"'));
        is_list(self.events) || is_list(self.rows) || is_text(self.action_code) || is_list(self.action_code)
    }

    fn is_log(&self) -> bool {
        self.turns.is_some_and(|turns| turns.get().starts_with('['))
    }
}

/// The members by which an event is recognised.
#[derive(Deserialize)]
struct EventMembers<'a> {
    #[serde(borrow)]
    action: Option<&'a RawValue>,
    #[serde(borrow)]
    x: Option<&'a RawValue>,
}

/// The forms of a log in JSON.
enum Form {
    Turns,
    Stored,
    Turn,
    TurnList,
    EventList,
}

fn form_of(json: &str) -> Option<Form> {
    if json.starts_with('{') {
        let members: Members<'_> = serde_json::from_str(json).ok()?;
        return match members {
            Members { turns: Some(turns), .. } if members.is_log() => {
                let first = turns.get()[1..].trim_start().chars().next();
                Some(if first == Some('[') { Form::Stored } else { Form::Turns })
            }
            members => members.is_turn().then_some(Form::Turn),
        };
    }
    let items: Vec<&RawValue> = serde_json::from_str(json).ok()?;
    let first = items.first()?.get();
    let is_turn = serde_json::from_str::<Members<'_>>(first).is_ok_and(|members| members.is_turn());
    let is_event = || {
        let event = serde_json::from_str::<EventMembers<'_>>(first);
        first.starts_with('{') && event.is_ok_and(|event| event.action.is_some() || event.x.is_some())
    };
    if is_turn && first.starts_with('{') { Some(Form::TurnList) } else { is_event().then_some(Form::EventList) }
}

fn has_form_of_log(json: &str) -> bool {
    form_of(json).is_some()
}

/// Reads a JSON value in one of the forms of a log.
///
/// # Errors
/// Returns a description of the first fault of the value.
pub(super) fn read(json: &str, limits: LogLimits) -> Result<SentLog, String> {
    let mut faults = Faults::new();
    let form = form_of(json).ok_or("the JSON is not a block log")?;
    let turns = match form {
        Form::Stored => {
            // Other members of the object are ignored, as in the other forms.
            #[derive(Deserialize)]
            struct Stored<'a> {
                #[serde(borrow)]
                palette: Option<&'a RawValue>,
                #[serde(borrow)]
                turns: &'a RawValue,
            }
            let Stored { palette, turns } = serde_json::from_str(json).map_err(|error| error.to_string())?;
            let palette = palette.map_or("[]", RawValue::get);
            let log = format!("{{\"palette\":{palette},\"turns\":{}}}", turns.get());
            return whole(read_document(log.as_bytes(), StoredLog { faults: &mut faults, limits }), &faults, "");
        }
        Form::Turns => {
            let members: Members<'_> = serde_json::from_str(json).map_err(|error| error.to_string())?;
            members.turns.map(|turns| turns.get().to_owned()).unwrap_or_default()
        }
        Form::Turn => format!("[{}]", turn_of(json)?),
        Form::TurnList => json.to_owned(),
        Form::EventList => format!("[{{\"events\":{json}}}]"),
    };
    // Faults name the place in the JSON as the model wrote it.
    let added = match form {
        Form::Turn => "/0",
        Form::EventList => "/0/events",
        Form::Turns | Form::TurnList | Form::Stored => "",
    };
    if matches!(form, Form::Turns) {
        faults.enter_key("turns");
    }
    let read = read_document(turns.as_bytes(), Turns { faults: &mut faults, limits });
    whole(read, &faults, added)
}

/// Returns whether a JSON object has a member for each turn, such as `turn1` and `turn2`, each a log.
pub(super) fn has_named_turns(json: &str) -> bool {
    let members: BTreeMap<String, &RawValue> = serde_json::from_str(json).unwrap_or_default();
    let is_turn = |(name, value): &(&String, &&RawValue)| {
        name.to_ascii_lowercase().starts_with("turn") && has_form_of_log(value.get())
    };
    members.iter().filter(is_turn).count() > 1
}

/// Returns the JSON of a turn without the members that do not belong to a turn.
fn turn_of(json: &str) -> Result<String, String> {
    #[derive(Deserialize, serde::Serialize)]
    struct Turn<'a> {
        #[serde(borrow, skip_serializing_if = "Option::is_none")]
        events: Option<&'a RawValue>,
        #[serde(borrow, skip_serializing_if = "Option::is_none")]
        palette: Option<&'a RawValue>,
        #[serde(borrow, skip_serializing_if = "Option::is_none")]
        rows: Option<&'a RawValue>,
        #[serde(borrow, skip_serializing_if = "Option::is_none")]
        action_code: Option<&'a RawValue>,
    }
    let turn: Turn<'_> = serde_json::from_str(json).map_err(|error| error.to_string())?;
    serde_json::to_string(&turn).map_err(|error| error.to_string())
}

/// Returns the log, or the first faults; their places begin with `added`, which the model did not write.
fn whole(read: Result<Option<SentLog>, serde_json::Error>, faults: &Faults, added: &str) -> Result<SentLog, String> {
    let as_written = |fault: String| {
        let own = fault.strip_prefix(added).unwrap_or(&fault);
        own.strip_prefix(": ").unwrap_or(own).to_owned()
    };
    match read.map_err(|error| error.to_string())? {
        Some(log) if faults.is_empty() => Ok(log),
        _ => {
            let mut told: Vec<String> =
                faults.list().iter().take(TOLD).map(|fault| as_written(fault.to_string())).collect();
            if let Some(more) = faults.list().len().checked_sub(TOLD).filter(|more| *more > 0) {
                told.push(format!("and {}", counted(more, "further fault")));
            }
            Err(if told.is_empty() { "the log has faults".to_owned() } else { told.join("; ") })
        }
    }
}

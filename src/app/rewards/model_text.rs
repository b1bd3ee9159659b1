//! Search for the log of a task in the texts of a model: one answer for all turns, or one for each turn.

use serde::Serialize;

use crate::app::limits::LIMITS;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::text::thinking::{thoughts_removed, without_thoughts};
use plumbline_engine::intake::text::{AnswerKind, FoundAnswer, NO_LOG, cut_off_json, is_other_json, read_answer};
use plumbline_engine::text::{counted, line_of};
use plumbline_engine::voxel::{BlockLog, Profile};

/// Answers found in the texts of a model.
#[derive(Debug, Clone, Default, Serialize, utoipa::ToSchema)]
pub struct AnswerBody {
    /// Location of each answer that was used.
    pub found: Vec<FoundBody>,
    /// Turns that are empty: as many texts as turns give one turn each, also one without an answer that can be used, and
    /// a model that stops early leaves the last turns empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub empty_turns: Vec<EmptyTurnBody>,
    /// Reason why nothing could be graded; then the reward is 0, and the model is responsible for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "there is neither a block log as JSON nor action code in the answer")]
    pub why: Option<String>,
}

/// Turn that a model leaves empty.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct EmptyTurnBody {
    /// Number of the turn, from 1, which is that of its text if there is one for each turn.
    pub text: usize,
    /// Reason why it has no answer that can be used.
    pub why: String,
}

/// Location and kind of an answer in the texts of a model.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct FoundBody {
    /// Number of the text, from 1.
    pub text: usize,
    /// Line of that text in which the answer begins, from 1.
    pub line: usize,
    /// Kind of the answer.
    pub kind: FoundKind,
    /// Number of earlier answers in the same text, which do not count.
    pub passed_over: usize,
    /// Line of that text on which JSON begins, after the answer, that the end of the text cuts off, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut_off: Option<usize>,
    /// What of the text was not read because a thought begins there that never ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "the answer ends inside a thinking tag that is never closed: <think> in line 2")]
    pub left_out: Option<String>,
}

/// Kind of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FoundKind {
    /// A block log as JSON.
    Log,
    /// Action code.
    ActionCode,
}

/// Finds the log of a task with this number of turns in texts, and where it was found.
///
/// For a task of one turn the last answer counts. For a task of several turns, as many texts as turns give one turn each,
/// and one without an answer leaves its turn empty; of more texts the last answers give one turn each. Fewer answers than
/// turns give the first turns, and leave the others empty. Or the last answer gives all turns. Texts without an answer are
/// otherwise ignored.
///
/// # Errors
/// Returns the reason if there is no such log.
pub fn log_in_texts(texts: &[String], turns: usize, profile: Profile) -> Result<(SentLog, AnswerBody), String> {
    let read: Vec<(usize, Result<FoundAnswer, String>)> =
        (1..).zip(texts).map(|(place, text)| (place, read_as(profile, text))).collect();
    let answers = read.iter().filter_map(|(place, read)| read.as_ref().ok().map(|found| (*place, found)));
    let mut found: Vec<(usize, &FoundAnswer)> = answers.collect();
    // What a model says of the skills that it used does not displace code.
    if texts.len() > turns {
        let known: Vec<_> = found.iter().copied().filter(|(place, _)| !is_remark(profile, &texts[place - 1])).collect();
        if known.len() >= turns {
            found = known;
        }
    }
    let Some(&(_, last)) = found.last() else {
        let why = read.iter().rev().find_map(|(_, read)| read.as_ref().err());
        return Err(why.cloned().unwrap_or_else(|| "the model wrote nothing".to_owned()));
    };
    let of_last = last.sent.log.turns.len();
    let are_turns = found.iter().all(|(_, answer)| answer.sent.log.turns.len() == 1);
    if turns > 1 && texts.len() == turns && are_turns {
        // Each text belongs to a turn, which one without an answer leaves empty.
        return one_for_each(&read);
    }
    if of_last == turns {
        found.drain(..found.len() - 1);
    } else if of_last != 1 {
        return Err(format!("the answer has {}; the task has {turns}", counted(of_last, "turn")));
    } else if found.len() >= turns {
        found.drain(..found.len() - turns);
    }
    let begun = if of_last == turns { turns } else { found.len() };
    refuse_files(&found)?;
    let mut sent = SentLog::default();
    for (place, answer) in &found {
        let has = answer.sent.log.turns.len();
        if found.len() > 1 && has != 1 {
            return Err(format!("text {place} has {}; each text answers one", counted(has, "turn")));
        }
        sent.append(&answer.sent);
    }
    let found = found.into_iter().map(|(place, answer)| FoundBody::of(place, answer)).collect();
    let mut answer = AnswerBody { found, ..AnswerBody::default() };
    for turn in begun + 1..=turns {
        leave_empty(&mut sent, &mut answer, turn, "the model stopped before this turn");
    }
    Ok((sent, answer))
}

/// Adds an empty turn.
fn leave_empty(sent: &mut SentLog, answer: &mut AnswerBody, turn: usize, why: &str) {
    sent.append(&BlockLog { turns: vec![Vec::new()], ..BlockLog::default() }.into());
    answer.empty_turns.push(EmptyTurnBody { text: turn, why: why.to_owned() });
}

/// Puts the answers of texts together, each as the turn of its text; a text without one leaves its turn empty.
fn one_for_each(read: &[(usize, Result<FoundAnswer, String>)]) -> Result<(SentLog, AnswerBody), String> {
    let (mut sent, mut answer) = (SentLog::default(), AnswerBody::default());
    for (place, read) in read {
        match read {
            Ok(found) => {
                refuse_files(&[(*place, found)])?;
                sent.append(&found.sent);
                answer.found.push(FoundBody::of(*place, found));
            }
            Err(why) => leave_empty(&mut sent, &mut answer, *place, why),
        }
    }
    Ok((sent, answer))
}

/// Refuses structure files: they would let the model choose that its order is not checked.
fn refuse_files(found: &[(usize, &FoundAnswer)]) -> Result<(), String> {
    if found.iter().any(|(_, answer)| !answer.sent.structures.is_empty()) {
        return Err("a model's answer takes no structure files; expected events, rows or action code".to_owned());
    }
    Ok(())
}

/// Beginnings of the functions that action code calls.
const CALLS: [&str; 3] = ["skills.", "bot.", "world."];

/// Reads a text. Under the profile `mindcraft`, code is found as mindcraft finds it, which is between the first fence
/// and the last, so the whole text is kept, but for what the model only thought.
fn read_as(profile: Profile, text: &str) -> Result<FoundAnswer, String> {
    let read = read_answer(text, LIMITS.log());
    if profile.is_published() {
        return read;
    }
    let is_code = if let Ok(found) = &read {
        // What mindcraft runs stands between the fences; JSON before or after them is said beside the code.
        found.kind == AnswerKind::Code || is_beside_code(text, found.line)
    } else {
        // What a model only thought is no answer.
        let (shown, ends_in_thought) = without_thoughts(text);
        !ends_in_thought && CALLS.iter().any(|name| shown.contains(name))
    };
    if !is_code {
        return read;
    }
    // Text that calls skills within JSON; an answer that was found is known to be more than that.
    if read.is_err() {
        if is_other_json(text) {
            return Err(NO_LOG.to_owned());
        }
        if let Some(why) = cut_off_json(text) {
            return Err(why);
        }
    }
    let code = thoughts_removed(text);
    let line = code.find("```").map_or(1, |at| line_of(&code, at));
    let sent = SentLog::of_code(code);
    // What is left out is told with the code's own notes.
    Ok(FoundAnswer { sent, kind: AnswerKind::Code, line, passed_over: 0, cut_off: None, left_out: None })
}

/// Returns whether a text is taken for code under the profile `mindcraft` only because it names a function that code calls:
/// it has neither a fence nor a line that is code by itself.
fn is_remark(profile: Profile, text: &str) -> bool {
    !profile.is_published() && !without_thoughts(text).0.contains(FENCE) && read_answer(text, LIMITS.log()).is_err()
}

/// Returns whether a line of a text lies outside its fences, and what the fences enclose is action code.
fn is_beside_code(text: &str, line: usize) -> bool {
    let (shown, _) = without_thoughts(text);
    let (Some(first), Some(last)) = (shown.find(FENCE), shown.rfind(FENCE)) else { return false };
    let is_outside = line < line_of(&shown, first) || line > line_of(&shown, last);
    let fenced = &shown[first..last + FENCE.len()];
    is_outside && read_answer(fenced, LIMITS.log()).is_ok_and(|found| found.kind == AnswerKind::Code)
}

/// Marks around code.
const FENCE: &str = "```";

impl FoundBody {
    fn of(text: usize, answer: &FoundAnswer) -> Self {
        let kind = match answer.kind {
            AnswerKind::Log => FoundKind::Log,
            AnswerKind::Code => FoundKind::ActionCode,
        };
        let FoundAnswer { line, passed_over, cut_off, .. } = *answer;
        Self { text, line, kind, passed_over, cut_off, left_out: answer.left_out.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(texts: &[&str], turns: usize) -> Result<Vec<usize>, String> {
        let texts: Vec<String> = texts.iter().map(|text| (*text).to_owned()).collect();
        log_in_texts(&texts, turns, Profile::Published).map(|(sent, found)| {
            assert_eq!(sent.log.turns.len(), turns);
            found.found.iter().map(|found| found.text).collect()
        })
    }

    #[test]
    fn texts_give_turns() {
        let (one, both) = (r#"{"events": []}"#, r#"{"turns": [{"events": []}, {"events": []}]}"#);
        assert_eq!(found(&[one], 1), Ok(vec![1]));
        assert_eq!(found(&["hm", one, "done"], 1), Ok(vec![2]), "the last that has one");
        assert_eq!(found(&[one, "and", one], 2), Ok(vec![1, 3]));
        assert_eq!(found(&[one, one, one], 2), Ok(vec![2, 3]));
        assert_eq!(found(&[one, both], 2), Ok(vec![2]));
        assert_eq!(found(&[one, "I am sorry"], 2), Ok(vec![1]), "the second turn is empty");
        assert_eq!(found(&["I am sorry", one], 2), Ok(vec![2]));
        assert_eq!(found(&[one], 2), Ok(vec![1]), "the second turn is empty");
        assert_eq!(found(&[one, one], 3), Ok(vec![1, 2]));
        assert_eq!(found(&[both], 3), Err("the answer has 2 turns; the task has 3".to_owned()));
        assert_eq!(found(&["", "no", one, ""], 2), Ok(vec![3]));
        assert_eq!(found(&[both, one], 3), Err("text 1 has 2 turns; each text answers one".to_owned()));
        assert_eq!(found(&[both, one], 2), Err("text 1 has 2 turns; each text answers one".to_owned()));
        assert!(found(&["no"], 1).is_err());
    }

    #[test]
    fn json_beside_the_fences_of_mindcraft_does_not_displace_their_code() {
        let wall = "Here:\n```js\nawait skills.placeBlock(bot, 'stone', 0, 0, 0);\n```\n";
        let kind = |text: &str| {
            let found = read_as(Profile::Mindcraft, text).unwrap();
            (found.kind, found.line)
        };
        for after in
            [r#"{"events": []}"#, r#"The first event is [{"action":"place","x":0,"y":0,"z":0,"block":"dirt"}]."#]
        {
            assert_eq!(kind(&format!("{wall}{after}")), (AnswerKind::Code, 2), "{after}");
            assert_eq!(kind(&format!("{after}\n{wall}")), (AnswerKind::Code, 3), "{after}");
        }
        let log = r#"{"events": []}"#;
        // What else a model puts between fences is no code.
        for fenced in
            ["text\n1. stand by the bot. 2. Raise a wall.", "python\nbot.place(1)", "\n  the edge of the world."]
        {
            assert_eq!(kind(&format!("Plan:\n```{fenced}\n```\n{log}")).0, AnswerKind::Log, "{fenced}");
        }
        // What a model says of its code at the end does not count; where nothing else is there, it is read as code.
        let texts = |texts: &[&str]| -> Vec<String> { texts.iter().map(|text| (*text).to_owned()).collect() };
        let used = |given: &[&str], turns| {
            let (_, answer) = log_in_texts(&texts(given), turns, Profile::Mindcraft).unwrap();
            answer.found.iter().map(|found| found.text).collect::<Vec<usize>>()
        };
        assert_eq!(used(&[wall, "I used `skills.placeBlock(bot, 'stone', 0, 0, 0)`."], 1), [1]);
        assert_eq!(used(&[wall, wall, "Done! Each block uses skills.placeBlock."], 2), [1, 2]);
        assert_eq!(used(&["I used skills.placeBlock."], 1), [1]);
        // Code within JSON that is cut off is no answer.
        let cut = r#"{"turns": [{"action_code": "await skills.placeBlock(bot, 'stone', 0, 0, 0);"}, {"acti"#;
        assert_eq!(read_as(Profile::Mindcraft, cut).unwrap_err(), "the JSON that begins on line 1 is incomplete");
        // JSON in a fence is an answer of its own, and so is JSON alone.
        assert_eq!(kind(&format!("{wall}Or:\n```json\n{{\"events\": []}}\n```")).0, AnswerKind::Log);
        assert_eq!(kind(r#"{"events": []}"#).0, AnswerKind::Log);
    }
}

//! Reads requests to grade: in one quick pass if they look as trainers' programs write them, otherwise thoroughly, with
//! all their faults.

use super::request::{DEADLINES, GradeRequest, NewGrade, detail_named};
use super::scheme::scheme_named;
use super::task_member::NamedTask;
use crate::app::body::read_body;
use crate::app::limits::LIMITS;
use crate::app::task_ref::{TASK_CHARS, TaskRef};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::quick::Scanner;
use plumbline_engine::voxel::Profile;

/// Reads a request to grade and adds all its faults to `faults`. Returns `None` if it has no task or no work that could
/// be read.
///
/// # Errors
/// Returns an error if the text is not JSON.
pub fn read_request(text: &[u8], faults: &mut Faults) -> Result<Option<GradeRequest>, serde_json::Error> {
    let body = match quick_request(text) {
        Some(body) => Some(body),
        None => read_body::<NewGrade>(text, faults)?,
    };
    Ok(body.and_then(|body| GradeRequest::of(body, faults)))
}

/// Reads a request that has the turns of a log for a task of a suite. Returns `None` for any other request, and for one
/// with a fault; the caller then reads it again thoroughly.
pub fn quick_request(text: &[u8]) -> Option<NewGrade> {
    let mut body = NewGrade {
        task: None,
        suite: None,
        profile: None,
        turns: None,
        log: None,
        answer: None,
        reward: None,
        detail: None,
        deadline_ms: None,
    };
    let mut scanner = Scanner::new(text);
    scanner.object(|scanner, member| {
        match member {
            b"task" if body.task.is_none() => {
                let task = match scanner.integer() {
                    Some(number) => TaskRef::Number(u32::try_from(number).ok()?),
                    None => TaskRef::Id(short(scanner, TASK_CHARS)?),
                };
                body.task = Some(NamedTask::Listed(task));
            }
            b"suite" if body.suite.is_none() => body.suite = Some(short(scanner, LIMITS.suite_chars)?),
            b"profile" if body.profile.is_none() => body.profile = Some(Profile::named(scanner.text()?)?),
            b"turns" if body.turns.is_none() => body.turns = Some(scanner.turns(LIMITS.log())?.into()),
            b"reward" if body.reward.is_none() => body.reward = Some(scheme_named(scanner.text()?)?),
            b"detail" if body.detail.is_none() => body.detail = Some(detail_named(scanner.text()?)?),
            b"deadline_ms" if body.deadline_ms.is_none() => {
                let ms = u64::try_from(scanner.integer()?).ok()?;
                if !DEADLINES.contains(&ms) {
                    return None;
                }
                body.deadline_ms = Some(ms);
            }
            _ => return None,
        }
        Some(())
    })?;
    (scanner.is_at_end() && body.task.is_some() && body.turns.is_some()).then_some(body)
}

/// Reads a text of 1 to `most` bytes.
fn short(scanner: &mut Scanner<'_>, most: usize) -> Option<String> {
    scanner.text().filter(|text| (1..=most).contains(&text.len())).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Describes what was read. A log is described by its canonical form.
    fn described(body: &NewGrade) -> String {
        let NewGrade { task, suite, profile, turns, log, answer, reward, detail, deadline_ms } = body;
        let turns = turns.as_ref().map(|sent| String::from_utf8(sent.log.canonical_json()));
        format!("{task:?} {suite:?} {profile:?} {turns:?} {log:?} {answer:?} {reward:?} {detail:?} {deadline_ms:?}")
    }

    #[test]
    fn a_plain_request_is_read_as_with_care() {
        let turns = r#""turns":[{"palette":["stone"],"rows":[[0,-1,2,0]]}]"#;
        for members in [
            format!(r#""task":"walls/5x1x5-raise",{turns}"#),
            format!(r#" "task" : "x","suite":"mineceraft@2","profile":"mindcraft",{turns} "#),
            format!(r#"{turns},"reward":"shaped","detail":"report","deadline_ms":100,"task":"x""#),
            format!(r#""task":"x","reward":"mean","detail":"scores",{turns}"#),
            format!(r#""task": 532 ,{turns}"#),
        ] {
            let text = format!("\n{{{members}}}\n");
            let quick = quick_request(text.as_bytes()).unwrap_or_else(|| panic!("{text}"));
            let mut faults = Faults::new();
            let with_care: NewGrade = read_body(text.as_bytes(), &mut faults).unwrap().unwrap();
            assert!(faults.is_empty(), "{:?}", faults.list());
            assert_eq!(described(&quick), described(&with_care));
        }
    }

    #[test]
    fn what_is_unusual_or_faulty_is_left_to_care() {
        let turns = r#""turns":[{"palette":["stone"],"rows":[[0,-1,2,0]]}]"#;
        let long = "a".repeat(TASK_CHARS + 1);
        for members in [
            r#""task":"x""#.to_owned(),
            turns.to_owned(),
            format!(r#""task":-1,{turns}"#),
            format!(r#""task":1.0,{turns}"#),
            format!(r#""task":-"x",{turns}"#),
            format!(r#""task":- "x",{turns}"#),
            format!(r#""task":00"x",{turns}"#),
            format!(r#""task":-01"x",{turns}"#),
            format!("\"task\":\"5\n,{turns}"),
            format!(r#""task":null,{turns}"#),
            format!(r#""task":"",{turns}"#),
            format!(r#""task":"{long}",{turns}"#),
            format!(r#""task":"\u0061",{turns}"#),
            format!(r#""task":"x","task":"x",{turns}"#),
            format!(r#""task":"x",{turns},{turns}"#),
            format!(r#""task":"x","suite":null,{turns}"#),
            format!(r#""task":"x","reward":"weighted",{turns}"#),
            format!(r#""task":"x","reward":{{"weights":{{"size":1}}}},{turns}"#),
            format!(r#""task":"x","detail":"all",{turns}"#),
            format!(r#""task":"x","deadline_ms":0,{turns}"#),
            format!(r#""task":"x","deadline_ms":999999999,{turns}"#),
            format!(r#""task":"x","answer":"y",{turns}"#),
            format!(r#""task":"x",{turns}}},{{"#),
        ] {
            assert!(quick_request(format!("{{{members}}}").as_bytes()).is_none(), "{members}");
        }
    }
}

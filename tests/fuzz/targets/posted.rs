//! Bodies of `/v1/submissions`, JSON or NDJSON: a line is read as the same submission that it is as a body of its own.

use plumbline::app::submissions::posted::{Format, PostedSubmission, read_submissions};
use plumbline_engine::intake::Faults;

/// Greatest number of lines that are read again by themselves.
const MAX: usize = 20;

pub fn run(data: &[u8]) {
    let mut faults = Faults::new();
    let document = read_submissions(data, Format::Json, &mut faults);
    let is_refused = !faults.into_list().is_empty();
    assert!(is_refused || document.submissions.len() == 1, "neither read nor refused");
    assert!(is_refused || !document.is_malformed, "malformed without a fault");
    let mut faults = Faults::new();
    let lines = read_submissions(data, Format::NdJson, &mut faults);
    assert!(!lines.submissions.is_empty() || !faults.into_list().is_empty(), "no line is read, and none refused");
    let mut read = lines.submissions.iter();
    let all: Vec<&[u8]> = data.split(|byte| *byte == b'\n').collect();
    for (number, line) in (1..).zip(all.iter().take(MAX)) {
        let alone = read_submissions(line, Format::Json, &mut Faults::new());
        let same = (!alone.submissions.is_empty()).then(|| read.next()).flatten();
        assert_eq!(same.map(told), alone.submissions.first().map(told), "line {number}");
        assert!(same.is_none_or(|one| one.line == Some(number)), "line {number}");
    }
    assert!(all.len() > MAX || read.next().is_none(), "more submissions than lines");
}

fn told(one: &PostedSubmission) -> String {
    let sent = (one.sent.log.canonical_json(), &one.sent.codes, &one.sent.structures);
    format!("{:?}", (&one.run, &one.suite, &one.task, &one.profile, sent))
}

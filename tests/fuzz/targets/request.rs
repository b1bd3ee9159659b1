//! Bodies of `/v1/grade`: what is read in one pass is what is read with care.

use plumbline::app::body::read_body;
use plumbline::app::rewards::reading::{quick_request, read_request};
use plumbline::app::rewards::request::NewGrade;
use plumbline_engine::intake::Faults;

pub fn run(data: &[u8]) {
    let mut faults = Faults::new();
    let read = read_request(data, &mut faults);
    let is_read = matches!(read, Ok(Some(_)));
    assert!(is_read || read.is_err() || !faults.into_list().is_empty(), "it was refused without a reason");
    if let Some(quick) = quick_request(data) {
        let mut faults = Faults::new();
        let with_care = read_body::<NewGrade>(data, &mut faults).expect("what is read in one pass is JSON");
        assert!(faults.is_empty(), "{:?}", faults.list());
        assert_eq!(Some(described(quick)), with_care.map(described));
    }
}

/// Describes what was read. A log is described by its canonical form.
fn described(body: NewGrade) -> String {
    let NewGrade { task, suite, profile, turns, log: None, answer: None, reward, detail, deadline_ms } = body else {
        return "it has a log or an answer".to_owned();
    };
    let turns = turns.map(|sent| String::from_utf8_lossy(&sent.log.canonical_json()).into_owned());
    format!("{task:?} {suite:?} {profile:?} {turns:?} {reward:?} {detail:?} {deadline_ms:?}")
}

//! Texts of models, in which an answer is found.

use plumbline::app::limits::LIMITS;
use plumbline_engine::intake::text::read_answer;

pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(found) = read_answer(text, LIMITS.log()) {
        assert!((1..=text.lines().count().max(1)).contains(&found.line), "line {}", found.line);
    }
}

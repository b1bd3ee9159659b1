//! Query strings.

use plumbline::http::boards::leaderboard::BoardQuery;
use plumbline::http::extract::params::{position, read};

pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Err(error) = read::<BoardQuery>(text) {
        assert!(!format!("{error:?}").is_empty());
    }
    let _ = position("at", text);
}

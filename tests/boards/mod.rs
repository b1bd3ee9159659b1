//! Boards, comparisons and grading again.

mod cards;
mod leaderboards;
mod regrade;
mod repeats;
mod tracks;

//! Boards, comparisons and grading again.

mod cards;
mod leaderboards;
mod publicity;
mod regrade;
mod repeats;
mod tracks;

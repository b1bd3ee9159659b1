//! Boards, comparisons and grading again.

mod leaderboards;
mod regrade;
mod tracks;

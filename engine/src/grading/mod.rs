//! Grading: makes a report from a task and a log, and the summary of a run from its reports.

pub mod advisories;
pub mod advisory;
pub mod baseline;
pub mod cost;
pub mod fingerprints;
pub mod grade;
pub mod outcomes;
pub mod raw_records;
pub mod repeats;
pub mod report;
pub mod reward;
pub mod saboteur_table;
pub mod scores;
pub mod standings;
pub mod statistics;
pub mod summary;

pub use grade::{grade_hashed, grade_log, grade_structures, score_log};
pub use report::Report;
pub use scores::Scores;
pub use summary::{ProblemScores, Summary};

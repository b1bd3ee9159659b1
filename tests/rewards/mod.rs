//! Rewards within the request, and the trainers that ask for them.

mod grade;
mod structures;
mod texts;
mod trainers;

//! Rewards within the request, and the trainers that ask for them.

mod forced;
mod grade;
mod odd_samples;
mod structures;
mod texts;
mod trainers;

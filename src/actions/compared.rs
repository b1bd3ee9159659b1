//! What the profile `published` would have built with the code of a job that ran under `mindcraft`.

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::job::{Answer, Job, TurnInput};
use super::memory::PeakMemory;
use super::sandbox::cpu_ms;
use super::{ActionLimits, Profile, published};
use plumbline_engine::intake::code::without_fences;
use plumbline_engine::text::agreeing;
use plumbline_engine::voxel::replay::Replay;
use plumbline_engine::voxel::{BlockLog, Cell, Structure};

/// Processor time that must be left for the comparison, in milliseconds.
const LEAST_MS: u64 = 100;

/// Adds a note to the first turn with code after which `published` would have left another build. Nothing is told of code
/// that reached a limit under either profile, or that left too little processor time.
pub fn tell_difference(job: &Job, limits: &ActionLimits, answer: &mut Answer) {
    if answer.stopped().is_none() {
        // Whatever goes wrong here, the answer stands.
        let compared = catch_unwind(AssertUnwindSafe(|| difference(job, limits, answer)));
        if let Ok(Some((turn, note))) = compared {
            answer.turns[turn].notes.push(note);
        }
    }
}

/// Returns the index of that turn, and the note.
fn difference(job: &Job, limits: &ActionLimits, answer: &Answer) -> Option<(usize, String)> {
    // The job and the comparison share the processor time.
    let left_ms = || Some(limits.cpu_ms.saturating_sub(cpu_ms())).filter(|left| *left >= LEAST_MS);
    let empty = |profile| BlockLog { turns: vec![Vec::new(); job.turns.len()], profile, ..BlockLog::default() };
    let mut why = String::new();
    let (mut ours, mut theirs) = (empty(Profile::Mindcraft), empty(Profile::Published));
    for (turn, (input, done)) in job.turns.iter().zip(&answer.turns).enumerate() {
        match input {
            TurnInput::Events(events) => {
                for ([x, y, z], name) in events {
                    for log in [&mut ours, &mut theirs] {
                        log.add_event(turn, Cell::new(*x, *y, *z), name.as_deref());
                    }
                }
            }
            TurnInput::Code(files) => {
                add(&mut ours, turn, done);
                for file in files {
                    let limits = ActionLimits { cpu_ms: left_ms()?, ..*limits };
                    let done = published::run(&without_fences(file), &limits, &PeakMemory::unknown());
                    if done.stopped.is_some() {
                        return None;
                    }
                    add(&mut theirs, turn, &done);
                    if let Some(error) = done.error.as_ref().filter(|_| why.is_empty()) {
                        let is_function =
                            without_fences(file).trim_start().trim_start_matches('(').starts_with("async");
                        let hint = if error.message.starts_with("SyntaxError") && file.contains("await") && !is_function
                        {
                            " (published takes a function, such as `async (bot) => { … }`, and no await outside of one)"
                        } else {
                            ""
                        };
                        why = format!("; there the code ends with {}{hint}", error.message);
                    }
                }
            }
        }
    }
    let both = Replay::new(&ours).zip(Replay::new(&theirs));
    for ((turn, input), (ours, theirs)) in job.turns.iter().enumerate().zip(both) {
        left_ms()?;
        let differing = differing(&ours, &theirs);
        if differing > 0 && matches!(input, TurnInput::Code(_)) {
            let cells = agreeing(differing, "cell differs", "cells differ");
            let note = format!("under published another build would stand after this turn: {cells}{why}");
            return Some((turn, note));
        }
    }
    None
}

fn add(log: &mut BlockLog, turn: usize, done: &super::Replayed) {
    for event in &done.events {
        let [x, y, z] = event.cell;
        log.add_event(turn, Cell::new(x, y, z), done.material(event));
    }
}

/// Counts the cells in which two builds do not have the same block.
fn differing(one: &Structure, other: &Structure) -> usize {
    let differs = |(at, cell): (usize, &Cell)| {
        other.index().get(cell).is_none_or(|&there| other.material(there as usize) != one.material(at))
    };
    let lacks = |cell: &&Cell| !one.contains(**cell);
    one.cells().iter().enumerate().filter(|entry| differs(*entry)).count() + other.cells().iter().filter(lacks).count()
}

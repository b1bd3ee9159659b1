//! The world behind action code, and what is told of the run.

use std::cmp::Ordering;
use std::collections::{BTreeMap, HashMap};

use crate::actions::ACTION_LIMITS;
use crate::actions::turn_replay::LOG_CUT;
use plumbline_engine::game::command::{Command, SetMode};
use plumbline_engine::game::coordinates::{Coordinate, Coordinates};
use plumbline_engine::game::{Look, World};
use plumbline_engine::text::did_you_mean;

/// Greatest number of different notes, and of reasons of dropped calls, of a turn.
pub const MAX_NOTES: usize = 50;
/// Virtual time for which timers go on after the code has ended, in milliseconds.
pub const AFTERWARDS_MS: u64 = 60_000;
/// Greatest length of a note or reason, in characters.
pub const NOTE_CHARS: usize = 300;
/// Greatest number of names that are remembered.
const MAX_LOOKS: usize = 2_000;

/// The world of a job, and what its turns tell.
#[derive(Debug, Default)]
pub struct Host {
    /// The world.
    pub world: World,
    /// What the turn has told so far.
    pub told: Told,
    /// Name of the item in the body's hand.
    pub held: Option<String>,
    /// Blocks that were read before.
    looks: HashMap<String, Look>,
    /// Names that were asked for in vain.
    missing_names: HashMap<String, Missing>,
    /// The last of them.
    pub missing: Option<Missing>,
    /// Virtual time at which the main function ended.
    pub done_at_ms: Option<u64>,
}

/// What a turn tells.
#[derive(Debug, Default, Clone)]
pub struct Told {
    /// Notes.
    pub notes: Vec<String>,
    /// Reasons of calls without effect, with their numbers.
    pub dropped: BTreeMap<String, u64>,
    /// What the code printed.
    pub log: Vec<String>,
    log_bytes: usize,
    is_log_cut: bool,
}

/// A name that does not exist.
#[derive(Debug, Clone)]
pub struct Missing {
    /// Object and name, such as `skills.goToPositon`.
    pub path: String,
    /// Suggestion to append.
    pub suggestion: String,
}

impl Host {
    /// Adds a note unless it is there already.
    pub fn note(&mut self, text: &str) {
        let text = shortened(text);
        let notes = &mut self.told.notes;
        match notes.len().cmp(&MAX_NOTES) {
            _ if notes.contains(&text) => {}
            Ordering::Less => notes.push(text),
            Ordering::Equal => notes.push("… more notes are left out".to_owned()),
            Ordering::Greater => {}
        }
    }

    /// Counts a call that had no effect.
    pub fn drop_call(&mut self, reason: &str) {
        let dropped = &mut self.told.dropped;
        let mut reason = shortened(reason);
        if dropped.len() >= MAX_NOTES && !dropped.contains_key(&reason) {
            "other reasons".clone_into(&mut reason);
        }
        *dropped.entry(reason).or_default() += 1;
    }

    /// Adds lines to the log, as long as it has room.
    pub fn print(&mut self, line: &str) {
        let told = &mut self.told;
        for line in line.split('\n') {
            if told.log.len() >= ACTION_LIMITS.log_lines || told.log_bytes + line.len() > ACTION_LIMITS.log_bytes {
                if !std::mem::replace(&mut told.is_log_cut, true) {
                    told.log.push(LOG_CUT.to_owned());
                }
                return;
            }
            told.log_bytes += line.len() + 1;
            told.log.push(line.to_owned());
        }
    }

    /// Sets a block as `/setblock` does.
    pub fn set_block(&mut self, [x, y, z]: [f64; 3], block: &str) {
        if let Some(odd) = [x, y, z].into_iter().find(|value| !value.is_finite() || value.abs() >= 1e21) {
            return self.command(&format!("setblock {odd} {odd} {odd} {block}"));
        }
        let look = match self.looks.get(block) {
            Some(look) => *look,
            None => match Look::read(block) {
                Ok(look) => {
                    if self.looks.len() < MAX_LOOKS {
                        self.looks.insert(block.to_owned(), look);
                    }
                    look
                }
                Err(error) => return self.drop_call(&format!("/setblock was refused: {error}")),
            },
        };
        let axis = |value| Coordinate { value, is_relative: false, is_whole: true };
        let command = Command::SetBlock { at: Coordinates::World([x, y, z].map(axis)), look, mode: SetMode::Replace };
        let body = self.world.body;
        if let Err(refusal) = self.world.carry_out(&command, &body) {
            self.drop_call(&format!("/setblock was refused: {refusal}"));
        }
    }

    /// Carries out a command and counts it if it is refused.
    pub fn command(&mut self, text: &str) {
        if let Err(refusal) = self.world.command(text) {
            let name: String = text.split(' ').next().unwrap_or_default().chars().take(20).collect();
            let refusal: String = refusal.to_string().chars().take(200).collect();
            self.drop_call(&format!("/{name} was refused: {refusal}"));
        }
    }

    /// Tells that an object has no such name. `known` are the names that it has.
    pub fn missing(&mut self, object: &str, name: &str, known: &str) {
        let path = format!("{object}.{}", name.chars().take(80).collect::<String>());
        if let Some(missing) = self.missing_names.get(&path) {
            self.missing = Some(missing.clone());
            return;
        }
        let suggestion = did_you_mean(name, known.split(','));
        let verb = if object == "bot" { "is not simulated" } else { "does not exist" };
        self.note(&format!("{path} {verb}{suggestion}"));
        let missing = Missing { path: path.clone(), suggestion };
        if self.missing_names.len() < MAX_LOOKS {
            self.missing_names.insert(path, missing.clone());
        }
        self.missing = Some(missing);
    }

    /// Lets virtual time pass. Returns false if timers go on too long after the code has ended.
    ///
    /// # Errors
    /// Returns an error if the job has used up its time.
    pub fn pass_time(&mut self, now_ms: f64) -> Result<bool, String> {
        let now = now_ms.max(0.0) as u64;
        if now > ACTION_LIMITS.virtual_ms {
            return Err(format!(
                "more than {} hours of virtual time have passed",
                ACTION_LIMITS.virtual_ms / 3_600_000
            ));
        }
        if self.done_at_ms.is_some_and(|done| now > done + AFTERWARDS_MS) {
            self.note("timers that were left a minute after the code had ended were stopped");
            return Ok(false);
        }
        self.world.pass_time(now);
        Ok(true)
    }
}

fn shortened(text: &str) -> String {
    text.chars().take(NOTE_CHARS).collect()
}

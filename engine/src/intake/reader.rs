//! The state while one log is read: what it has so far, and its limits.

use super::LogLimits;
use super::code::{TurnCode, TurnStructure};
use super::faults::Faults;
use crate::voxel::palette::{MaterialId, Palette};

/// The state while one log is read.
pub(super) struct Reader<'f> {
    pub(super) faults: &'f mut Faults,
    pub(super) limits: LogLimits,
    pub(super) codes: Vec<TurnCode>,
    pub(super) structures: Vec<TurnStructure>,
    pub(super) palette: Palette,
    pub(super) events: usize,
}

impl<'f> Reader<'f> {
    pub(super) fn new(faults: &'f mut Faults, limits: LogLimits) -> Self {
        Self { faults, limits, codes: Vec::new(), structures: Vec::new(), palette: Palette::new(), events: 0 }
    }

    /// Returns how many more events the log may have.
    pub(super) fn events_left(&self) -> usize {
        self.limits.max_events.saturating_sub(self.events)
    }

    /// Counts an event. Returns false if the event exceeds the limit and need not be kept.
    pub(super) fn count_event(&mut self) -> bool {
        self.events += 1;
        self.events <= self.limits.max_events
    }

    /// Records why reading ended within a value: it is valid JSON that cannot be read, such as the number 1e999. Its place
    /// in the document is known better than in the text, and reading goes on after the value, at this depth.
    pub(super) fn cut_short<T>(&mut self, depth: usize, error: &serde_json::Error) -> Option<T> {
        let text = error.to_string();
        self.faults.add(text.split(" at line ").next().unwrap_or(&text));
        self.faults.leave_to(depth);
        None
    }

    pub(super) fn check_totals(&mut self) {
        if self.events > self.limits.max_events {
            self.faults.add(format!("{} events; at most {} are allowed", self.events, self.limits.max_events));
        }
        if self.palette.len() > self.limits.max_materials {
            let (found, max) = (self.palette.len(), self.limits.max_materials);
            self.faults.add(format!("{found} different materials; at most {max} are allowed"));
        }
    }

    /// Returns the id of `name`; a new name gets 0 once the palette exceeds its limit, so that a faulty log cannot grow it
    /// further.
    pub(super) fn intern(&mut self, name: &str) -> MaterialId {
        let is_full = self.palette.len() > self.limits.max_materials;
        if is_full { self.palette.get(name).unwrap_or(0) } else { self.palette.intern(name) }
    }
}

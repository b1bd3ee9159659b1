//! Members of a body that hold the log: `turns`, or `log` in the stored form.

use crate::app::limits::LIMITS;
use plumbline_engine::intake::stored::StoredLog;
use plumbline_engine::intake::{Faults, Turns};

/// Returns the shape of `turns`.
pub const fn turns(faults: &mut Faults) -> Turns<'_> {
    Turns { faults, limits: LIMITS.log() }
}

/// Returns the shape of `log`.
pub const fn stored_log(faults: &mut Faults) -> StoredLog<'_> {
    StoredLog { faults, limits: LIMITS.log() }
}

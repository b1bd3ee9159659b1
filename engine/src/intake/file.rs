//! The members of a turn that is a structure file.

use serde::de::{IgnoredAny, SeqAccess};

use super::faults::Faults;
use super::tolerant::{Integer, Read, Shape};

/// The shape of a position: three integers.
pub(super) struct CornerShape<'f> {
    pub(super) faults: &'f mut Faults,
}

impl<'de> Shape<'de> for CornerShape<'_> {
    type Out = [i32; 3];

    fn wanted(&self) -> &'static str {
        "a position [x, y, z]"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn array<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Option<[i32; 3]>, A::Error> {
        let faults = self.faults;
        let mut parts = Vec::new();
        for index in 0..3 {
            faults.enter_index(index);
            let shape = Integer { faults, min: i32::MIN.into(), max: i32::MAX.into() };
            let part = elements.next_element_seed(Read(shape))?;
            faults.leave();
            parts.extend(part);
        }
        let mut more = 0;
        while elements.next_element::<IgnoredAny>()?.is_some() {
            more += 1;
        }
        if parts.len() + more != 3 {
            faults.add(format!("expected 3 integers, found {}", parts.len() + more));
            return Ok(None);
        }
        let parts: Option<Vec<i64>> = parts.into_iter().collect();
        Ok(parts.map(|parts| [0, 1, 2].map(|axis| parts[axis] as i32)))
    }
}

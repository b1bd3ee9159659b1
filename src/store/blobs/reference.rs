//! References to objects, as columns hold them in place of the bytes.

use object_store::path::Path;
use sha2::{Digest as _, Sha256};

use crate::clock::rfc3339;
use plumbline_engine::tasks::hex;

/// What every reference begins with. Packed bytes begin with the magic number of zstd, which differs.
pub(super) const BEGINNING: &str = "object:";
/// Number of characters of a date, such as `2026-11-24`.
const DATE_CHARS: usize = 10;
/// Columns that may hold references: table and column. An object that none of them refers to is deleted. Each has an
/// index of its references.
pub(super) const COLUMNS: [(&str, &str); 3] = [("submissions", "log"), ("reports", "body"), ("regraded", "body")];
/// [`BYTES`] as statements write it: the indexes of references have it as a condition.
pub(super) const LENGTH: &str = "82";
/// Number of bytes of a reference.
const BYTES: usize = BEGINNING.len() + DATE_CHARS + 1 + 64;

/// Reference to an object: the day on which it was written, and the SHA-256 of its bytes.
///
/// The day is a part of the name so that an object of a day that is over is never written again. So an object that no
/// row refers to two days later is an orphan for ever, and can be deleted while others write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Reference {
    /// Name of the object: `2026-11-24/` and 64 hexadecimal digits.
    name: String,
}

impl Reference {
    /// Returns the reference to these bytes, if they are written now.
    pub fn of(bytes: &[u8], now_ms: i64) -> Self {
        let now = rfc3339(now_ms);
        Self { name: format!("{}/{}", &now[..DATE_CHARS], hex(&Sha256::digest(bytes))) }
    }

    /// Reads a column; none if it holds the bytes themselves.
    pub fn read(column: &[u8]) -> Option<Self> {
        let name = column.strip_prefix(BEGINNING.as_bytes()).filter(|_| column.len() == BYTES)?;
        Some(Self { name: std::str::from_utf8(name).ok()?.to_owned() })
    }

    /// Returns the reference to the object at a path; none if it is not named as such.
    pub fn at(path: &Path) -> Option<Self> {
        let reference = Self { name: path.as_ref().to_owned() };
        (reference.name.is_ascii() && reference.to_column().len() == BYTES).then_some(reference)
    }

    /// Returns what the column holds.
    pub fn to_column(&self) -> Vec<u8> {
        format!("{BEGINNING}{}", self.name).into_bytes()
    }

    /// Returns the path of the object in its place.
    pub fn path(&self) -> Path {
        Path::from(self.name.as_str())
    }

    /// Returns whether these are the bytes that it refers to.
    pub fn is_of(&self, bytes: &[u8]) -> bool {
        self.name.ends_with(&hex(&Sha256::digest(bytes)))
    }

    /// Returns the day on which the object was written.
    pub fn day(&self) -> &str {
        &self.name[..DATE_CHARS]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::day_ms;

    #[test]
    fn a_reference_is_read_as_it_was_written_and_packed_bytes_are_none() {
        let packed = zstd::bulk::compress(&[7; 5_000], 3).unwrap();
        let reference = Reference::of(&packed, day_ms("2026-11-24").unwrap() + 1);
        let column = reference.to_column();
        assert_eq!((column.len(), LENGTH), (BYTES, BYTES.to_string().as_str()));
        assert!(column.starts_with(b"object:2026-11-24/"));
        assert_eq!(Reference::read(&column), Some(reference.clone()));
        assert_eq!(Reference::at(&reference.path()), Some(reference.clone()));
        assert!(reference.is_of(&packed) && !reference.is_of(&column));
        assert_eq!(reference.day(), "2026-11-24");
        assert_eq!(Reference::read(&packed), None);
        assert_eq!(Reference::at(&Path::from("plumbline.id")), None);
    }
}

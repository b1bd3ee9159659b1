//! Tiles of a log and their names (C2SP tlog-tiles): 256 hashes of one level, or the entries below them.

use std::fmt;

use super::tree::Tree;
use crate::hidden::canonical::Hash;

/// Number of hashes in a full tile.
pub const TILE: usize = 256;
/// Number of levels of the tree in a tile.
const LEVELS: usize = 8;
/// Greatest level of tiles.
const MAX_LEVEL: u8 = 63;
/// Length of an entry, as tiles tell it before each.
const HASH_BYTES: u16 = 32;
/// Numbers of tiles are written in groups of three digits.
const GROUP: u64 = 1_000;
/// Greatest number of groups of digits in the name of a tile.
const MAX_GROUPS: usize = 7;

/// Name of a tile, the path after `tile/`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileName {
    /// Level of the hashes, in tiles; none for the entries.
    pub level: Option<u8>,
    /// Number of the tile on its level, from 0.
    pub index: u64,
    /// Number of hashes or entries in the tile.
    pub width: usize,
}

impl TileName {
    /// Reads a name, such as `0/x001/234` or `entries/000.p/17`; `None` if the text is not a valid name.
    #[must_use]
    pub fn parse(path: &str) -> Option<Self> {
        let (level, rest) = path.split_once('/')?;
        let level = match level {
            "entries" => None,
            digits => Some(number(digits).filter(|level| *level <= u64::from(MAX_LEVEL))? as u8),
        };
        let (index, width) = match rest.split_once(".p/") {
            None => (rest, TILE),
            Some((index, width)) => {
                let width = number(width).filter(|width| (1..TILE as u64).contains(width))?;
                (index, width as usize)
            }
        };
        let groups: Vec<&str> = index.split('/').collect();
        if groups.len() > MAX_GROUPS {
            return None;
        }
        let last = groups.len() - 1;
        let mut value = 0_u64;
        for (i, group) in groups.into_iter().enumerate() {
            let digits = if i == last { group } else { group.strip_prefix('x')? };
            let is_group = digits.len() == 3 && digits.bytes().all(|byte| byte.is_ascii_digit());
            // The shortest name is the only one.
            if !is_group || (i == 0 && last > 0 && digits == "000") {
                return None;
            }
            value = value.checked_mul(GROUP)?.checked_add(digits.parse().ok()?)?;
        }
        Some(Self { level, index: value, width })
    }

    /// Returns the hashes of the tile as bytes; `None` if the log has fewer, or for a tile of entries.
    #[must_use]
    pub fn hashes(&self, tree: &Tree) -> Option<Vec<u8>> {
        let level = usize::from(self.level?) * LEVELS;
        let row = tree.row(level, self.index.checked_mul(TILE as u64)?, self.width)?;
        Some(row.concat())
    }

    /// Returns the entries of the tile, each after its length in two bytes; `None` if the log has fewer, or for a
    /// tile of hashes.
    #[must_use]
    pub fn entries(&self, entries: &[Hash]) -> Option<Vec<u8>> {
        if self.level.is_some() {
            return None;
        }
        let from = usize::try_from(self.index).ok()?.checked_mul(TILE)?;
        let own = entries.get(from..from.checked_add(self.width)?)?;
        Some(own.iter().flat_map(|entry| [&HASH_BYTES.to_be_bytes()[..], &entry[..]].concat()).collect())
    }
}

impl fmt::Display for TileName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.level {
            Some(level) => write!(f, "{level}")?,
            None => write!(f, "entries")?,
        }
        let mut groups = vec![self.index % GROUP];
        let mut rest = self.index / GROUP;
        while rest > 0 {
            groups.push(rest % GROUP);
            rest /= GROUP;
        }
        for (i, group) in groups.iter().enumerate().rev() {
            write!(f, "/{}{group:03}", if i > 0 { "x" } else { "" })?;
        }
        if self.width < TILE { write!(f, ".p/{}", self.width) } else { Ok(()) }
    }
}

/// Reads the entries of a tile; `None` unless it holds exactly `width` hashes, each after its length.
#[must_use]
pub fn read_entries(tile: &[u8], width: usize) -> Option<Vec<Hash>> {
    let entry = |chunk: &[u8]| {
        let (length, hash) = chunk.split_at_checked(size_of_val(&HASH_BYTES))?;
        (length == HASH_BYTES.to_be_bytes()).then_some(())?;
        hash.try_into().ok()
    };
    let entries: Vec<Hash> =
        tile.chunks(size_of_val(&HASH_BYTES) + size_of::<Hash>()).map(entry).collect::<Option<_>>()?;
    (entries.len() == width).then_some(entries)
}

/// Reads a number without sign and leading zeros.
fn number(digits: &str) -> Option<u64> {
    let is_plain = digits.bytes().all(|byte| byte.is_ascii_digit()) && (digits == "0" || !digits.starts_with('0'));
    digits.parse().ok().filter(|_| is_plain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::tlog::tree::leaf;

    #[test]
    fn names_are_read_as_the_specification_writes_them() {
        let name = |level, index, width| Some(TileName { level, index, width });
        assert_eq!(TileName::parse("0/000"), name(Some(0), 0, 256));
        assert_eq!(TileName::parse("3/x001/x234/067"), name(Some(3), 1_234_067, 256));
        assert_eq!(TileName::parse("entries/x123/456.p/7"), name(None, 123_456, 7));
        for same in ["0/000", "3/x001/x234/067", "entries/x123/456.p/7", "63/999.p/255", "entries/x001/000"] {
            assert_eq!(TileName::parse(same).unwrap().to_string(), same);
        }
        for wrong in [
            "",
            "0",
            "0/",
            "64/000",
            "00/000",
            "-1/000",
            "0/00",
            "0/0000",
            "0/x001",
            "0/x000/001",
            "0/001/002",
            "0/000.p/0",
            "0/000.p/256",
            "0/000.p/07",
            "0/000.p/",
            "data/000",
            "0/+01",
            "0/x001/x001/x001/x001/x001/x001/x001/001",
        ] {
            assert_eq!(TileName::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn tiles_hold_what_the_tree_has() {
        let entries: Vec<Hash> = (0..600_u32).map(|i| leaf(&i.to_be_bytes())).collect();
        let mut tree = Tree::default();
        for entry in &entries {
            tree.push(leaf(entry));
        }
        let hashes = |path: &str| TileName::parse(path).unwrap().hashes(&tree);
        assert_eq!(hashes("0/001").unwrap()[..32], leaf(&entries[256]));
        assert_eq!(hashes("0/002"), None, "the third is not full");
        assert_eq!(hashes("0/002.p/88").unwrap().len(), 88 * 32);
        assert_eq!(hashes("0/002.p/89"), None);
        assert_eq!(hashes("1/000.p/2").unwrap()[..32], tree.root(256).unwrap());
        assert_eq!(hashes("1/000.p/3"), None);
        assert_eq!(hashes("9/000.p/1"), None);
        let told = TileName::parse("entries/002.p/3").unwrap().entries(&entries).unwrap();
        assert_eq!((told.len(), &told[..2], &told[2..34]), (3 * 34, &[0, 32][..], &entries[512][..]));
        assert_eq!(read_entries(&told, 3).unwrap(), entries[512..515]);
        assert_eq!(read_entries(&told, 2), None);
        assert_eq!(read_entries(&told[..told.len() - 1], 3), None);
        assert_eq!(read_entries(&[&[0, 31], &told[2..]].concat(), 3), None);
    }
}

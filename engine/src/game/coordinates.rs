//! Coordinates in commands: absolute (`5`), relative to the body (`~`, `~-1`), and relative to where it looks (`^1`).

use super::refusal::Refusal;
use super::side::Side;
use crate::voxel::cell::{Cell, MAX_HORIZONTAL};

/// Least height of a block.
pub const MIN_Y: i32 = -64;
/// Greatest height of a block.
pub const MAX_Y: i32 = 319;

/// Where a command is carried out: a position, and the direction of view in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Position, in blocks.
    pub position: [f64; 3],
    /// Direction around the vertical axis: 0 is south, 90 is west.
    pub yaw: f64,
    /// Direction up and down: 90 is straight down.
    pub pitch: f64,
    /// Height above the position from which coordinates with `^` count, in blocks: 0 at the feet.
    pub anchor: f64,
}

impl Default for Place {
    fn default() -> Self {
        Self { position: [0.0; 3], yaw: 0.0, pitch: 0.0, anchor: 0.0 }
    }
}

impl Place {
    /// Returns the direction in degrees, yaw and pitch, from the anchor to a position.
    #[must_use]
    pub fn towards(&self, target: [f64; 3]) -> [f64; 2] {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| target[axis] - self.position[axis]);
        let y = y - self.anchor;
        [z.atan2(x).to_degrees() - 90.0, -y.atan2(x.hypot(z)).to_degrees()]
    }

    /// Returns the horizontal side to which the view is nearest.
    #[must_use]
    pub fn facing(&self) -> Side {
        match ((self.yaw / 90.0 + 0.5).floor() as i64).rem_euclid(4) {
            0 => Side::South,
            1 => Side::West,
            2 => Side::North,
            _ => Side::East,
        }
    }
}

/// Three coordinates as they were written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Coordinates {
    /// Along the axes of the world.
    World([Coordinate; 3]),
    /// Left, up and forwards from where the body looks.
    Local([f64; 3]),
}

/// One coordinate along an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coordinate {
    /// The number.
    pub value: f64,
    /// Whether it is added to the body's position.
    pub is_relative: bool,
    /// Whether it was written without a decimal point.
    pub is_whole: bool,
}

impl Coordinates {
    /// Reads three words.
    ///
    /// # Errors
    /// Returns a refusal if a word is no coordinate, or if `^` and other forms are mixed.
    pub fn read(words: [&str; 3]) -> Result<Self, Refusal> {
        let is_local = words.map(|word| word.starts_with('^'));
        if is_local == [true; 3] {
            let mut local = [0.0; 3];
            for (word, into) in words.iter().zip(&mut local) {
                *into = number(&word[1..])?;
            }
            return Ok(Self::Local(local));
        }
        if is_local != [false; 3] {
            return Err(Refusal::new("cannot mix world and local coordinates (everything must either use ^ or not)"));
        }
        let mut world = [Coordinate { value: 0.0, is_relative: false, is_whole: true }; 3];
        for (word, into) in words.iter().zip(&mut world) {
            let (digits, is_relative) = word.strip_prefix('~').map_or((*word, false), |rest| (rest, true));
            *into = Coordinate { value: number(digits)?, is_relative, is_whole: !digits.contains('.') };
        }
        Ok(Self::World(world))
    }

    /// Returns the cell that the coordinates mean for a block.
    ///
    /// # Errors
    /// Returns a refusal if an absolute coordinate has a decimal point, or if the cell is outside of the world.
    pub fn cell(&self, at: &Place) -> Result<Cell, Refusal> {
        if let Self::World(axes) = self
            && axes.iter().any(|axis| !axis.is_relative && !axis.is_whole)
        {
            return Err(Refusal::new("expected whole block coordinates"));
        }
        let [x, y, z] = self.resolve(at, false).map(f64::floor);
        let most = f64::from(MAX_HORIZONTAL);
        let is_inside =
            x >= -most && x < most && z >= -most && z < most && y >= f64::from(MIN_Y) && y <= f64::from(MAX_Y);
        if !is_inside {
            return Err(Refusal::new("the position is out of this world"));
        }
        Ok(Cell::new(x as i32, y as i32, z as i32))
    }

    /// Returns the position that the coordinates mean for a body. Whole absolute x and z mean the middle of the block.
    #[must_use]
    pub fn position(&self, at: &Place) -> [f64; 3] {
        self.resolve(at, true)
    }

    fn resolve(&self, at: &Place, is_centred: bool) -> [f64; 3] {
        match self {
            Self::World(axes) => std::array::from_fn(|axis| {
                let Coordinate { value, is_relative, is_whole } = axes[axis];
                match (is_relative, is_centred && is_whole && axis != 1) {
                    (true, _) => at.position[axis] + value,
                    (false, true) => value + 0.5,
                    (false, false) => value,
                }
            }),
            Self::Local(local) => from_view(at, *local),
        }
    }
}

/// Moves from a place by steps to the left, up and forwards as seen from there.
fn from_view(at: &Place, [left, up, forwards]: [f64; 3]) -> [f64; 3] {
    let (turned, tilted) = ((at.yaw + 90.0).to_radians(), (-at.pitch).to_radians());
    let ahead = [turned.cos() * tilted.cos(), tilted.sin(), turned.sin() * tilted.cos()];
    let risen = (90.0 - at.pitch).to_radians();
    let above = [turned.cos() * risen.cos(), risen.sin(), turned.sin() * risen.cos()];
    let aside = [
        ahead[2] * above[1] - ahead[1] * above[2],
        ahead[0] * above[2] - ahead[2] * above[0],
        ahead[1] * above[0] - ahead[0] * above[1],
    ];
    // The server's table of sines has no errors of rounding at right angles.
    let whole = |value: f64| (value * 1e9).round() / 1e9;
    std::array::from_fn(|axis| {
        let anchor = if axis == 1 { at.anchor } else { 0.0 };
        whole(at.position[axis] + anchor + ahead[axis] * forwards + above[axis] * up + aside[axis] * left)
    })
}

/// Reads a number of a command: digits with an optional sign and decimal point. Nothing means 0, also between two
/// spaces.
pub(super) fn number(text: &str) -> Result<f64, Refusal> {
    if text.is_empty() {
        return Ok(0.0);
    }
    let digits = text.strip_prefix('-').unwrap_or(text);
    let is_number =
        digits.chars().all(|c| c.is_ascii_digit() || c == '.') && digits.contains(|c: char| c.is_ascii_digit());
    let value = if is_number { text.parse::<f64>().ok().filter(|value| value.is_finite()) } else { None };
    value.ok_or_else(|| Refusal::new(format!("expected a coordinate instead of '{text}'")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(words: [&str; 3]) -> Result<Cell, Refusal> {
        let at = Place { position: [10.5, 2.0, -3.5], ..Place::default() };
        Coordinates::read(words).and_then(|read| read.cell(&at))
    }

    #[test]
    fn coordinates_are_absolute_relative_or_from_view() {
        assert_eq!(cell(["1", "-2", "03"]).unwrap(), Cell::new(1, -2, 3));
        assert_eq!(cell(["~", "~-1", "~1.6"]).unwrap(), Cell::new(10, 1, -2));
        assert_eq!(cell(["~", "5", "~"]).unwrap(), Cell::new(10, 5, -4));
        // Looking south: left is east, forwards is south.
        assert_eq!(cell(["^1", "^2", "^3"]).unwrap(), Cell::new(11, 4, -1));
        for words in [["1.5", "0", "0"], ["NaN", "0", "0"], ["^", "~", "~"], ["1e3", "0", "0"], ["-", "0", "0"]] {
            assert!(cell(words).is_err(), "{words:?}");
        }
        assert!(cell(["0", "320", "0"]).is_err() && cell(["0", "-65", "0"]).is_err());
        assert!(cell(["30000001", "0", "0"]).is_err());
    }

    #[test]
    fn a_body_stands_in_the_middle_of_a_block_that_is_named_by_whole_numbers() {
        let read = Coordinates::read(["10", "0", "-4"]).unwrap();
        assert_eq!(read.position(&Place::default()), [10.5, 0.0, -3.5]);
        let read = Coordinates::read(["10.0", "0", "~1"]).unwrap();
        assert_eq!(read.position(&Place::default()), [10.0, 0.0, 1.0]);
    }
}

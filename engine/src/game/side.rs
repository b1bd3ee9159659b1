//! Sides of blocks.

use crate::voxel::cell::Cell;

/// A side of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Towards less x.
    West,
    /// Towards greater x.
    East,
    /// Towards less z.
    North,
    /// Towards greater z.
    South,
    /// Below.
    Down,
    /// Above.
    Up,
}

impl Side {
    /// The sides in the order in which the server updates neighbours.
    pub const IN_ORDER_OF_UPDATES: [Self; 6] = [Self::West, Self::East, Self::North, Self::South, Self::Down, Self::Up];

    /// Returns the side of a name, such as `north`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "west" => Self::West,
            "east" => Self::East,
            "north" => Self::North,
            "south" => Self::South,
            "down" => Self::Down,
            "up" => Self::Up,
            _ => return None,
        })
    }

    /// Returns the name of the side, such as `north`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::West => "west",
            Self::East => "east",
            Self::North => "north",
            Self::South => "south",
            Self::Down => "down",
            Self::Up => "up",
        }
    }

    /// Returns the opposite side.
    #[must_use]
    pub const fn opposite(self) -> Self {
        match self {
            Self::West => Self::East,
            Self::East => Self::West,
            Self::North => Self::South,
            Self::South => Self::North,
            Self::Down => Self::Up,
            Self::Up => Self::Down,
        }
    }

    /// Returns the cell on this side of another.
    #[must_use]
    pub const fn beside(self, cell: Cell) -> Cell {
        match self {
            Self::West => cell.offset(-1, 0, 0),
            Self::East => cell.offset(1, 0, 0),
            Self::North => cell.offset(0, 0, -1),
            Self::South => cell.offset(0, 0, 1),
            Self::Down => cell.offset(0, -1, 0),
            Self::Up => cell.offset(0, 1, 0),
        }
    }

    /// Returns the side to the right of one who looks to this side.
    #[must_use]
    pub const fn clockwise(self) -> Self {
        match self {
            Self::North => Self::East,
            Self::East => Self::South,
            Self::South => Self::West,
            Self::West => Self::North,
            vertical => vertical,
        }
    }
}

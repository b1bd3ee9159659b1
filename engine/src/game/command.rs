//! What commands ask for.

use super::coordinates::Coordinates;
use super::filter::Filter;
use super::registry::Look;

/// A command that changes blocks or moves the body, or one that does neither.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// `/setblock POSITION BLOCK [destroy|keep|replace]`.
    SetBlock {
        /// Cell to set.
        at: Coordinates,
        /// Block to set.
        look: Look,
        /// What happens to the block that stands there.
        mode: SetMode,
    },
    /// `/fill FROM TO BLOCK [destroy|hollow|keep|outline|replace [FILTER]]`.
    Fill {
        /// Two opposite corners of the box.
        corners: [Coordinates; 2],
        /// Block to fill with.
        look: Look,
        /// Which cells of the box change.
        mode: FillMode,
    },
    /// `/clone FROM TO DESTINATION [replace|masked|filtered FILTER] [force|move|normal]`.
    Clone {
        /// Two opposite corners of the box.
        corners: [Coordinates; 2],
        /// Least corner of the copy.
        to: Coordinates,
        /// Which blocks are copied.
        which: CloneFilter,
        /// How the copy may lie to the original.
        mode: CloneMode,
    },
    /// `/tp [TARGET] POSITION`.
    Teleport {
        /// Position to go to.
        to: Coordinates,
        /// Where to look afterwards; none to look where the body looks.
        view: Option<View>,
    },
    /// `/gamerule commandModificationBlockLimit N`.
    BlockLimit {
        /// Greatest number of blocks that `/fill` and `/clone` may change.
        blocks: i32,
    },
    /// `/execute … run COMMAND`.
    From {
        /// Where the command is carried out, step by step from the body.
        steps: Vec<Step>,
        /// The command.
        run: Box<Self>,
    },
    /// A command that neither changes a block nor moves the body.
    Harmless,
}

/// A step of `/execute` that says where a command is carried out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Where the body is, looking where it looks.
    AtBody,
    /// Where the body is.
    PositionedAsBody,
    /// Looking where the body looks.
    RotatedAsBody,
    /// At a position.
    Positioned(Coordinates),
    /// Looking in a direction: yaw and pitch.
    Rotated([Angle; 2]),
    /// Coordinates with `^` begin at the eyes, or at the feet.
    Anchored {
        /// Whether it is the eyes.
        at_eyes: bool,
    },
    /// At the corner of the block, along these axes.
    Aligned([bool; 3]),
}

/// Where to look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum View {
    /// In a direction: yaw and pitch.
    Angles([Angle; 2]),
    /// From the anchor towards a position.
    Facing(Coordinates),
}

/// An angle in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angle {
    /// The angle, or what is added to that of the place where the command is carried out.
    pub degrees: f64,
    /// Whether it is added.
    pub is_relative: bool,
}

impl Angle {
    /// Returns the angle, given that of the place.
    #[must_use]
    pub fn from(self, own: f64) -> f64 {
        if self.is_relative { own + self.degrees } else { self.degrees }
    }
}

/// Mode of `/setblock`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetMode {
    /// Takes the place of any other block.
    Replace,
    /// Breaks the old block first.
    Destroy,
    /// Only fills air.
    Keep,
}

/// Mode of `/fill`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FillMode {
    /// Changes all cells, or those that a filter accepts.
    Replace(Option<Filter>),
    /// Breaks the old blocks first.
    Destroy,
    /// Only fills air.
    Keep,
    /// Fills the outermost layer and empties the rest.
    Hollow,
    /// Fills the outermost layer only.
    Outline,
}

/// Which blocks `/clone` copies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CloneFilter {
    /// All, air too.
    All,
    /// All but air.
    Masked,
    /// Those that a filter accepts.
    Filtered(Filter),
}

/// How a copy may lie to its original.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CloneMode {
    /// They may not overlap.
    Normal,
    /// They may overlap.
    Force,
    /// They may overlap, and the original is removed.
    Move,
}

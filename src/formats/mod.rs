//! Structure files of the game and its tools: `.nbt`, `.schem` and `.litematic` (`docs/rules.md#structure-files`).
//!
//! `read` takes each of them, `write` writes each. `nbt` guards the way in: files come from strangers, and NBT that is
//! a few kilobytes packed may be gigabytes unpacked.

mod litematic;
mod nbt;
mod schematic;
mod states;
mod structure;
mod versions;

pub use states::MAX_NAME;

use std::collections::HashMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use states::State;
use versions::Names;

/// Version of the game's data that files are written for: Java Edition 1.21.4.
const DATA_VERSION: i32 = 4189;
/// Greatest number of cells in the box of a file whose format lists every cell.
pub const MAX_CELLS: u64 = 1 << 23;
/// Greatest number of cells along an axis of a schematic, whose lengths are unsigned shorts.
pub const MAX_AXIS: u64 = 65_535;
/// Greatest number of cells along an axis of a file that lists every cell and is written: other programs read signed
/// shorts.
pub const MAX_AXIS_WRITTEN: u64 = 32_767;
/// Greatest size of a file in bytes after decompression.
pub const MAX_BYTES: u64 = 32 << 20;
/// Greatest number of values in a file. A block of a `.nbt` takes six.
pub const MAX_VALUES: usize = 6_000_000;
/// Greatest depth of nested lists and compounds. Files of builds need about ten.
pub const MAX_DEPTH: usize = 64;
/// Greatest number of texts in a file, and of members in a compound: each takes much more memory once it is read.
pub const MAX_TEXTS: usize = 1 << 18;

/// Format of a structure file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum FileFormat {
    /// Structure of the game's structure blocks: `.nbt`.
    #[default]
    Nbt,
    /// Sponge schematic, as `WorldEdit` writes it: `.schem`, version 3.
    Schem,
    /// Schematic of the mod Litematica: `.litematic`, version 7.
    Litematic,
}

impl FileFormat {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Nbt, Self::Schem, Self::Litematic];

    /// Returns the extension of its files, without a dot.
    #[must_use]
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Nbt => "nbt",
            Self::Schem => "schem",
            Self::Litematic => "litematic",
        }
    }
}

/// Reason why a file cannot be read or written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FileError(String);

impl FileError {
    fn new(reason: impl fmt::Display) -> Self {
        Self(reason.to_string())
    }
}

type FileResult<T> = Result<T, FileError>;

/// A build: the blocks of a structure file, or for one.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Build {
    /// Least corner of the file's box, which may hold air at its sides. Positions are those that a paste at (0, 0, 0)
    /// gives; in a `.nbt` the corner is always (0, 0, 0).
    pub corner: [i32; 3],
    /// Blocks with their states in the game's own notation, without `minecraft:`.
    pub palette: Vec<String>,
    /// Position of each block that is not air, with its index in the palette; by y, x and z.
    pub blocks: Vec<([i32; 3], u32)>,
}

impl Build {
    /// Creates a build from blocks in any order.
    #[must_use]
    pub fn of(blocks: impl IntoIterator<Item = ([i32; 3], String)>) -> Self {
        let mut builder = Builder::new(usize::MAX);
        for (at, block) in blocks {
            let index = builder.intern(block);
            builder.put(at, index).expect("no limit on the number of blocks");
        }
        let mut build = builder.build([0; 3]);
        build.corner = build.bounds().map_or([0; 3], |(least, _)| least);
        build
    }

    /// Returns the least and the greatest position on each axis; `None` if it has no blocks.
    #[must_use]
    pub fn bounds(&self) -> Option<([i32; 3], [i32; 3])> {
        let mut positions = self.blocks.iter().map(|(at, _)| *at);
        let first = positions.next()?;
        Some(positions.fold((first, first), |(least, most), at| {
            (std::array::from_fn(|i| least[i].min(at[i])), std::array::from_fn(|i| most[i].max(at[i])))
        }))
    }

    /// Returns the box around the blocks: its least corner and its size. The box of no blocks is one cell.
    fn frame(&self) -> ([i32; 3], [u64; 3]) {
        let (least, most) = self.bounds().unwrap_or_default();
        (least, std::array::from_fn(|i| u64::from(most[i].abs_diff(least[i])) + 1))
    }

    /// Returns the box if a format that lists every cell can hold it.
    fn dense_frame(&self) -> FileResult<([i32; 3], [u64; 3])> {
        let (least, size) = self.frame();
        let cells = size.iter().product::<u64>();
        if cells > MAX_CELLS || size.iter().any(|size| *size > MAX_AXIS_WRITTEN) {
            let [x, y, z] = size;
            return Err(FileError::new(format!(
                "the build spans {x} × {y} × {z} cells; this format lists every cell, and at most {MAX_CELLS} cells and \
                 {MAX_AXIS_WRITTEN} on an axis are written; nbt lists only blocks"
            )));
        }
        Ok((least, size))
    }
}

/// Blocks of a file as it is read: the last block at a position counts.
struct Builder {
    names: Names,
    palette: Vec<String>,
    ids: HashMap<String, u32>,
    standing: HashMap<[i32; 3], u32>,
    most: usize,
}

impl Builder {
    fn new(most: usize) -> Self {
        Self { names: Names::default(), palette: Vec::new(), ids: HashMap::new(), standing: HashMap::new(), most }
    }

    /// States the version of the game's data that the file was written for.
    fn written_for(&mut self, data_version: Option<i32>) -> FileResult<()> {
        self.names = Names::of(data_version)?;
        Ok(())
    }

    /// Returns the index of a block state in the palette; none for air.
    fn block(&mut self, state: &State) -> FileResult<Option<u32>> {
        if state.is_air() {
            return Ok(None);
        }
        let block = self.names.now(state).canonical()?;
        Ok(Some(self.intern(block)))
    }

    fn intern(&mut self, block: String) -> u32 {
        if let Some(id) = self.ids.get(&block) {
            return *id;
        }
        let id = self.palette.len() as u32;
        self.palette.push(block.clone());
        self.ids.insert(block, id);
        id
    }

    fn put(&mut self, at: [i32; 3], block: u32) -> FileResult<()> {
        self.standing.insert(at, block);
        if self.standing.len() > self.most {
            return Err(FileError::new(format!("more than {} blocks that are not air", self.most)));
        }
        Ok(())
    }

    fn clear(&mut self, at: [i32; 3]) {
        self.standing.remove(&at);
    }

    fn build(self, corner: [i32; 3]) -> Build {
        let mut blocks: Vec<([i32; 3], u32)> = self.standing.into_iter().collect();
        blocks.sort_unstable_by_key(|([x, y, z], _)| (*y, *x, *z));
        // Keeps only the names in use, in order of their first use.
        let mut renumbered = vec![None; self.palette.len()];
        let mut palette = Vec::new();
        for (_, id) in &mut blocks {
            *id = *renumbered[*id as usize].get_or_insert_with(|| {
                palette.push(self.palette[*id as usize].clone());
                palette.len() as u32 - 1
            });
        }
        Build { corner, palette, blocks }
    }
}

/// Returns `at` shifted by `by`.
fn shifted(at: [i32; 3], by: [i32; 3]) -> FileResult<[i32; 3]> {
    let mut sum = [0; 3];
    for axis in 0..3 {
        sum[axis] = at[axis].checked_add(by[axis]).ok_or_else(|| FileError::new("a position beyond 2^31"))?;
    }
    Ok(sum)
}

/// Reads a structure file of any of the formats, which is recognised from what it holds.
///
/// # Errors
/// Returns an error that names the place if the file is damaged, of another format, larger than [`MAX_BYTES`] or
/// [`MAX_CELLS`], or if it has more than `most_blocks` blocks.
pub fn read(bytes: &[u8], most_blocks: usize) -> FileResult<(FileFormat, Build)> {
    let nbt::Unpacked { bytes: unpacked, members } = nbt::unpack(bytes)?;
    let has = |name: &str| members.iter().any(|member| member == name);
    let builder = Builder::new(most_blocks);
    if has("Schematic") || has("BlockData") {
        Ok((FileFormat::Schem, schematic::read(&unpacked, has("Schematic"), builder)?))
    } else if has("Regions") {
        Ok((FileFormat::Litematic, litematic::read(&unpacked, builder)?))
    } else if has("blocks") && (has("palette") || has("palettes")) {
        Ok((FileFormat::Nbt, structure::read(&unpacked, builder)?))
    } else if has("Blocks") && has("Materials") {
        Err(FileError::new(
            "a schematic of MCEdit, which numbers blocks as the game did before 1.13; load it in WorldEdit and save it as .schem",
        ))
    } else {
        let found =
            members.iter().take(8).map(|member| format!("{:?}", states::shown(member))).collect::<Vec<_>>().join(", ");
        Err(FileError::new(format!(
            "neither a structure (.nbt), nor a Sponge schematic (.schem), nor a Litematica schematic (.litematic); it has the members {found}"
        )))
    }
}

/// Writes a build as a structure file. The same build always gives the same bytes.
///
/// # Errors
/// Returns an error if the format cannot hold the build because its blocks are too far apart.
pub fn write(format: FileFormat, build: &Build) -> FileResult<Vec<u8>> {
    match format {
        FileFormat::Nbt => structure::write(build),
        FileFormat::Schem => schematic::write(build),
        FileFormat::Litematic => litematic::write(build),
    }
}

#[cfg(test)]
mod tests;

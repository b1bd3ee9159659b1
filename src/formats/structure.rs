//! Structures of the game's structure blocks: `.nbt`. They list blocks, and know no place in the world.

use serde::{Deserialize, Serialize};

use super::nbt::{pack, parse};
use super::states::State;
use super::versions::data_version;
use super::{Build, Builder, DATA_VERSION, FileError, FileResult};

#[derive(Deserialize)]
struct Structure {
    #[serde(rename = "DataVersion", default, deserialize_with = "data_version")]
    data_version: Option<i32>,
    size: [i32; 3],
    palette: Option<Vec<State>>,
    /// Palettes of equal length, of which the game chooses one at random; the first is read.
    palettes: Option<Vec<Vec<State>>>,
    blocks: Vec<Block>,
}

#[derive(Deserialize)]
struct Block {
    pos: [i32; 3],
    state: i32,
}

pub fn read(unpacked: &[u8], mut builder: Builder) -> FileResult<Build> {
    let structure: Structure = parse(unpacked)?;
    builder.written_for(structure.data_version)?;
    let palette = match structure.palettes {
        Some(palettes) => palettes.into_iter().next(),
        None => structure.palette,
    };
    let palette = palette.ok_or_else(|| FileError::new("palettes: an empty list"))?;
    let mut ids = Vec::with_capacity(palette.len());
    for state in &palette {
        ids.push(builder.block(state)?);
    }
    for (at, Block { pos, state }) in structure.blocks.into_iter().enumerate() {
        if (0..3).any(|axis| !(0..structure.size[axis]).contains(&pos[axis])) {
            let size = structure.size;
            return Err(FileError::new(format!("blocks[{at}]: {pos:?} is outside the size {size:?}")));
        }
        let id = usize::try_from(state).ok().and_then(|state| ids.get(state));
        match id.ok_or_else(|| FileError::new(format!("blocks[{at}]: no state {state} in the palette")))? {
            Some(id) => builder.put(pos, *id)?,
            None => builder.clear(pos),
        }
    }
    Ok(builder.build([0; 3]))
}

#[derive(Serialize)]
struct WrittenStructure {
    #[serde(rename = "DataVersion")]
    data_version: i32,
    size: [i32; 3],
    palette: Vec<State>,
    blocks: Vec<WrittenBlock>,
    entities: Vec<State>,
}

#[derive(Serialize)]
struct WrittenBlock {
    pos: [i32; 3],
    state: i32,
}

pub fn write(build: &Build) -> FileResult<Vec<u8>> {
    let (least, size) = build.frame();
    let mut lengths = [0; 3];
    for axis in 0..3 {
        lengths[axis] = i32::try_from(size[axis]).map_err(|_| FileError::new("the blocks are too far apart"))?;
    }
    let position = |at: [i32; 3]| std::array::from_fn(|axis| at[axis] - least[axis]);
    pack(&WrittenStructure {
        data_version: DATA_VERSION,
        size: lengths,
        palette: build.palette.iter().map(|block| State::whole(block)).collect(),
        blocks: build.blocks.iter().map(|(at, id)| WrittenBlock { pos: position(*at), state: *id as i32 }).collect(),
        entities: Vec::new(),
    })
}

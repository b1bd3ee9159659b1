//! Sponge schematics, which `WorldEdit` writes: `.schem`. Versions 1 to 3 are read, version 3 is written.

use std::collections::{BTreeMap, HashMap};

use fastnbt::{ByteArray, IntArray};
use serde::{Deserialize, Serialize};

use super::nbt::{pack, parse};
use super::states::State;
use super::versions::data_version;
use super::{Build, Builder, DATA_VERSION, FileError, FileResult, MAX_AXIS, MAX_CELLS, shifted};

/// Palette of a schematic: a number for each block state.
type Palette = BTreeMap<String, i32>;

#[derive(Deserialize)]
struct Root {
    #[serde(rename = "Schematic")]
    schematic: Version3,
}

#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Version3 {
    version: i32,
    #[serde(default, deserialize_with = "data_version")]
    data_version: Option<i32>,
    width: i32,
    height: i32,
    length: i32,
    offset: Option<IntArray>,
    blocks: Blocks,
}

#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Blocks {
    palette: Palette,
    data: ByteArray,
}

#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Version2 {
    version: Option<i32>,
    #[serde(default, deserialize_with = "data_version")]
    data_version: Option<i32>,
    width: i32,
    height: i32,
    length: i32,
    offset: Option<IntArray>,
    metadata: Option<Metadata>,
    palette: Palette,
    block_data: ByteArray,
}

/// What `WorldEdit` adds to version 2. With it, `Offset` is the place that the build was copied from.
#[derive(Deserialize)]
struct Metadata {
    #[serde(rename = "WEOffsetX")]
    x: Option<i32>,
    #[serde(rename = "WEOffsetY")]
    y: Option<i32>,
    #[serde(rename = "WEOffsetZ")]
    z: Option<i32>,
}

pub fn read(unpacked: &[u8], is_version_3: bool, mut builder: Builder) -> FileResult<Build> {
    if is_version_3 {
        let file = parse::<Root>(unpacked)?.schematic;
        is_read(file.version, 3..=3)?;
        builder.written_for(file.data_version)?;
        let size = [file.width, file.height, file.length];
        return cells(size, offset(file.offset)?, &file.blocks.palette, &file.blocks.data, builder);
    }
    let file: Version2 = parse(unpacked)?;
    is_read(file.version.unwrap_or(1), 1..=2)?;
    builder.written_for(file.data_version)?;
    let size = [file.width, file.height, file.length];
    let corner = match file.metadata {
        Some(Metadata { x: Some(x), y: Some(y), z: Some(z) }) => [x, y, z],
        _ => offset(file.offset)?,
    };
    cells(size, corner, &file.palette, &file.block_data, builder)
}

/// Checks the version of a file, because a later one may mean something else by the same names.
fn is_read(version: i32, known: std::ops::RangeInclusive<i32>) -> FileResult<()> {
    if known.contains(&version) {
        return Ok(());
    }
    Err(FileError::new(format!(
        "Version: {version} of Sponge schematics in this form is not read; versions 1 to 3 are"
    )))
}

fn offset(offset: Option<IntArray>) -> FileResult<[i32; 3]> {
    let Some(offset) = offset else { return Ok([0; 3]) };
    let found = offset.len();
    offset.into_inner().try_into().map_err(|_| FileError::new(format!("Offset: {found} numbers instead of 3")))
}

fn cells(
    size: [i32; 3],
    corner: [i32; 3],
    palette: &Palette,
    data: &ByteArray,
    mut builder: Builder,
) -> FileResult<Build> {
    let mut lengths = [0; 3];
    for axis in 0..3 {
        let name = ["Width", "Height", "Length"][axis];
        // Sizes are unsigned shorts, which NBT lacks.
        let length = if size[axis] < 0 { size[axis] + (1 << 16) } else { size[axis] };
        lengths[axis] = u64::try_from(length)
            .ok()
            .filter(|length| (1..=MAX_AXIS).contains(length))
            .ok_or_else(|| FileError::new(format!("{name}: {}, expected 1 to {MAX_AXIS}", size[axis])))?;
    }
    let [width, height, length] = lengths;
    let volume = width * height * length;
    if volume > MAX_CELLS {
        return Err(FileError::new(format!("a box of {volume} cells; at most {MAX_CELLS} are read")));
    }
    let mut ids: HashMap<i32, Option<u32>> = HashMap::new();
    for (block, number) in palette {
        let id = builder.block(&State::read(block)?)?;
        if ids.insert(*number, id).is_some() {
            return Err(FileError::new(format!("Palette: two blocks have the number {number}")));
        }
    }
    let mut numbers = Varints { bytes: data, at: 0 };
    for index in 0..volume {
        let number = numbers.next(index, volume)?;
        let unknown = || FileError::new(format!("cell {index}: no number {number} in the palette"));
        let Some(id) = ids.get(&number).ok_or_else(unknown)? else { continue };
        let at = [index % width, index / (width * length), index / width % length];
        builder.put(shifted(at.map(|part| part as i32), corner)?, *id)?;
    }
    if numbers.at < data.len() {
        return Err(FileError::new(format!("the data goes on after the {volume} cells of the box")));
    }
    Ok(builder.build(corner))
}

/// LEB128 varints: seven bits a byte, the lowest first; the highest bit of a byte says that more follow.
struct Varints<'a> {
    bytes: &'a [i8],
    at: usize,
}

impl Varints<'_> {
    fn next(&mut self, index: u64, volume: u64) -> FileResult<i32> {
        let mut number = 0u32;
        for shift in (0..35).step_by(7) {
            let byte = *self.bytes.get(self.at).ok_or_else(|| {
                FileError::new(format!("the data ends at cell {index} of the {volume} cells of the box"))
            })? as u8;
            self.at += 1;
            number |= u32::from(byte & 0x7f).wrapping_shl(shift);
            if byte & 0x80 == 0 {
                return Ok(number as i32);
            }
        }
        Err(FileError::new(format!("cell {index}: a number of more than five bytes")))
    }
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct WrittenRoot {
    schematic: Written,
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct Written {
    version: i32,
    data_version: i32,
    width: i16,
    height: i16,
    length: i16,
    offset: IntArray,
    blocks: WrittenBlocks,
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct WrittenBlocks {
    palette: Palette,
    data: ByteArray,
    // Litematica refuses a schematic without it.
    block_entities: Vec<State>,
}

pub fn write(build: &Build) -> FileResult<Vec<u8>> {
    let (least, [width, height, length]) = build.dense_frame()?;
    let mut palette = Palette::from([(State::air().name, 0)]);
    let mut numbers = Vec::with_capacity(build.palette.len());
    for block in &build.palette {
        let next = palette.len() as i32;
        numbers.push(*palette.entry(State::whole(block).text()).or_insert(next));
    }
    let mut cells = vec![0; (width * height * length) as usize];
    for ([x, y, z], id) in &build.blocks {
        let [x, y, z] = [x.abs_diff(least[0]), y.abs_diff(least[1]), z.abs_diff(least[2])].map(u64::from);
        cells[(x + z * width + y * width * length) as usize] = numbers[*id as usize];
    }
    let mut data = Vec::with_capacity(cells.len());
    for number in cells {
        let mut rest = number as u32;
        while rest >= 0x80 {
            data.push((rest & 0x7f | 0x80) as u8 as i8);
            rest >>= 7;
        }
        data.push(rest as i8);
    }
    let [width, height, length] = [width, height, length].map(|length| length as i16);
    let blocks = WrittenBlocks { palette, data: ByteArray::new(data), block_entities: Vec::new() };
    let offset = IntArray::new(least.to_vec());
    pack(&WrittenRoot {
        schematic: Written { version: 3, data_version: DATA_VERSION, width, height, length, offset, blocks },
    })
}

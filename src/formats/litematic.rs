//! Schematics of the mod Litematica: `.litematic`. Versions 5 to 7 are read, version 7 is written.

use std::collections::BTreeMap;

use fastnbt::LongArray;
use serde::{Deserialize, Serialize};

use super::nbt::{pack, parse};
use super::states::State;
use super::versions::data_version;
use super::{Build, Builder, DATA_VERSION, FileError, FileResult, MAX_CELLS, shifted};

/// Versions of the format whose blocks have names.
const READ: std::ops::RangeInclusive<i32> = 5..=7;

#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct File {
    version: i32,
    #[serde(default, deserialize_with = "data_version")]
    minecraft_data_version: Option<i32>,
    regions: BTreeMap<String, Region>,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
struct Vector {
    x: i32,
    y: i32,
    z: i32,
}

impl From<[i32; 3]> for Vector {
    fn from([x, y, z]: [i32; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<Vector> for [i32; 3] {
    fn from(vector: Vector) -> Self {
        [vector.x, vector.y, vector.z]
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Region {
    /// One corner.
    position: Vector,
    /// Signed: towards the other corner.
    size: Vector,
    block_state_palette: Vec<State>,
    block_states: LongArray,
}

pub fn read(unpacked: &[u8], mut builder: Builder) -> FileResult<Build> {
    let file: File = parse(unpacked)?;
    if !READ.contains(&file.version) {
        let version = file.version;
        return Err(FileError::new(format!(
            "Litematica's version {version}; versions 5 to 7 are read: load it in Litematica of Minecraft 1.13 to 1.21 and save it anew"
        )));
    }
    builder.written_for(file.minecraft_data_version)?;
    let mut corner: Option<[i32; 3]> = None;
    let mut left = MAX_CELLS;
    for (name, region) in &file.regions {
        let fault = |what: &str| FileError::new(format!("region {:?}: {what}", super::states::shown(name)));
        let least = region.read(&mut builder, &mut left, &fault)?;
        corner = Some(corner.map_or(least, |corner| std::array::from_fn(|axis| corner[axis].min(least[axis]))));
    }
    Ok(builder.build(corner.ok_or_else(|| FileError::new("Regions: none"))?))
}

impl Region {
    /// Puts the blocks of the region into a build; returns its least corner.
    fn read(&self, builder: &mut Builder, left: &mut u64, fault: &dyn Fn(&str) -> FileError) -> FileResult<[i32; 3]> {
        let (position, size): ([i32; 3], [i32; 3]) = (self.position.into(), self.size.into());
        let mut least = [0; 3];
        for axis in 0..3 {
            let back = if size[axis] < 0 { i64::from(size[axis]) + 1 } else { 0 };
            least[axis] = i32::try_from(i64::from(position[axis]) + back).map_err(|_| fault("a corner beyond 2^31"))?;
        }
        let [dx, dy, dz] = size.map(|size| u64::from(size.unsigned_abs()));
        if dx == 0 || dy == 0 || dz == 0 {
            return Err(fault("a size of 0"));
        }
        let volume = dx.checked_mul(dy).and_then(|area| area.checked_mul(dz));
        let volume = volume.filter(|volume| *volume <= *left);
        let volume = volume.ok_or_else(|| fault(&format!("more than {MAX_CELLS} cells in all regions")))?;
        *left -= volume;
        let mut ids = Vec::with_capacity(self.block_state_palette.len());
        for state in &self.block_state_palette {
            ids.push(builder.block(state)?);
        }
        let bits = bits_for(ids.len());
        let longs = (volume * bits).div_ceil(64);
        if self.block_states.len() as u64 != longs {
            let found = self.block_states.len();
            return Err(fault(&format!("{found} longs for {volume} cells of {bits} bits; expected {longs}")));
        }
        for index in 0..volume {
            let number = unpacked_at(&self.block_states, index, bits);
            let unknown = || fault(&format!("cell {index}: no entry {number} in the palette"));
            // Of regions that overlap, air does not remove what another has.
            let Some(id) = ids.get(number).ok_or_else(unknown)? else { continue };
            let at = [index % dx, index / (dx * dz), index / dx % dz];
            builder.put(shifted(at.map(|part| part as i32), least)?, *id)?;
        }
        Ok(least)
    }
}

/// Returns the number of bits of an entry.
fn bits_for(entries: usize) -> u64 {
    let greatest = entries.saturating_sub(1) as u64;
    u64::from(u64::BITS - greatest.leading_zeros()).max(2)
}

/// Returns an entry of packed numbers, which may span two longs.
fn unpacked_at(longs: &[i64], index: u64, bits: u64) -> usize {
    let start = index * bits;
    let (at, shift) = ((start / 64) as usize, start % 64);
    let mut value = longs[at] as u64 >> shift;
    if shift + bits > 64 {
        value |= (longs[at + 1] as u64) << (64 - shift);
    }
    (value & ((1 << bits) - 1)) as usize
}

/// Packs numbers, the first in the lowest bits of the first long.
fn packed(numbers: &[u32], bits: u64) -> Vec<i64> {
    let mut longs = vec![0u64; (numbers.len() as u64 * bits).div_ceil(64) as usize];
    for (index, number) in (0u64..).zip(numbers) {
        let start = index * bits;
        let (at, shift) = ((start / 64) as usize, start % 64);
        longs[at] |= u64::from(*number) << shift;
        if shift + bits > 64 {
            longs[at + 1] |= u64::from(*number) >> (64 - shift);
        }
    }
    longs.into_iter().map(|long| long as i64).collect()
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct WrittenFile {
    minecraft_data_version: i32,
    version: i32,
    sub_version: i32,
    metadata: Metadata,
    regions: BTreeMap<&'static str, WrittenRegion>,
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct Metadata {
    name: &'static str,
    author: &'static str,
    description: &'static str,
    enclosing_size: Vector,
    region_count: i32,
    total_volume: i32,
    total_blocks: i32,
    time_created: i64,
    time_modified: i64,
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct WrittenRegion {
    position: Vector,
    size: Vector,
    block_state_palette: Vec<State>,
    block_states: LongArray,
    tile_entities: Vec<State>,
    entities: Vec<State>,
    pending_block_ticks: Vec<State>,
    pending_fluid_ticks: Vec<State>,
}

pub fn write(build: &Build) -> FileResult<Vec<u8>> {
    let (least, [width, height, length]) = build.dense_frame()?;
    // Litematica expects air first.
    let mut palette = vec![State::air()];
    let mut numbers = Vec::with_capacity(build.palette.len());
    for block in &build.palette {
        let state = State::whole(block);
        let known = palette.iter().position(|known| *known == state);
        numbers.push(known.unwrap_or(palette.len()) as u32);
        if known.is_none() {
            palette.push(state);
        }
    }
    let mut cells = vec![0; (width * height * length) as usize];
    let mut total_blocks = 0;
    for ([x, y, z], id) in &build.blocks {
        let [x, y, z] = [x.abs_diff(least[0]), y.abs_diff(least[1]), z.abs_diff(least[2])].map(u64::from);
        cells[(x + z * width + y * width * length) as usize] = numbers[*id as usize];
        total_blocks += i32::from(numbers[*id as usize] != 0);
    }
    let size = Vector::from([width, height, length].map(|length| length as i32));
    let region = WrittenRegion {
        position: least.into(),
        size,
        block_states: LongArray::new(packed(&cells, bits_for(palette.len()))),
        block_state_palette: palette,
        tile_entities: Vec::new(),
        entities: Vec::new(),
        pending_block_ticks: Vec::new(),
        pending_fluid_ticks: Vec::new(),
    };
    pack(&WrittenFile {
        minecraft_data_version: DATA_VERSION,
        version: 7,
        sub_version: 1,
        metadata: Metadata {
            name: "build",
            author: "",
            description: "",
            enclosing_size: size,
            region_count: 1,
            total_volume: cells.len() as i32,
            total_blocks,
            time_created: 0,
            time_modified: 0,
        },
        regions: BTreeMap::from([("build", region)]),
    })
}

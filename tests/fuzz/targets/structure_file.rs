//! Structure files, packed or not: what is read is written and read back alike.

use std::io::Write as _;

use plumbline::formats::{Build, FileFormat, read, write};

/// Greatest number of blocks.
const MAX: usize = 5_000;

pub fn run(data: &[u8]) {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(data).expect("memory takes all bytes");
    for bytes in [data, &packed.finish().expect("memory takes all bytes")] {
        let Ok((format, build)) = read(bytes, MAX) else { continue };
        // Boxes, names and positions may be too large to be written.
        let Ok(written) = write(format, &build) else { continue };
        let (again, same) = read(&written, MAX).expect("what is written reads back");
        assert_eq!(again, format);
        // States are written whole, so they read back with all their properties.
        assert_eq!(blocks(&same, format, name), blocks(&build, format, name));
        let (_, third) = read(&write(format, &same).expect("it was written before"), MAX).expect("it reads back");
        assert_eq!(blocks(&third, format, str::to_owned), blocks(&same, format, str::to_owned));
    }
}

/// The name of a block without its state.
fn name(block: &str) -> String {
    block.split('[').next().unwrap_or_default().to_owned()
}

/// The blocks from the least corner on, which is where a `.nbt` begins.
fn blocks(build: &Build, format: FileFormat, named: impl Fn(&str) -> String) -> Vec<([i64; 3], String)> {
    let from = if format == FileFormat::Nbt { least(build) } else { [0; 3] };
    let at = |at: [i32; 3]| [0, 1, 2].map(|axis| i64::from(at[axis]) - from[axis]);
    let mut blocks: Vec<_> =
        build.blocks.iter().map(|(cell, id)| (at(*cell), named(&build.palette[*id as usize]))).collect();
    blocks.sort_unstable();
    blocks
}

fn least(build: &Build) -> [i64; 3] {
    [0, 1, 2].map(|axis| build.blocks.iter().map(|(at, _)| i64::from(at[axis])).min().unwrap_or(0))
}

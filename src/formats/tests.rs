//! Files of other programs, files of ours, and files that mean harm.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;

use proptest::prelude::*;
use serde_json::Value;

use super::states::State;
use super::*;

/// A block by position, as `tests/formats` describes what its files hold.
type Blocks = BTreeMap<[i32; 3], String>;

fn blocks(build: &Build) -> Blocks {
    build.blocks.iter().map(|(at, id)| (*at, build.palette[*id as usize].clone())).collect()
}

fn position(value: &Value) -> [i32; 3] {
    let [x, y, z] = [0, 1, 2].map(|axis| value[axis].as_i64().unwrap() as i32);
    [x, y, z]
}

/// Returns the blocks that a description lists, or boxes of which later ones replace earlier ones.
fn described(told: &Value) -> Blocks {
    let name = |value: &Value| value["block"].as_str().unwrap().trim_start_matches("minecraft:").to_owned();
    if let Some(listed) = told["blocks"].as_array() {
        let at = |block: &Value| ["x", "y", "z"].map(|axis| block[axis].as_i64().unwrap() as i32);
        return listed.iter().map(|block| (at(block), name(block))).collect();
    }
    let mut blocks = Blocks::new();
    for fill in told["fills"].as_array().unwrap() {
        let (from, to) = (position(&fill["from"]), position(&fill["to"]));
        for x in from[0]..=to[0] {
            for y in from[1]..=to[1] {
                for z in from[2]..=to[2] {
                    blocks.insert([x, y, z], name(fill));
                }
            }
        }
    }
    blocks.retain(|_, block| block != "air");
    blocks
}

#[test]
fn files_of_other_programs_hold_what_they_were_written_from() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats");
    let mut seen = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let extension = path.extension().unwrap().to_str().unwrap();
        let Some(format) = FileFormat::ALL.into_iter().find(|format| format.extension() == extension) else { continue };
        let told: Value = serde_json::from_slice(&std::fs::read(format!("{}.json", path.display())).unwrap()).unwrap();
        let (found, build) = read(&std::fs::read(&path).unwrap(), 100_000).unwrap();
        assert_eq!(found, format, "{}", path.display());
        // A description counts from the corner of a schematic, which is pasted at an offset.
        let offset = if format == FileFormat::Schem { position(&told["offset"]) } else { [0; 3] };
        let expected: Blocks =
            described(&told).into_iter().map(|(at, block)| (shifted(at, offset).unwrap(), block)).collect();
        assert_eq!(expected.len() as u64, told["block_count"].as_u64().unwrap(), "{}", path.display());
        assert_eq!(blocks(&build), expected, "{}", path.display());
        seen += 1;
    }
    assert_eq!(seen, 18);
}

proptest! {
    #[test]
    fn a_build_is_read_as_it_was_written(
        listed in prop::collection::btree_map(
            (-20..20i32, -5..20i32, -20..20i32), 0..200usize, 0..60,
        ),
        kinds in 1..200usize,
    ) {
        let names = ["stone", "oak_door[half=upper]", "minecraft:oak_stairs[facing=west]", "mod:thing[a=b]", "no_such"];
        let name = |kind: usize| match names.get(kind % kinds) {
            Some(name) => (*name).to_owned(),
            None => format!("kind_{}", kind % kinds),
        };
        let build = Build::of(listed.iter().map(|((x, y, z), kind)| ([*x, *y, *z], name(*kind))));
        let whole = |block: &String| State::whole(block).canonical().unwrap();
        let expected = Build { palette: build.palette.iter().map(whole).collect(), ..build.clone() };
        for format in FileFormat::ALL {
            let file = write(format, &build).unwrap();
            prop_assert_eq!(&file, &write(format, &build).unwrap());
            let (found, again) = read(&file, 60).unwrap();
            prop_assert_eq!(found, format);
            let least = build.bounds().map_or([0; 3], |(least, _)| least);
            let shift = if format == FileFormat::Nbt { least } else { [0; 3] };
            let moved: Blocks = blocks(&again).into_iter().map(|(at, block)| (shifted(at, shift).unwrap(), block)).collect();
            prop_assert_eq!(moved, blocks(&expected));
            prop_assert_eq!(again.corner, if format == FileFormat::Nbt { [0; 3] } else { least });
        }
    }

    #[test]
    fn damaged_files_are_refused_and_break_nothing(
        name in prop::sample::select(vec!["house.nbt", "frame.litematic", "house_v3.schem", "house_v2.schem"]),
        at in 0..4096usize, byte in any::<u8>(), cut in any::<bool>(),
    ) {
        let packed = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats").join(name)).unwrap();
        let mut bytes = nbt::unpack(&packed).unwrap().bytes;
        let at = at % bytes.len();
        if cut { bytes.truncate(at) } else { bytes[at] = byte }
        let found = read(&bytes, 1000);
        prop_assert!(!cut || found.is_err());
    }
}

#[test]
fn names_of_older_versions_are_those_of_today() {
    let palette = |data_version: i32| palette_of(&member(3, "DataVersion", &data_version.to_be_bytes()));
    assert_eq!(palette_of(&text_member("DataVersion", "new")), palette(4189));
    assert_eq!(palette_of(&member(6, "DataVersion", &4189f64.to_be_bytes())), palette(4189));
    assert_eq!(palette(4189).unwrap(), ["grass_path", "grass", "stone_slab", "oak_planks"]);
    assert_eq!(palette(3465).unwrap(), ["grass_path", "short_grass", "stone_slab", "oak_planks"]);
    assert_eq!(palette(1631).unwrap(), ["dirt_path", "short_grass", "smooth_stone_slab", "oak_planks"]);
    for unknown in [0, -1] {
        assert_eq!(palette(unknown), palette(4189));
    }
    assert!(palette(1343).unwrap_err().to_string().contains("DataVersion: 1343 is older than Minecraft 1.13"));
}

/// Returns the palette of a structure with four blocks and this member.
fn palette_of(data_version: &[u8]) -> FileResult<Vec<String>> {
    let names = ["grass_path", "grass", "stone_slab", "oak_planks"];
    let states: Vec<Vec<u8>> = names.iter().map(|name| text_member("Name", name)).collect();
    let states = states.iter().flat_map(|state| [state.as_slice(), &[0]].concat()).collect::<Vec<u8>>();
    let blocks: Vec<u8> = (0..4i32)
        .flat_map(|at| {
            let position = [&[3, 0, 0, 0, 3][..], &at.to_be_bytes(), &[0; 8]].concat();
            [member(9, "pos", &position), member(3, "state", &at.to_be_bytes()), vec![0]].concat()
        })
        .collect();
    let list = |count: i32, members: &[u8]| [&[10u8][..], &count.to_be_bytes(), members].concat();
    let size: Vec<u8> = [&[3u8][..], &3i32.to_be_bytes(), &[4i32; 3].map(i32::to_be_bytes).concat()].concat();
    let file = root(&[
        data_version,
        &member(9, "size", &size),
        &member(9, "palette", &list(4, &states)),
        &member(9, "blocks", &list(4, &blocks)),
    ]);
    read(&file, 10).map(|(_, build)| build.palette)
}

#[test]
fn files_of_other_formats_are_recognised() {
    for (bytes, told) in [
        (&[0x78u8, 0x9c, 1, 2][..], "zlib"),
        (b"PK\x03\x04and more", "ZIP"),
        (b"[{\"action\":\"place\"}]", "text instead of NBT"),
        (b"\x0a\0\0\x03\x0e\0format_version\x01\0\0\0", "Bedrock"),
    ] {
        assert!(read(bytes, 10).unwrap_err().to_string().contains(told));
    }
}

/// A text in raw NBT.
fn text_member(name: &str, text: &str) -> Vec<u8> {
    member(8, name, &[&(text.len() as u16).to_be_bytes()[..], text.as_bytes()].concat())
}

/// Raw NBT: a root with these bytes in it.
fn root(members: &[&[u8]]) -> Vec<u8> {
    [&[10, 0, 0], members.concat().as_slice(), &[0]].concat()
}

/// A member of raw NBT.
fn member(tag: u8, name: &str, value: &[u8]) -> Vec<u8> {
    [&[tag], (name.len() as u16).to_be_bytes().as_slice(), name.as_bytes(), value].concat()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

#[test]
fn files_that_mean_harm_are_refused_with_the_reason() {
    let deep = [&[10, 0, 0, 9, 0, 0][..], &[9, 0, 0, 0, 1].repeat(400_000)].concat();
    let many = root(&[&member(9, "a", &[&[10u8][..], &40_000_000i32.to_be_bytes(), &vec![0; 40_000_000]].concat())]);
    let versioned = |version: i32, width: i16, data: &[u8], palette: &[(&str, i32)]| {
        let entries: Vec<Vec<u8>> = palette.iter().map(|(name, id)| member(3, name, &id.to_be_bytes())).collect();
        root(&[
            &member(3, "Version", &version.to_be_bytes()),
            &member(2, "Width", &width.to_be_bytes()),
            &member(2, "Height", &width.to_be_bytes()),
            &member(2, "Length", &width.to_be_bytes()),
            &member(10, "Palette", &[entries.concat().as_slice(), &[0]].concat()),
            &member(7, "BlockData", &[&(data.len() as i32).to_be_bytes(), data].concat()),
        ])
    };
    let schematic = |width: i16, data: &[u8], palette: &[(&str, i32)]| versioned(2, width, data, palette);
    let stone = [("minecraft:stone", 0)];
    for (file, reason) in [
        (Vec::new(), "the file is empty"),
        (b"{\"turns\": []}".to_vec(), "text instead of NBT"),
        (vec![9, 0, 0], "not NBT: it does not begin with a compound"),
        (b"\x1f\x8b\x08rest".to_vec(), "damaged gzip data"),
        (gzip(&vec![0; 64 << 20]), "more than 33554432 bytes unpacked"),
        (gzip(&deep), "nested deeper than 64 levels"),
        (gzip(&many), "more than 33554432 bytes unpacked"),
        (root(&[&member(7, "a", &i32::MAX.to_be_bytes())]), "the data ends in the middle of a value"),
        (root(&[&member(7, "a", &(-1i32).to_be_bytes())]), "a negative length"),
        (root(&[&member(9, "a", &[0, 0, 0, 0, 9])]), "a list without a type that has elements"),
        (root(&[&member(9, "a", &[10, 0x7f, 0xff, 0xff, 0xff])]), "more than 6000000 values"),
        (root(&[&member(13, "a", &[])]), "there is no tag 13"),
        ([root(&[]), vec![7]].concat(), "bytes after the end of the root"),
        (root(&[&member(1, "a", &[7])]), "neither a structure (.nbt), nor"),
        (root(&[&member(10, "Regions", &[0]), &member(3, "Version", &[0, 0, 0, 7])]), "Regions: none"),
        (schematic(-1, &[0], &stone), "a box of 281462092005375 cells; at most 8388608 are read"),
        (schematic(0, &[0], &stone), "Width: 0, expected 1 to 65535"),
        (versioned(4, 1, &[0], &stone), "Version: 4 of Sponge schematics in this form is not read"),
        (schematic(1, &[], &stone), "the data ends at cell 0 of the 1 cells"),
        (schematic(1, &[0, 0], &stone), "the data goes on after the 1 cells"),
        (schematic(1, &[0xff; 6], &stone), "cell 0: a number of more than five bytes"),
        (schematic(1, &[9], &stone), "cell 0: no number 9 in the palette"),
        (schematic(2, &[0; 8], &stone), "more than 7 blocks that are not air"),
        (schematic(1, &[0], &[("stone", 0), ("dirt", 0)]), "Palette: two blocks have the number 0"),
        (schematic(1, &[0], &[("sto ne", 0)]), "\"sto ne\" is no block state"),
        (schematic(1, &[0], &[("a[b", 0)]), "\"a[b\" is no block state"),
        (schematic(1, &[0], &[("stone/Brick", 0)]), "is no block state"),
        (root(&[&member(7, "Blocks", &[0; 4]), &member(8, "Materials", &[0, 0])]), "a schematic of MCEdit"),
    ] {
        let found = read(&file, 7).map(|(format, build)| format!("{format:?} {build:?}"));
        let told = found.clone().unwrap_err().to_string();
        assert!(told.contains(reason), "expected {reason}, found {told}");
    }
    let far = Build::of([([0; 3], "stone".to_owned()), ([60_000, 0, 60_000], "stone".to_owned())]);
    assert!(write(FileFormat::Schem, &far).unwrap_err().to_string().contains("nbt lists only blocks"));
    assert_eq!(read(&write(FileFormat::Nbt, &far).unwrap(), 7).unwrap().1.blocks.len(), 2);
}

//! NBT, the binary format of the game's files: unpacking with limits, and packing.

use std::io::{Read as _, Write as _};

use flate2::read::MultiGzDecoder;
use flate2::{Compression, GzBuilder};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{FileError, FileResult, MAX_BYTES, MAX_DEPTH, MAX_TEXTS, MAX_VALUES};

/// First bytes of data packed with gzip.
const GZIP: [u8; 2] = [0x1f, 0x8b];
/// Members of the root whose names are kept: files of builds have about ten.
const MAX_MEMBERS: usize = 64;

/// Tag of a compound.
const COMPOUND: u8 = 10;

/// Unpacked NBT.
pub struct Unpacked {
    pub bytes: Vec<u8>,
    /// Names of the members of the root.
    pub members: Vec<String>,
}

/// Unpacks a file and checks that it is NBT whose depth and size are within the limits, so that it can be read safely.
pub fn unpack(bytes: &[u8]) -> FileResult<Unpacked> {
    if bytes.is_empty() {
        return Err(FileError::new("the file is empty"));
    }
    let unpacked = if bytes.starts_with(&GZIP) {
        let mut unpacked = Vec::new();
        MultiGzDecoder::new(bytes)
            .take(MAX_BYTES + 1)
            .read_to_end(&mut unpacked)
            .map_err(|error| FileError::new(format!("damaged gzip data: {error}")))?;
        unpacked
    } else {
        bytes.to_vec()
    };
    if unpacked.len() as u64 > MAX_BYTES {
        return Err(FileError::new(format!("more than {MAX_BYTES} bytes unpacked")));
    }
    let members = Scan { bytes: &unpacked, at: 0, left: MAX_VALUES, texts: MAX_TEXTS }.check()?;
    Ok(Unpacked { bytes: unpacked, members })
}

/// Recognises files of other formats that are sent by mistake, and says what to send.
fn other_format(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0x78, 0x01 | 0x5e | 0x9c | 0xda, ..] => Some("data packed with zlib; send it with gzip or unpacked"),
        [b'P', b'K', 3 | 5, 4 | 6, ..] => Some("a ZIP archive; send the structure file that is in it"),
        [b'{' | b'[', ..] => Some("text instead of NBT; a block log in JSON belongs into \"events\" or \"rows\""),
        // An integer `format_version`, the length of whose name has its low byte first.
        [10, 0, 0, 3, 14, 0, ..] => {
            Some("a structure of Bedrock Edition (.mcstructure); convert it for Java Edition, for example with Amulet")
        }
        _ => None,
    }
}

/// Reads data that [`unpack`] has checked.
pub fn parse<T: DeserializeOwned>(unpacked: &[u8]) -> FileResult<T> {
    fastnbt::from_bytes(unpacked).map_err(|error| FileError::new(format!("not of the expected form: {error}")))
}

/// Packs a value as NBT under gzip, without a time, so that the bytes depend only on the value.
pub fn pack(value: &impl Serialize) -> FileResult<Vec<u8>> {
    let unpacked = fastnbt::to_bytes(value).map_err(|error| FileError::new(error.to_string()))?;
    let mut packed = GzBuilder::new().mtime(0).write(Vec::new(), Compression::default());
    packed.write_all(&unpacked).and_then(|()| packed.finish()).map_err(|error| FileError::new(error.to_string()))
}

/// Pass over raw NBT that neither recurses nor allocates by numbers in the data. The reader of NBT does both.
struct Scan<'a> {
    bytes: &'a [u8],
    at: usize,
    left: usize,
    /// Texts that are left.
    texts: usize,
}

/// A compound or list that is not finished.
enum Open {
    /// How many members it may still have.
    Compound(usize),
    /// Tag of the elements, and how many are left.
    List(u8, usize),
}

impl Scan<'_> {
    /// Checks all of the data; returns the names of the members of the root.
    fn check(mut self) -> FileResult<Vec<String>> {
        if let Some(remedy) = other_format(self.bytes) {
            return Err(FileError::new(remedy));
        }
        if self.byte()? != COMPOUND {
            return Err(FileError::new("not NBT: it does not begin with a compound"));
        }
        self.text()?;
        let mut members = Vec::new();
        let mut open = vec![Open::Compound(MAX_TEXTS)];
        while let depth = open.len()
            && let Some(innermost) = open.last_mut()
        {
            let tag = match innermost {
                Open::List(_, 0) => {
                    open.pop();
                    continue;
                }
                Open::List(tag, left) => {
                    *left -= 1;
                    *tag
                }
                Open::Compound(members_left) => match self.byte()? {
                    0 => {
                        open.pop();
                        continue;
                    }
                    tag => {
                        *members_left = members_left.checked_sub(1).ok_or_else(too_many_texts)?;
                        let name = self.text()?;
                        if depth == 1 && members.len() < MAX_MEMBERS {
                            members.push(String::from_utf8_lossy(name).into_owned());
                        }
                        tag
                    }
                },
            };
            self.left = self.left.checked_sub(1).ok_or_else(too_many)?;
            open.extend(self.value(tag)?);
            if open.len() > MAX_DEPTH {
                return Err(self.fault(&format!("nested deeper than {MAX_DEPTH} levels")));
            }
        }
        if self.at < self.bytes.len() {
            return Err(self.fault("bytes after the end of the root"));
        }
        Ok(members)
    }

    /// Passes over a value of a tag; a compound or list is returned, and its contents are still to come.
    fn value(&mut self, tag: u8) -> FileResult<Option<Open>> {
        let bytes = match tag {
            1 => 1,
            2 => 2,
            3 | 5 => 4,
            4 | 6 => 8,
            7 => self.length()?,
            8 => {
                self.texts = self.texts.checked_sub(1).ok_or_else(too_many_texts)?;
                self.text()?;
                0
            }
            9 => {
                let (tag, length) = (self.byte()?, self.length()?);
                if tag == 0 && length > 0 {
                    return Err(self.fault("a list without a type that has elements"));
                }
                if length > self.left {
                    return Err(too_many());
                }
                return Ok(Some(Open::List(tag, length)));
            }
            COMPOUND => return Ok(Some(Open::Compound(MAX_TEXTS))),
            11 => self.length()?.saturating_mul(4),
            12 => self.length()?.saturating_mul(8),
            tag => return Err(self.fault(&format!("there is no tag {tag}"))),
        };
        self.skip(bytes)?;
        Ok(None)
    }

    fn skip(&mut self, count: usize) -> FileResult<&[u8]> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or_else(|| self.fault("the data ends in the middle of a value"))?;
        let passed = &self.bytes[self.at..end];
        self.at = end;
        Ok(passed)
    }

    fn byte(&mut self) -> FileResult<u8> {
        Ok(self.skip(1)?[0])
    }

    fn text(&mut self) -> FileResult<&[u8]> {
        let length = self.skip(2)?;
        let length = u16::from_be_bytes([length[0], length[1]]);
        self.skip(length.into())
    }

    fn length(&mut self) -> FileResult<usize> {
        let length = self.skip(4)?;
        let length = i32::from_be_bytes([length[0], length[1], length[2], length[3]]);
        usize::try_from(length).map_err(|_| self.fault("a negative length"))
    }

    fn fault(&self, what: &str) -> FileError {
        FileError::new(format!("not NBT: {what}, at byte {}", self.at))
    }
}

fn too_many_texts() -> FileError {
    FileError::new(format!("more than {MAX_TEXTS} texts, or members of one compound"))
}

fn too_many() -> FileError {
    FileError::new(format!("more than {MAX_VALUES} values"))
}

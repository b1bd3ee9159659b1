//! Checksums beside backups and exports, in the format of `sha256sum`: they tell a byte that changed on the way.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::Path;

use anyhow::{Context as _, bail};
use sha2::{Digest as _, Sha256};

use plumbline_engine::tasks::hex;

/// Returns the line of `sha256sum` for a file, under its name in its folder.
///
/// # Errors
/// Returns an error if the file cannot be read.
pub fn line(file: &Path) -> anyhow::Result<String> {
    Ok(format!("{}  {}\n", sha256(file)?, name(file)))
}

/// Writes checksums durably to a file that must not exist.
///
/// # Errors
/// Returns an error if the file exists or cannot be written.
pub fn write(to: &Path, lines: &str) -> anyhow::Result<()> {
    let write = || -> std::io::Result<()> {
        let mut file = File::create_new(to)?;
        file.write_all(lines.as_bytes())?;
        file.sync_all()
    };
    write().with_context(|| format!("cannot write {}", to.display()))
}

/// Compares files with the checksums beside them, by their names.
///
/// # Errors
/// Returns an error if the checksums cannot be read, name another file or lack one, or a file has other bytes.
pub fn verify(checksums: &Path, files: &[&Path]) -> anyhow::Result<()> {
    let sums = std::fs::read_to_string(checksums).with_context(|| checksums.display().to_string())?;
    for file in files {
        // The only file may have been renamed, with its checksum.
        let is_only = files.len() == 1 && sums.lines().count() == 1;
        let of_file = |line: &&str| line.split_once("  ").is_some_and(|(_, named)| is_only || named == name(file));
        let Some((wanted, _)) = sums.lines().find(of_file).and_then(|line| line.split_once("  ")) else {
            bail!("{} has no checksum of {}", checksums.display(), file.display());
        };
        let found = sha256(file)?;
        if found != wanted {
            bail!(
                "{} was changed or cut off: its SHA-256 is {found}, and {} has {wanted}. Take another copy; if you \
                 changed it on purpose, delete that file",
                file.display(),
                checksums.display()
            );
        }
    }
    Ok(())
}

/// Returns the SHA-256 of a file in hex.
fn sha256(file: &Path) -> anyhow::Result<String> {
    let place = || file.display().to_string();
    let mut reading = File::open(file).with_context(place)?;
    let (mut hash, mut part) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match reading.read(&mut part).with_context(place)? {
            0 => return Ok(hex(&hash.finalize())),
            bytes => hash.update(&part[..bytes]),
        }
    }
}

fn name(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_byte_is_told_and_a_new_name_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let (file, sums) = (folder.path().join("b.db"), folder.path().join("b.db.sha256"));
        std::fs::write(&file, b"abc").unwrap();
        let told = line(&file).unwrap();
        assert_eq!(told, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  b.db\n");
        write(&sums, &told).unwrap();
        verify(&sums, &[&file]).unwrap();
        assert!(write(&sums, &told).is_err(), "it is there");
        std::fs::write(&file, b"abd").unwrap();
        assert!(verify(&sums, &[&file]).unwrap_err().to_string().contains("was changed or cut off"));
        let other = folder.path().join("c.db");
        std::fs::write(&other, b"abc").unwrap();
        verify(&sums, &[&other]).unwrap();
        assert!(verify(&sums, &[&other, &file]).unwrap_err().to_string().contains("has no checksum of"));
    }
}

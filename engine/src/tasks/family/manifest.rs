//! The suite file, which lists the families of a suite in order, and its versions.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::{Family, faults, template};
use crate::tasks::published::{TaskFile, TaskFileFault};
use crate::tasks::{Suite, Task};
use crate::voxel::Reading;

/// Name of the suite file in the folder of a suite.
pub const MANIFEST: &str = "suite.toml";

/// A version of a suite.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Version {
    /// Number of the version.
    pub number: u32,
    /// Description of the version.
    pub description: String,
    /// How the blocks of a log are read before they are checked.
    #[serde(default)]
    pub reading: Reading,
}

/// The Lite draw that the suite file lists.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lite {
    /// Seed of the draw.
    pub seed: u64,
    /// Ids of the tasks drawn, one per family.
    pub tasks: Vec<String>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    name: String,
    versions: Vec<Version>,
    families: Vec<String>,
    #[serde(default)]
    words: BTreeMap<String, String>,
    #[serde(default)]
    lite: Lite,
    #[serde(default)]
    preamble: Option<String>,
    #[serde(default)]
    every_check_is_asked_for: bool,
}

/// A suite as read from its files.
#[derive(Debug, Clone)]
pub struct SuiteSource {
    /// Name without the version.
    pub name: String,
    /// Versions, in the order of the suite file.
    pub versions: Vec<Version>,
    /// Families, in the order of the suite file.
    pub families: Vec<Family>,
    /// Phrases that all prompts can use as variables.
    pub words: BTreeMap<String, String>,
    /// Lite draw that the suite file lists.
    pub lite: Lite,
    /// Template of the conventions that prompts of the track `brief` take for granted.
    pub preamble: Option<String>,
    /// Whether a check that no phrase of the prompts asks for is a fault.
    pub every_check_is_asked_for: bool,
}

/// What a version of a suite gives to all its families.
#[derive(Debug, Clone)]
pub struct Edition<'a> {
    /// Number of the version.
    pub version: u32,
    /// How the blocks of a log are read before they are checked.
    pub reading: Reading,
    /// Phrases that all prompts can use as variables.
    pub words: &'a BTreeMap<String, String>,
    /// Conventions that prompts of the track `brief` take for granted.
    pub preamble: Option<String>,
    /// Whether a check that no phrase of the prompts asks for is a fault.
    pub every_check_is_asked_for: bool,
}

impl SuiteSource {
    /// Reads the files of a folder: `suite.toml`, and `NAME.toml` for each family that it lists.
    ///
    /// # Errors
    /// Returns all faults: unreadable files, families without a file, and files of families that are not listed.
    pub fn read(files: &[TaskFile<'_>]) -> Result<Self, Vec<TaskFileFault>> {
        let Some(manifest) = files.iter().find(|file| file.name == MANIFEST) else {
            return Err(vec![faults::of_file(MANIFEST, "there is no such file")]);
        };
        let manifest: Manifest =
            toml::from_str(manifest.text).map_err(|error| vec![faults::of_toml(MANIFEST, manifest.text, &error)])?;
        let mut families = Vec::new();
        let mut found = Vec::new();
        for name in &manifest.families {
            let file_name = format!("{name}.toml");
            match files.iter().find(|file| file.name == file_name) {
                None => found.push(faults::of_file(MANIFEST, format!("families: there is no file {file_name}"))),
                Some(file) => match Family::read(file.name, file.text) {
                    Err(fault) => found.push(fault),
                    Ok(family) if family.name() != name => {
                        found.push(faults::of_file(
                            file.name,
                            format!("family: expected {name:?}, the name of the file"),
                        ));
                    }
                    Ok(family) => families.push(family),
                },
            }
        }
        for file in files.iter().filter(|file| file.name != MANIFEST) {
            if !manifest.families.iter().any(|name| file.name.strip_suffix(".toml") == Some(name)) {
                found.push(faults::of_file(file.name, format!("{MANIFEST} does not list this family")));
            }
        }
        if manifest.versions.is_empty() {
            found.push(faults::of_file(MANIFEST, "versions: the list is empty"));
        }
        if !found.is_empty() {
            return Err(found);
        }
        let Manifest { name, versions, words, lite, preamble, every_check_is_asked_for, .. } = manifest;
        Ok(Self { name, versions, families, words, lite, preamble, every_check_is_asked_for })
    }

    /// Returns what a version gives to all families.
    ///
    /// # Errors
    /// Returns a fault if there is no such version, or the preamble cannot be rendered.
    pub fn edition(&self, version: u32) -> Result<Edition<'_>, Vec<TaskFileFault>> {
        let of_manifest = |detail: String| vec![faults::of_file(MANIFEST, detail)];
        let found = self.versions.iter().find(|known| known.number == version);
        let found = found.ok_or_else(|| of_manifest(format!("versions: there is no version {version}")))?;
        let preamble = self.preamble.as_ref().map(|text| template::rendered(text, &self.words));
        let preamble = preamble.transpose().map_err(|why| of_manifest(format!("preamble: {why}")))?;
        Ok(Edition {
            version,
            reading: found.reading,
            words: &self.words,
            preamble,
            every_check_is_asked_for: self.every_check_is_asked_for,
        })
    }

    /// Expands all tasks of a version, numbered from 1 in the order of families, items and wordings.
    ///
    /// # Errors
    /// Returns all faults of all families, and ids that occur twice.
    pub fn suite(&self, version: u32) -> Result<Suite, Vec<TaskFileFault>> {
        let edition = self.edition(version)?;
        let mut tasks: Vec<Task> = Vec::new();
        let mut found = Vec::new();
        for family in &self.families {
            match family.tasks(&family.items(), &edition) {
                Ok(more) => tasks.extend(more),
                Err(faults) => found.extend(faults),
            }
        }
        for (number, task) in (1..).zip(&mut tasks) {
            task.number = number;
        }
        let mut ids: Vec<&str> = tasks.iter().map(|task| task.id.as_str()).collect();
        ids.sort_unstable();
        for twice in ids.windows(2).filter(|pair| pair[0] == pair[1]) {
            let family = twice[0].split('/').next().unwrap_or_default();
            found.push(faults::of_file(&format!("{family}.toml"), format!("instance: {:?} occurs twice", twice[0])));
        }
        if found.is_empty() {
            Ok(Suite { name: self.name.clone(), version, preamble: edition.preamble, tasks })
        } else {
            Err(found)
        }
    }

    /// Finds a family by its name.
    #[must_use]
    pub fn family(&self, name: &str) -> Option<&Family> {
        self.families.iter().find(|family| family.name() == name)
    }
}

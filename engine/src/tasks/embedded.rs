//! The public suites, embedded in the binary from `tasks/mineceraft/`, `tasks/mineceraft-3/` and
//! `tasks/mineceraft-4/` at build time.

use std::borrow::Cow;

use rust_embed::RustEmbed;

use super::family::SuiteSource;
use super::lite::draw;
use super::published::{TaskFile, TaskFileFault};
use super::{Suite, Task};

/// Name of the full suite.
pub const FULL: &str = "mineceraft";
/// Suffix that a Lite draw adds to the name of its suite.
pub const LITE_SUFFIX: &str = "-lite";
/// Seed of the published Lite draw, which `suite.toml` lists.
pub const LITE_SEED: u64 = 42;
/// Version of the full suite that has the published rules only.
pub const PUBLISHED_VERSION: u32 = 1;

/// Identifier and content hash of each of the [`suites`], in their order. Stored suites never change: a test computes the
/// hashes, and a service expands the files only where its database lacks one.
pub const CONTENTS: [(&str, &str); 8] = [
    ("mineceraft-lite@1", "832dc71b055b6096f622ca486d4c145b9fdaf3a599a959d24d5ca9789fa93cfc"),
    ("mineceraft@1", "0dc81177a2b3abfffd5eb47bc0bf6c006d85b46c0ae6fac7269bc758ba3c0bec"),
    ("mineceraft-lite@2", "bf2a5765579504a01a5191a46fe57b2e5da0f1468e2b06647a1b6cffd869c6b9"),
    ("mineceraft@2", "873fbb8077100ae321692062167893ab3dd386c23322a65e2d05b1a10ff34019"),
    ("mineceraft-lite@3", "cf7066063a2433f889c61d05cb0c600026efce34d92555e7d491939d1f0b1765"),
    ("mineceraft@3", "b3db7314e1a865b1cd2f5d730ca821d8515f43921e554ff59cafb51cc2ece6e1"),
    ("mineceraft-lite@4", "bcb1c33dbe8d94e5b164f8d945bb7e193adc4ae9b96c6995224c5c570f5cd74c"),
    ("mineceraft@4", "7e6dd72800c60f55f1a3536a5a3ab06ce234e349e57f57cdce359820dfe11deb"),
];

/// Versions 1 and 2.
#[derive(RustEmbed)]
#[folder = "../tasks/mineceraft/"]
struct FirstFiles;

/// Version 3.
#[derive(RustEmbed)]
#[folder = "../tasks/mineceraft-3/"]
struct ThirdFiles;

/// Version 4.
#[derive(RustEmbed)]
#[folder = "../tasks/mineceraft-4/"]
struct FourthFiles;

/// Reads the embedded files of all versions of the full suite, the oldest first.
///
/// # Errors
/// Returns the faults of the files; a test shows that there are none.
pub fn sources() -> Result<[SuiteSource; 3], Vec<TaskFileFault>> {
    Ok([read_source::<FirstFiles>()?, read_source::<ThirdFiles>()?, read_source::<FourthFiles>()?])
}

/// Reads the embedded files that have this version of the full suite. For an unknown version, reads the latest files, whose
/// [`SuiteSource::suite`] returns the fault.
///
/// # Errors
/// Returns the faults of the files; a test shows that there are none.
pub fn source_of(version: u32) -> Result<SuiteSource, Vec<TaskFileFault>> {
    let [first, third, fourth] = sources()?;
    let has = |source: &SuiteSource| source.versions.iter().any(|known| known.number == version);
    Ok(if has(&first) {
        first
    } else if has(&third) {
        third
    } else {
        fourth
    })
}

/// Reads the embedded TOML files of a folder of families.
pub(super) fn read_source<F: RustEmbed>() -> Result<SuiteSource, Vec<TaskFileFault>> {
    let files: Vec<(Cow<'_, str>, Cow<'_, [u8]>)> = F::iter()
        .filter(|name| name.ends_with(".toml"))
        .filter_map(|name| F::get(&name).map(|file| (name, file.data)))
        .collect();
    let texts: Vec<TaskFile<'_>> = files
        .iter()
        .map(|(name, data)| TaskFile { name, text: std::str::from_utf8(data).unwrap_or_default() })
        .collect();
    SuiteSource::read(&texts)
}

/// Returns a version of the full suite, which has 723 tasks in 25 families.
///
/// # Errors
/// Returns the faults of the files; a test shows that there are none.
pub fn suite(version: u32) -> Result<Suite, Vec<TaskFileFault>> {
    source_of(version)?.suite(version)
}

/// Returns every version of the full suite, each preceded by its Lite draw with [`LITE_SEED`].
///
/// # Errors
/// Returns the faults of the files; a test shows that there are none.
pub fn suites() -> Result<Vec<Suite>, Vec<TaskFileFault>> {
    let mut suites = Vec::new();
    for source in sources()? {
        for version in &source.versions {
            let full = source.suite(version.number)?;
            suites.push(lite(&full, LITE_SEED));
            suites.push(full);
        }
    }
    Ok(suites)
}

/// Returns the latest version of the full suite, which new runs use if they name none.
///
/// # Errors
/// Returns the faults of the files; a test shows that there are none.
pub fn latest() -> Result<Suite, Vec<TaskFileFault>> {
    let [.., later] = sources()?;
    later.suite(later.versions.iter().map(|version| version.number).max().unwrap_or(PUBLISHED_VERSION))
}

/// Draws the Lite subset of a suite, one task per family, with a seed. Tasks keep their ids and numbers.
#[must_use]
pub fn lite(full: &Suite, seed: u64) -> Suite {
    let tasks: Vec<Task> = draw(full, seed).into_iter().cloned().collect();
    let name = format!("{}{LITE_SUFFIX}", full.name);
    Suite { name, version: full.version, preamble: full.preamble.clone(), tasks }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::checks::{Criterion, Dimension};
    use crate::voxel::Reading;

    fn tasks_by_criterion(suite: &Suite) -> ([usize; 7], usize) {
        let having = |wanted: &dyn Fn(Criterion) -> bool| {
            suite.tasks.iter().filter(|task| task.criteria().into_iter().any(wanted)).count()
        };
        let counts = Criterion::ALL.map(|criterion| having(&|c| c == criterion));
        (counts, having(&|c| c.dimension() == Dimension::Accuracy))
    }

    #[test]
    fn the_first_version_has_the_published_counts() {
        let suite = suite(PUBLISHED_VERSION).unwrap();
        assert_eq!((suite.tasks.len(), suite.instruction_count(), suite.check_count()), (723, 747, 3_530));
        assert_eq!(tasks_by_criterion(&suite), ([455, 563, 369, 723, 21, 112, 156], 699));
    }

    /// Version 2 also checks the size of foundations, walls and theatres, and rooms of plans and creative buildings.
    #[test]
    fn the_second_version_adds_checks_and_no_tasks() {
        let (first, second) = (suite(1).unwrap(), suite(2).unwrap());
        assert_eq!((second.tasks.len(), second.instruction_count(), second.check_count()), (723, 747, SECOND_CHECKS));
        assert_eq!(tasks_by_criterion(&second), ([455, 590, 369, 723, 21, 112, 156], 723));
        for (a, b) in first.tasks.iter().zip(&second.tasks) {
            assert_eq!((&a.id, a.number, &a.parameters), (&b.id, b.number, &b.parameters));
        }
    }

    /// Version 3 has the same tasks, each in two wordings, and other checks.
    #[test]
    fn the_third_version_asks_anew_for_the_same_tasks() {
        let (second, third) = (suite(2).unwrap(), suite(3).unwrap());
        assert_eq!((third.tasks.len(), third.instruction_count(), third.check_count()), (723, 747, THIRD_CHECKS));
        let preamble = third.preamble.as_ref().unwrap();
        assert!(preamble.contains("A door is one object") && preamble.len() > 500, "{preamble}");
        for (a, b) in second.tasks.iter().zip(&third.tasks) {
            assert_eq!((&a.id, a.number, a.turns.len()), (&b.id, b.number, b.turns.len()));
            assert!(b.turns.iter().all(|turn| turn.brief.is_some()), "{}", b.id);
            assert!(b.reading == Reading::Game && a.reading == Reading::AsListed);
        }
    }

    const THIRD_CHECKS: usize = 6_412;

    /// Version 4 has the tasks of version 3 with other checks, and words that ask for them.
    #[test]
    fn the_fourth_version_has_the_tasks_of_the_third() {
        let (third, fourth) = (suite(3).unwrap(), suite(4).unwrap());
        assert_eq!((fourth.tasks.len(), fourth.instruction_count(), fourth.check_count()), (723, 747, FOURTH_CHECKS));
        for (a, b) in third.tasks.iter().zip(&fourth.tasks) {
            assert_eq!((&a.id, a.number, &a.parameters), (&b.id, b.number, &b.parameters));
        }
        let same = third.tasks.iter().zip(&fourth.tasks).filter(|(a, b)| a.turns == b.turns).count();
        assert_eq!(same, 112, "walls and foundations");
    }

    const FOURTH_CHECKS: usize = 5_843;

    #[test]
    fn every_suite_is_as_it_was() {
        let found: Vec<(String, String)> = suites().unwrap().iter().map(|own| (own.id(), own.content_hash())).collect();
        let known = CONTENTS.map(|(id, hash)| (id.to_owned(), hash.to_owned()));
        assert_eq!(found, known, "a stored suite never changes: what is new needs a new version, and its hash here");
    }

    /// 64 foundations, 48 walls, 9 theatres, 6 creative buildings and 48 plans have one more check each. For 45
    /// arches two published checks become informational, and one of our own replaces them.
    const SECOND_CHECKS: usize = 3_530 + 64 + 48 + 9 + 6 + 48 - 45;

    #[test]
    fn types_and_categories_have_the_published_counts() {
        let suite = latest().unwrap();
        let mut types: BTreeMap<String, usize> = BTreeMap::new();
        let mut categories = BTreeMap::new();
        for task in &suite.tasks {
            *types.entry(task.kind.clone().unwrap()).or_default() += 1;
            *categories.entry(task.category.unwrap()).or_insert(0) += 1;
        }
        let expected = [
            ("accessibility", 33),
            ("arch-bridges", 45),
            ("basic-buildings", 21),
            ("bedrooms", 55),
            ("bridges", 36),
            ("columns", 12),
            ("creative-requests", 36),
            ("domes", 36),
            ("foundations", 112),
            ("frames", 54),
            ("multi-story", 8),
            ("multi-turn-revision", 15),
            ("resource-optimization", 12),
            ("rooms", 56),
            ("roofs", 96),
            ("single-turn-planning", 48),
            ("walls", 48),
        ];
        assert_eq!(types, expected.map(|(kind, tasks)| (kind.to_owned(), tasks)).into());
        assert_eq!(categories.into_values().collect::<Vec<_>>(), [322, 140, 69, 75, 117]);
    }

    #[test]
    fn the_lite_draw_is_the_published_one_and_the_one_that_is_kept() {
        let [source, others @ ..] = sources().unwrap();
        assert!(others.iter().all(|other| other.lite.tasks == source.lite.tasks));
        let lite = lite(&suite(1).unwrap(), LITE_SEED);
        let numbers: Vec<u32> = lite.tasks.iter().map(|task| task.number).collect();
        let published = [
            15, 66, 160, 196, 258, 264, 277, 326, 387, 447, 456, 481, 493, 497, 514, 533, 550, 575, 600, 606, 608, 651,
            664, 705, 719,
        ];
        assert_eq!(numbers, published);
        let ids: Vec<&str> = lite.tasks.iter().map(|task| task.id.as_str()).collect();
        assert_eq!((LITE_SEED, ids), (source.lite.seed, source.lite.tasks.iter().map(String::as_str).collect()));
    }

    #[test]
    fn prompts_are_whole_and_every_wording_is_its_own() {
        let mut first_prompts: BTreeMap<String, String> = BTreeMap::new();
        for task in suites().unwrap().iter().filter(|suite| suite.name == FULL).flat_map(|suite| &suite.tasks) {
            for turn in &task.turns {
                let prompt = &turn.prompt;
                assert!(prompt.ends_with('.') && prompt.len() > 60, "{}: {prompt}", task.id);
                assert!(!prompt.contains(['{', '}', '\n']) && !prompt.contains("  "), "{}: {prompt}", task.id);
                assert!(!prompt.contains(" ."), "{}: {prompt}", task.id);
            }
            if let Some(other) = first_prompts.insert(task.turns[0].prompt.clone(), task.id.clone()) {
                let same_start = task.family() == "revisions" && other.starts_with("revisions/");
                assert!(other == task.id || same_start, "{other} and {} are worded alike", task.id);
            }
        }
    }
}

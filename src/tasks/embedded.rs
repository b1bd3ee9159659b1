//! The suites inside the binary: the files of the `tasks/` folder at build time.

use std::borrow::Cow;

use rust_embed::RustEmbed;

use super::lite::{PUBLISHED_SEED, draw};
use super::published::{TaskFile, TaskFileFault, read_task_files};
use super::{Suite, Task};

/// Name of the full suite.
pub const FULL: &str = "mineceraft";
/// Name of the Lite suite with the published seed.
pub const LITE: &str = "mineceraft-lite";

#[derive(RustEmbed)]
#[folder = "tasks/mineceraft/"]
#[include = "*.json"]
struct Files;

/// The full suite: 723 tasks in 25 families.
///
/// # Errors
/// Faults of the files; a test shows that there are none.
pub fn full() -> Result<Suite, Vec<TaskFileFault>> {
    let files: Vec<(Cow<'_, str>, Cow<'_, [u8]>)> =
        Files::iter().filter_map(|name| Files::get(&name).map(|file| (name, file.data))).collect();
    let texts: Vec<TaskFile<'_>> = files
        .iter()
        .map(|(name, data)| TaskFile { name, text: std::str::from_utf8(data).unwrap_or_default() })
        .collect();
    Ok(Suite { name: FULL.to_owned(), version: 1, tasks: read_task_files(&texts)? })
}

/// The Lite subset of a suite: one task per family, drawn with the published seed; tasks keep id and number.
#[must_use]
pub fn lite(full: &Suite) -> Suite {
    let tasks: Vec<Task> = draw(full, PUBLISHED_SEED).into_iter().cloned().collect();
    Suite { name: LITE.to_owned(), version: full.version, tasks }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checks::{Criterion, Dimension};

    #[test]
    fn the_full_suite_has_the_published_counts() {
        let suite = full().unwrap();
        assert_eq!((suite.tasks.len(), suite.instruction_count(), suite.check_count()), (723, 747, 3_530));
        let having = |wanted: &dyn Fn(Criterion) -> bool| {
            suite.tasks.iter().filter(|task| task.criteria().into_iter().any(wanted)).count()
        };
        let counts = Criterion::ALL.map(|criterion| having(&|c| c == criterion));
        assert_eq!(counts, [455, 563, 369, 723, 21, 112, 156]);
        assert_eq!(having(&|c| c.dimension() == Dimension::Accuracy), 699);
    }

    #[test]
    fn the_lite_suite_is_the_published_draw() {
        let numbers: Vec<u32> = lite(&full().unwrap()).tasks.iter().map(|task| task.number).collect();
        let published = [
            15, 66, 160, 196, 258, 264, 277, 326, 387, 447, 456, 481, 493, 497, 514, 533, 550, 575, 600, 606, 608, 651,
            664, 705, 719,
        ];
        assert_eq!(numbers, published);
    }
}

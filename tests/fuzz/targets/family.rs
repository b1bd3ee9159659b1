//! Family files: they are refused with a place, or give tasks.

use std::collections::BTreeMap;

use plumbline_engine::tasks::Task;
use plumbline_engine::tasks::family::{Family, SuiteSource};
use plumbline_engine::tasks::published::TaskFile;
use toml::Spanned;

/// Greatest number of items. A file may list as many as its author waits for.
const MAX: usize = 64;

pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let Ok(family) = Family::read("a.toml", text) else { return };
    let items = |grid: &BTreeMap<_, Spanned<Vec<_>>>| grid.values().map(|values| values.get_ref().len()).product();
    if family.content.grid.iter().map(items).fold(0, usize::saturating_add) > MAX {
        return;
    }
    let manifest = include_str!("../../../tasks/mineceraft-4/suite.toml");
    let (before, rest) = manifest.split_once("families = [").expect("the suite has families");
    let (_, after) = rest.split_once(']').expect("the list ends");
    let (words, _) = after.split_once("[lite]").expect("the suite has a Lite draw");
    let manifest = format!("{before}families = [{:?}]{words}", family.name());
    let name = format!("{}.toml", family.name());
    let files = [TaskFile { name: "suite.toml", text: &manifest }, TaskFile { name: &name, text }];
    let Ok(source) = SuiteSource::read(&files) else { return };
    if let Ok(suite) = source.suite(4) {
        // A task is read back as it was written.
        for task in &suite.tasks {
            let text = serde_json::to_string(task).expect("a task is JSON");
            let read: Task = serde_json::from_str(&text).expect("a task of the engine is one");
            assert_eq!(read.content_hash(), task.content_hash(), "{text}");
        }
    }
}

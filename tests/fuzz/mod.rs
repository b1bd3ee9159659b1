//! Fuzz targets, and their corpora as tests: what a fuzzer found once stays found. `tests/fuzz/run` fuzzes.

mod targets;

use crate::support::repository;

#[test]
fn every_corpus_passes_its_target() {
    for (name, run) in targets::ALL {
        let folder = repository("tests/fuzz/corpus").join(name);
        let entries = std::fs::read_dir(&folder).unwrap_or_else(|_| panic!("{name} has no corpus"));
        let mut passed = 0;
        for entry in entries {
            let path = entry.unwrap().path();
            let data = std::fs::read(&path).unwrap();
            let outcome = std::panic::catch_unwind(|| run(&data));
            assert!(outcome.is_ok(), "{}", path.display());
            passed += 1;
        }
        assert!(passed > 0, "the corpus of {name} is empty");
    }
}

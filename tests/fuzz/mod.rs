//! Fuzz targets, and their corpora as tests: what a fuzzer found once stays found. `tests/fuzz/run` fuzzes.

mod targets;

use rand_mt::Mt64;

use crate::support::repository;

/// How many random inputs of each length a target takes in an ordinary run.
const RANDOM: usize = 200;

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

/// How many builds of chance each check scores in an ordinary run.
const BUILDS: u64 = 300;

/// Random inputs, the same in each run: they find some of what a fuzzer finds by searching.
#[test]
fn every_target_withstands_random_bytes() {
    let mut random = Mt64::new(24);
    for (name, run) in targets::ALL {
        for length in [20, 100, 300, 1_000] {
            for _ in 0..RANDOM {
                let data: Vec<u8> = (0..length).map(|_| (random.next_u64() >> 56) as u8).collect();
                let outcome = std::panic::catch_unwind(|| run(&data));
                assert!(outcome.is_ok(), "{name}: {data:?}");
            }
        }
    }
}

#[test]
fn every_check_has_a_twin() {
    targets::check::every_check_has_a_twin();
}

#[test]
fn every_check_scores_what_its_twin_does() {
    let bytes = |seed| {
        let mut random = Mt64::new(seed);
        (0..100 + random.next_u64() % 300).map(|_| (random.next_u64() >> 56) as u8).collect()
    };
    targets::check::run_each(&(0..BUILDS).map(bytes));
}

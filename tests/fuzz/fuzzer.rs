//! A fuzzer of the target that `FUZZED` names: one program for all, because building it takes minutes.

#![no_main]

mod targets;

use std::sync::LazyLock;

static TARGET: LazyLock<targets::Target> = LazyLock::new(|| {
    let name = std::env::var("FUZZED").expect("FUZZED names a target");
    let found = targets::ALL.iter().find(|(target, _)| *target == name);
    found.expect("FUZZED names a target of tests/fuzz/targets").1
});

libfuzzer_sys::fuzz_target!(|data: &[u8]| TARGET(data));

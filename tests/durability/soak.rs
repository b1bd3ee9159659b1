//! Mixed load with faults at random, for as long as is wished: nothing acknowledged is lost, nothing sticks, equal
//! requests have equal answers, and no process, file descriptor or memory is left behind.
//!
//! An ordinary run takes some seconds. `PLUMBLINE_SOAK_SECONDS=3600` makes it an hour, `PLUMBLINE_SOAK_SEED` gives
//! another order of faults, and `PLUMBLINE_SOAK_PROGRAM` names another build. It prints a line for each round.

mod clients;

use std::process::Command;
use std::time::{Duration, Instant};

use crate::support::audit::audit_books;
use crate::support::place::Place;
use crate::support::{PROGRAM, Service};
use clients::{Heard, Round};

/// What a process of the service holds.
#[derive(Debug, Clone, Copy)]
struct Held {
    children: usize,
    descriptors: usize,
    memory_kib: usize,
}

impl Held {
    /// Waits until there are no more children than wait for code, at most ten seconds: code of those who hung up ends
    /// meanwhile.
    async fn at_rest(process: u32) -> Self {
        let begun = Instant::now();
        loop {
            let held = Self::by(process);
            if held.children <= waiting_children() && begun.elapsed() > Duration::from_millis(300)
                || begun.elapsed() > Duration::from_secs(10)
            {
                return held;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    fn by(process: u32) -> Self {
        let own = |name: &str| format!("/proc/{process}/{name}");
        let tasks = std::fs::read_dir(own("task")).unwrap().flatten();
        let children = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("children")).ok());
        let status = std::fs::read_to_string(own("status")).unwrap();
        let memory = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        Self {
            children: children.map(|line| line.split_whitespace().count()).sum(),
            descriptors: std::fs::read_dir(own("fd")).unwrap().count(),
            memory_kib: memory.split_whitespace().next().unwrap().parse().unwrap(),
        }
    }
}

/// Numbers that look random, the same from the same seed.
struct Chance(u64);

impl Chance {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (mixed ^ (mixed >> 27)) % bound
    }
}

/// Returns the greatest number of processes that wait for code when none runs: one for each core.
fn waiting_children() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

fn start(place: &Place) -> Service {
    let program = std::env::var_os("PLUMBLINE_SOAK_PROGRAM").unwrap_or_else(|| PROGRAM.into());
    place.start(Command::new(program), &["--lease-seconds", "2"])
}

fn setting(name: &str, usual: u64) -> u64 {
    std::env::var(name).map_or(usual, |value| value.parse().expect("a number"))
}

// The line to PostgreSQL passes bytes on while the test waits for the service.
#[tokio::test(flavor = "multi_thread")]
async fn mixed_load_with_faults() {
    let lasts = Duration::from_secs(setting("PLUMBLINE_SOAK_SECONDS", 12));
    let mut chance = Chance(setting("PLUMBLINE_SOAK_SEED", 24));
    let round_s = lasts.as_secs().div_ceil(4).min(20);
    let folder = tempfile::tempdir().unwrap();
    let place = Place::new(folder.path()).await;
    let (mut service, mut first) = (start(&place), None::<Held>);
    let (begun, mut books, mut lines) = (Instant::now(), Heard::default(), Vec::new());
    let mut rounds = 0_u64;
    while begun.elapsed() < lasts {
        let round = Round::new(&service, &place.key, rounds);
        // Each kill is in the middle of a fault.
        let is_killed = rounds == 1 || rounds > 1 && chance.below(12) == 0;
        let which = chance.below(u64::MAX);
        let course = async {
            tokio::time::sleep(Duration::from_millis(round_s * 500)).await;
            place.begin_fault(which);
            round.begin_fault();
            tokio::time::sleep(Duration::from_millis(round_s * 300)).await;
            if is_killed {
                service.signal("KILL");
            }
            tokio::time::sleep(Duration::from_millis(round_s * 100)).await;
            place.end_fault();
            tokio::time::sleep(Duration::from_millis(round_s * 100)).await;
            round.stop();
            place.name_of(which)
        };
        let (heard, fault) = tokio::join!(round.drive(), course);
        if is_killed {
            service.wait_for_end("killed").await;
            (service, first) = (start(&place), None);
        }
        service.settle(&fault).await;
        let held = Held::at_rest(service.process_id()).await;
        let line = heard.line();
        println!("{rounds:4} {fault}{} {line} {held:?}", if is_killed { ", killed" } else { "" });
        lines.push(heard.medians());
        books.add(heard);
        if !is_killed {
            compare(first.get_or_insert(held), held, &fault);
        }
        rounds += 1;
    }
    assert!(service.terminate());
    assert!(books.acknowledged.len() > 20 && books.graded > 20 && books.replayed > 2, "{}", books.line());
    assert!(rounds < 4 || books.refused > 0, "the faults were felt by nobody");
    println!("in all {}; by quarters of the time:", books.line());
    for quarter in lines.chunks(lines.len().div_ceil(4)) {
        println!("  {}", clients::middle(quarter));
    }
    audit_books(&place.pool().await, &books.acknowledged, "after the soak").await;
}

/// Asserts that a process holds no more than after its first round.
fn compare(first: &Held, now: Held, when: &str) {
    assert!(now.children <= waiting_children(), "{when}: children are left, {first:?}, {now:?}");
    assert!(now.descriptors <= first.descriptors + 40, "{when}: descriptors are left, {first:?}, {now:?}");
    assert!(now.memory_kib <= 2 * first.memory_kib + (96 << 10), "{when}: memory grows, {first:?}, {now:?}");
}

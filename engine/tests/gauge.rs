//! The contamination gauge, simulated with a fixed seed: an agent that knows the public list by heart, and one that
//! does not.
//! `cargo test --package plumbline-engine --test engine gauge -- --nocapture` prints the table in docs/hidden-evaluation.md.

use plumbline_engine::hidden::gauge::Gauge;
use rand_mt::Mt64;

/// Pairs of one run: the epoch's families, with their weights.
const PER_RUN: usize = 26;
/// Official entries simulated for each row.
const ENTRIES: usize = 20_000;

fn passes(random: &mut Mt64, probability: f64) -> bool {
    ((random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64) < probability
}

/// The gauge of an entry with so many runs. The agent solves families with rates that differ by up to 30 points around
/// `skill`, alike in public and in hidden; of the siblings it knows the share `memorised` by heart.
fn gauge(random: &mut Mt64, runs: usize, skill: f64, memorised: f64) -> Gauge {
    let pair = |i: usize, random: &mut Mt64| {
        let rate = (skill + 0.3 * (2.0 * (i % PER_RUN) as f64 / (PER_RUN - 1) as f64 - 1.0)).clamp(0.0, 1.0);
        let hidden = passes(random, rate);
        (passes(random, memorised) || passes(random, rate), hidden)
    };
    let pairs: Vec<(bool, bool)> = (0..runs * PER_RUN).map(|i| pair(i, random)).collect();
    Gauge::of_pairs(&pairs).expect("an entry has pairs")
}

/// Share of entries, in per cent, whose interval is above 0.
fn alarms(random: &mut Mt64, runs: usize, skill: f64, memorised: f64) -> f64 {
    let above = (0..ENTRIES).filter(|_| gauge(random, runs, skill, memorised).interval.low > 0.0).count();
    100.0 * above as f64 / ENTRIES as f64
}

#[test]
fn the_gauge_tells_an_agent_that_memorised_from_one_that_did_not() {
    let mut random = Mt64::new(20_261_123);
    let random = &mut random;
    println!("| agent, true score on hidden instances | one run, 26 pairs | four runs, 104 pairs |");
    println!("|---|---|---|");
    let mut rows = Vec::new();
    for skill in [0.3, 0.6] {
        for (name, memorised) in
            [("learned nothing by heart", 0.0), ("knows half of the list", 0.5), ("knows all of it", 1.0)]
        {
            let row = [1, 4].map(|runs| alarms(random, runs, skill, memorised));
            println!("| {name}, {:.0} % | {:.1} % | {:.1} % |", 100.0 * skill, row[0], row[1]);
            rows.push(row);
        }
    }
    let [clean_low, half_low, all_low, clean_high, _, all_high] = rows.try_into().expect("six rows");
    assert!(clean_low.iter().chain(&clean_high).all(|alarms| *alarms < 3.0), "false alarms");
    assert!(all_low[0] > 99.0 && all_high[0] > 90.0, "an agent that knows all is found in one run");
    assert!(half_low[1] > 90.0, "one that knows half, in four");
}

/// With rates that differ between families the interval has its 95 %.
#[test]
fn the_interval_of_the_gap_covers_it() {
    let mut random = Mt64::new(7);
    for (skill, memorised) in [(0.5, 0.0), (0.3, 0.5), (0.6, 0.3)] {
        let truth: f64 = (0..PER_RUN)
            .map(|i| {
                let rate: f64 = skill + 0.3 * (2.0 * i as f64 / (PER_RUN - 1) as f64 - 1.0);
                memorised * (1.0 - rate.clamp(0.0, 1.0))
            })
            .sum::<f64>()
            / PER_RUN as f64;
        let holds = |random: &mut Mt64| {
            let found = gauge(random, 1, skill, memorised).interval;
            (found.low..=found.high).contains(&truth)
        };
        let covered = (0..ENTRIES).filter(|_| holds(&mut random)).count();
        assert!(covered * 100 >= ENTRIES * 94, "{covered} of {ENTRIES} at {skill} and {memorised}");
    }
}

//! Gaming the boards: what the best of many entries, and a probing attack, gain on each tier. A simulation with a fixed
//! seed;
//! `cargo test --package plumbline-engine --test engine gaming -- --nocapture` prints the table in docs/hidden-evaluation.md.
//!
//! An agent passes an instance with a probability that is its true score; what a board shows beyond that is bias.

use plumbline_engine::grading::statistics::interval::anytime;
use plumbline_engine::hidden::ladder::{Attempt, Rung, Tally, climb};
use rand_mt::Mt64;

/// True share of instances that the agent passes.
const TRUTH: f64 = 0.6;
/// Instances of one run: the epoch's families, with their weights.
const PER_RUN: usize = 26;
/// Runs of a dev entry, as an attacker with patience registers them.
const DEV_RUNS: usize = 4;
/// Entries to the dev tier.
const QUERIES: usize = 400;
/// Official entries of one owner, and runs of each.
const OFFICIAL: (usize, usize) = (3, 4);
/// Tasks of the public suite.
const PUBLIC_TASKS: usize = 723;
/// Epochs simulated for each row; four times as many for the final board, 25 times for the official entries.
const EPOCHS: usize = 1_000;

fn passes(random: &mut Mt64, probability: f64) -> bool {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64 <= probability
}

fn sample(random: &mut Mt64, instances: usize, probability: f64) -> Vec<bool> {
    (0..instances).map(|_| passes(random, probability)).collect()
}

fn rate(outcomes: &[bool]) -> f64 {
    outcomes.iter().filter(|passes| **passes).count() as f64 / outcomes.len() as f64
}

/// An attempt whose instances have random ids, as the service gives them.
fn attempt<'a>(random: &mut Mt64, protocol: u32, configuration: &'a str, outcomes: &[bool]) -> Attempt<'a> {
    let named: Vec<(String, bool)> = outcomes.iter().map(|passes| (random.next_u64().to_string(), *passes)).collect();
    Attempt::of(protocol, configuration, named.iter().map(|(id, passes)| (id.as_str(), *passes)), 0)
}

/// What one tier shows in each epoch, minus the truth, in points.
fn bias(shown: &[f64]) -> (f64, f64) {
    let mean = shown.iter().sum::<f64>() / shown.len() as f64;
    let variance = shown.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / shown.len() as f64;
    (100.0 * (mean - TRUTH), 100.0 * variance.sqrt())
}

fn best(random: &mut Mt64, entries: usize, instances: usize) -> f64 {
    (0..entries).map(|_| rate(&sample(random, instances, TRUTH))).fold(0.0, f64::max)
}

/// What an attacker of the dev board waits for.
#[derive(Clone, Copy)]
enum Until {
    /// The end of all entries.
    TheEnd,
    /// That the board shows 5 points too much.
    Shown,
    /// That what is kept is 5 points too much: an entrant who grades its own answers, and subtracts what it is told,
    /// knows it.
    Kept,
}

/// The dev board after the attacker's entries, each of its own configuration, so that none are taken together: what is
/// shown then, and the final one, which is made of what was kept.
fn ladder(random: &mut Mt64, protocol: u32, until: Until) -> Rung {
    let names: Vec<String> = (0..QUERIES).map(|i| i.to_string()).collect();
    let mut attempts: Vec<Attempt<'_>> = Vec::new();
    for name in &names {
        let outcomes = sample(random, PER_RUN * DEV_RUNS, TRUTH);
        attempts.push(attempt(random, protocol, name, &outcomes));
        let rung = climb(protocol, &attempts).unwrap();
        let is_lucky = match until {
            Until::TheEnd => false,
            Until::Shown => rung.shown.rate() >= TRUTH + 0.05,
            Until::Kept => rung.kept.rate() >= TRUTH + 0.05,
        };
        if is_lucky {
            break;
        }
    }
    climb(protocol, &attempts).unwrap()
}

/// The attack of Blum and Hardt: of random answers those that score above chance are taken together by majority,
/// instance by instance. `is_fixed`: the same instances are asked again and again; else each entry has fresh ones. What
/// the attacker learns is the score. The truth of random answers is one half.
fn probe(random: &mut Mt64, is_fixed: bool) -> f64 {
    let instances = PER_RUN * DEV_RUNS;
    let mut labels = sample(random, instances, 0.5);
    let mut votes = vec![0_i32; instances];
    for _ in 0..QUERIES {
        let answers = sample(random, instances, 0.5);
        let right: Vec<bool> = answers.iter().zip(&labels).map(|(answer, label)| answer == label).collect();
        let sign = if rate(&right) > 0.5 { 1 } else { -1 };
        for (vote, answer) in votes.iter_mut().zip(&answers) {
            *vote += if *answer { sign } else { -sign };
        }
        if !is_fixed {
            labels = sample(random, instances, 0.5);
        }
    }
    rate(&votes.iter().zip(&labels).map(|(vote, label)| (*vote > 0) == *label).collect::<Vec<_>>())
}

#[test]
fn official_scores_are_true_and_the_ladder_resists_400_queries() {
    let mut random = Mt64::new(20_261_121);
    let random = &mut random;
    let rows: Vec<(&str, f64, f64)> = [
        (
            "open: best of 20 runs of the public suite",
            (0..EPOCHS).map(|_| best(random, 20, PUBLIC_TASKS)).collect::<Vec<_>>(),
        ),
        (
            "dev, had it no Ladder: best of 400 entries",
            (0..EPOCHS).map(|_| best(random, QUERIES, PER_RUN * DEV_RUNS)).collect(),
        ),
        (
            "dev before protocol 2: after 400 entries",
            (0..EPOCHS).map(|_| ladder(random, 1, Until::TheEnd).shown.rate()).collect(),
        ),
        (
            "dev before protocol 2: stopping when it shows 5 points too much",
            (0..EPOCHS).map(|_| ladder(random, 1, Until::Shown).shown.rate()).collect(),
        ),
        (
            "dev, while it is open: the same",
            (0..EPOCHS).map(|_| ladder(random, 2, Until::Shown).shown.rate()).collect(),
        ),
        ("dev, final board: the same", (0..4 * EPOCHS).map(|_| ladder(random, 2, Until::Shown).kept.rate()).collect()),
        (
            "dev, final board: stopping when what is kept is 5 points too much",
            (0..EPOCHS).map(|_| ladder(random, 2, Until::Kept).kept.rate()).collect(),
        ),
        ("official: three entries, taken together", (0..25 * EPOCHS).map(|_| official(random)).collect()),
        (
            "official: the best of four owners who are one lab under four names",
            (0..EPOCHS).map(|_| (0..4).map(|_| official(random)).fold(0.0, f64::max)).collect(),
        ),
        (
            "official, no beacon: entries of 1, 5 and 10 runs, stopping once it is above the truth",
            (0..25 * EPOCHS).map(|_| official_until_lucky(random)).collect(),
        ),
    ]
    .into_iter()
    .map(|(name, shown)| {
        let (bias, spread) = bias(&shown);
        (name, bias, spread)
    })
    .collect();
    println!("| board, attacked by repeating | bias, points | spread of one board, points |");
    println!("|---|---|---|");
    for (name, bias, spread) in &rows {
        println!("| {name} | {bias:+.1} | {spread:.1} |");
    }
    let fixed = 100.0 * ((0..EPOCHS).map(|_| probe(random, true)).sum::<f64>() / EPOCHS as f64 - 0.5);
    let fresh = 100.0 * ((0..EPOCHS).map(|_| probe(random, false)).sum::<f64>() / EPOCHS as f64 - 0.5);
    println!("| probing, 400 queries: the same hidden instances, every score told | {fixed:+.1} | |");
    println!("| probing, 400 queries: fresh instances, as the tiers draw them | {fresh:+.1} | |");
    let bias_of = |i: usize| rows[i].1;
    assert!(bias_of(1) > 8.0, "without the Ladder the attack works");
    assert!(bias_of(2).abs() < 1.0, "the Ladder shows {:+.2}", bias_of(2));
    assert!(bias_of(3) < bias_of(1) / 1.5, "stopping early gains {:+.2}", bias_of(3));
    assert!(bias_of(5).abs() < 0.5, "stopping early gains {:+.2} on the final board", bias_of(5));
    assert!(bias_of(7).abs() < 0.5, "official scores are off by {:+.2}", bias_of(7));
    assert!(fixed > 20.0 && fresh.abs() < 1.0, "probing gains {fixed:+.2} and {fresh:+.2}");
}

/// What the official board shows: all instances of all entries of an owner, unanswered ones failed.
fn official(random: &mut Mt64) -> f64 {
    let mut all = Tally::default();
    for _ in 0..OFFICIAL.0 * OFFICIAL.1 * PER_RUN {
        all.add(passes(random, TRUTH));
    }
    all.rate()
}

/// What the official board shows of an owner who grades its own answers, and registers a further entry only as long as
/// the score is not above the truth. A beacon prevents that: registration ends before anything is drawn.
fn official_until_lucky(random: &mut Mt64) -> f64 {
    let mut all = Tally::default();
    for runs in [1, 5, 10] {
        for _ in 0..runs * PER_RUN {
            all.add(passes(random, TRUTH));
        }
        if all.rate() > TRUTH {
            break;
        }
    }
    all.rate()
}

/// An agent that is watched while its dev board grows, on what is shown and on what is kept: however it stops, the
/// interval is wrong in one of twenty epochs at most.
#[test]
fn the_intervals_of_a_dev_board_hold_at_every_look() {
    let mut random = Mt64::new(20_261_123);
    let mut misled = [0, 0];
    for _ in 0..EPOCHS {
        let mut attempts: Vec<Attempt<'_>> = Vec::new();
        let mut are_wrong = [false, false];
        for i in 0..40 {
            let outcomes = sample(&mut random, PER_RUN * DEV_RUNS, TRUTH);
            // Every second entry has the configuration of the one before, and is taken together with it.
            attempts.push(attempt(&mut random, 2, ["a", "a", "b", "b"][i % 4], &outcomes));
            let rung = climb(2, &attempts).unwrap();
            let part = 0.05 / f64::from(rung.moves * (rung.moves + 1));
            for (tally, is_wrong) in [rung.shown, rung.kept].into_iter().zip(&mut are_wrong) {
                let own = anytime(tally.passed, tally.of, part).unwrap();
                *is_wrong |= own.low > TRUTH || own.high < TRUTH;
            }
        }
        for (misled, is_wrong) in misled.iter_mut().zip(are_wrong) {
            *misled += usize::from(is_wrong);
        }
    }
    assert!(
        misled.iter().all(|own| own * 20 <= EPOCHS),
        "{misled:?} of {EPOCHS} epochs showed an interval without the truth"
    );
}

//! Draws of hidden specifications: what ten thousand of them have in common, and how they compare with the public
//! suite.

use std::collections::{BTreeMap, BTreeSet};

use plumbline_engine::builders::build;
use plumbline_engine::hidden::commitment::leaf_hash;
use plumbline_engine::hidden::merkle;
use plumbline_engine::hidden::pool::{Generator, Stratum, certify, volume};
use plumbline_engine::hidden::secret::EpochKey;
use plumbline_engine::hidden::siblings::Siblings;
use plumbline_engine::tasks::{Task, embedded, hex};
use sha2::{Digest as _, Sha256};

/// What is compared of a family and of the public families that it stands for.
#[derive(Debug, Default, Clone)]
struct Difficulty {
    tasks: usize,
    blocks: Vec<usize>,
    checks: usize,
    turns: usize,
}

impl Difficulty {
    fn add(&mut self, task: &Task) {
        self.tasks += 1;
        self.blocks.push(volume(&build(task).unwrap()));
        self.checks += task.checks().count();
        self.turns += task.turns.len();
    }

    fn mean(&self, sum: usize) -> f64 {
        sum as f64 / self.tasks as f64
    }

    fn checks_a_turn(&self) -> f64 {
        self.checks as f64 / self.turns as f64
    }

    fn median_blocks(&mut self) -> usize {
        self.blocks.sort_unstable();
        self.blocks[self.blocks.len() / 2]
    }
}

/// Draws in all. Stress references make most of the time, so `PLUMBLINE_TEST_DRAWS` may ask for fewer.
fn wanted() -> u32 {
    std::env::var("PLUMBLINE_TEST_DRAWS").ok().and_then(|text| text.parse().ok()).unwrap_or(10_000)
}

#[test]
fn ten_thousand_draws_are_certified_new_and_as_hard_as_the_public_suite() {
    let generator = Generator::new().unwrap();
    let public = embedded::latest().unwrap();
    let mut of_public: BTreeMap<&str, Difficulty> = BTreeMap::new();
    for task in &public.tasks {
        of_public.entry(task.family()).or_default().add(task);
    }
    let public_prompts: BTreeSet<&str> =
        public.tasks.iter().flat_map(|task| &task.turns).map(|turn| turn.prompt.as_str()).collect();
    // Two keys, so that both held-out families have a chance; the seed of the test is fixed.
    let keys = [EpochKey::new([1; 32]), EpochKey::new([2; 32])];
    let instances: u32 = generator.strata(&keys[0], 1).iter().map(|stratum| stratum.size).sum();
    let per_instance = wanted().div_ceil(instances * keys.len() as u32);
    let mut drawn: BTreeMap<String, Difficulty> = BTreeMap::new();
    let mut distinct: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for key in &keys {
        let mut seen: BTreeSet<Vec<String>> = BTreeSet::new();
        for stratum in generator.strata(key, per_instance) {
            for specification in generator.specifications(key, &stratum, &|| ()).unwrap() {
                let task = specification.task;
                let prompts = task.turns.iter().map(|turn| turn.prompt.clone()).collect();
                assert!(seen.insert(prompts), "{} says what another one of its pool says", task.id);
                certify(&task, &build(&task).unwrap()).unwrap();
                assert!(task.turns.iter().all(|turn| !public_prompts.contains(turn.prompt.as_str())), "{}", task.id);
                distinct
                    .entry(stratum.family.clone())
                    .or_default()
                    .insert(serde_json::to_string(&task.parameters).unwrap());
                drawn.entry(stratum.family.clone()).or_default().add(&task);
            }
        }
    }
    println!(
        "| family | stands for | drawn | distinct | blocks: median, public | checks a turn: mean, public | turns: mean, public |"
    );
    println!("|---|---|---|---|---|---|---|");
    for family in generator.families() {
        let stands_for = &family.content.draw.as_ref().unwrap().stands_for;
        let Some(own) = drawn.get_mut(family.name()) else { continue };
        let mut public = Difficulty::default();
        for name in stands_for {
            let part = &of_public[name.as_str()];
            public.tasks += part.tasks;
            public.blocks.extend(&part.blocks);
            public.checks += part.checks;
            public.turns += part.turns;
        }
        let (checks, turns, blocks) = (own.checks_a_turn(), own.mean(own.turns), own.median_blocks());
        let (tasks, name, kinds) = (own.tasks, family.name(), distinct[family.name()].len());
        if stands_for.is_empty() {
            println!("| {name} | – | {tasks} | {kinds} | {blocks} | {checks:.1} | {turns:.1} |");
            continue;
        }
        let (public_checks, public_turns) = (public.checks_a_turn(), public.mean(public.turns));
        let public_blocks = public.median_blocks();
        println!(
            "| {name} | {} | {tasks} | {kinds} | {blocks}, {public_blocks} | {checks:.1}, {public_checks:.1} | {turns:.1}, {public_turns:.1} |",
            stands_for.join(", ")
        );
        // The stated bounds: see tasks/README.md.
        let ratio = blocks as f64 / public_blocks as f64;
        assert!((0.5..=2.0).contains(&ratio), "{name}: {blocks} blocks against {public_blocks}");
        assert!((-2.0..=4.0).contains(&(checks - public_checks)), "{name}: {checks} checks against {public_checks}");
        assert!((turns - public_turns).abs() <= 1.5, "{name}: {turns} turns against {public_turns}");
        // Within a pool all are distinct; two keys may draw the same.
        assert!(2 * kinds >= tasks, "{name}: {kinds} kinds in {tasks}");
    }
    let total: usize = drawn.values().map(|own| own.tasks).sum();
    assert!(total >= wanted() as usize, "{total}");
    println!("{total} draws");
}

/// Epochs of the first version are verified by drawing their specifications again.
#[test]
fn the_first_version_draws_what_it_drew() {
    let generator = Generator::of(1).unwrap();
    let key = EpochKey::new([3; 32]);
    let mut leaves = Vec::new();
    for stratum in generator.strata(&key, 4) {
        let specifications = generator.specifications(&key, &stratum, &|| ()).unwrap();
        leaves.extend(specifications.iter().map(|own| leaf_hash(&key, own)));
    }
    assert_eq!(hex(&merkle::root(&leaves)), "c9e9a7ae9225123f986f70ab3e59c3124403786fbef5fa76761e49500cc61d1e");
}

/// The list of siblings of the third version, as it was when that version was the latest.
#[test]
fn the_third_version_lists_what_it_listed() {
    let lines = Siblings::of(3).unwrap().lines();
    assert_eq!(lines.lines().count(), 1_728);
    let digest = hex(&Sha256::digest(lines.as_bytes()));
    assert_eq!(digest, "13051efedd7166caad918c41f925b0a73249cf067fe040c64cd54568ed5256d7");
}

/// Every value that a family's rules allow is drawn at least half as often as the rules alone would draw it: what else
/// rejects a draw, such as its size beside the public builds, makes no value rare.
#[test]
fn no_value_that_a_family_allows_is_rare() {
    const WANTED: u32 = 240;
    let generator = Generator::new().unwrap();
    let key = EpochKey::new([4; 32]);
    let mut rare = Vec::new();
    for family in generator.families() {
        let rules = family.content.draw.as_ref().unwrap();
        let open: Vec<&str> =
            rules.parameters.iter().filter(|own| own.is.is_none()).map(|own| own.name.as_str()).collect();
        let mut random = rand_mt::Mt64::new(7);
        let mut by_rules: BTreeMap<(String, String), f64> = BTreeMap::new();
        let mut raw = 0.0;
        while raw < 20_000.0 {
            if let Some(drawn) = family.draw(&mut |n| random.next_u64() % n).unwrap() {
                raw += 1.0;
                for name in &open {
                    *by_rules.entry(((*name).to_owned(), drawn[*name].to_string())).or_default() += 1.0;
                }
            }
        }
        let stratum = Stratum { family: family.name().to_owned(), instances: 1, first: 0, size: WANTED };
        let mut drawn: BTreeMap<(String, String), f64> = BTreeMap::new();
        for specification in generator.specifications(&key, &stratum, &|| ()).unwrap() {
            for name in &open {
                let value = specification.task.parameters[*name].to_string();
                *drawn.entry(((*name).to_owned(), value)).or_default() += 1.0;
            }
        }
        for ((name, value), times) in by_rules {
            let (share, wanted) =
                (drawn.get(&(name.clone(), value.clone())).unwrap_or(&0.0) / f64::from(WANTED), times / raw);
            // Three standard deviations below half of the wanted share are chance.
            let chance = 3.0 * (wanted / 2.0 * (1.0 - wanted / 2.0) / f64::from(WANTED)).sqrt();
            if share < wanted / 2.0 - chance {
                rare.push(format!(
                    "{}: {name} = {value} in {:.1} %, by the rules {:.1} %",
                    family.name(),
                    100.0 * share,
                    100.0 * wanted
                ));
            }
        }
    }
    assert!(rare.is_empty(), "{rare:#?}");
}

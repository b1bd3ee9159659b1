//! Draws of hidden specifications: what ten thousand of them have in common, and how they compare with the public suite.

use std::collections::{BTreeMap, BTreeSet};

use plumbline_engine::builders::build;
use plumbline_engine::hidden::pool::{Generator, certify, volume};
use plumbline_engine::hidden::secret::EpochKey;
use plumbline_engine::tasks::{Task, embedded};

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

//! Hidden specifications against those who would pass without building: degenerate logs and saboteurs.

use std::collections::BTreeSet;

use plumbline_engine::builders::build;
use plumbline_engine::builders::saboteurs::SABOTEURS;
use plumbline_engine::checks::Criterion;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::baseline::Baseline;
use plumbline_engine::grading::{Report, Scores, grade_log, score_log};
use plumbline_engine::hidden::pool::Generator;
use plumbline_engine::hidden::secret::EpochKey;
use plumbline_engine::tasks::{Task, embedded};
use plumbline_engine::voxel::{BlockLog, Cell};

/// Some specifications of every family.
fn specifications() -> Vec<Task> {
    let generator = Generator::new().unwrap();
    let mut tasks: Vec<Task> = Vec::new();
    for key in [EpochKey::new([1; 32]), EpochKey::new([2; 32])] {
        for stratum in generator.strata(&key, 3) {
            let drawn = generator.specifications(&key, &stratum, &|| ()).unwrap();
            tasks.extend(drawn.into_iter().map(|specification| specification.task));
        }
    }
    let families: BTreeSet<&str> = tasks.iter().map(Task::family).collect();
    assert_eq!(families.len(), generator.families().len());
    tasks
}

fn grade(task: &Task, log: &BlockLog) -> Report {
    grade_log(task, log, &Control::unhurried()).unwrap()
}

/// Returns the scores, which are those of the report.
fn scores(task: &Task, log: &BlockLog) -> Scores {
    let scores = score_log(task, log, &Control::unhurried()).unwrap();
    assert_eq!(scores, Scores::from(&grade(task, log)), "{}", task.id);
    scores
}

fn log(turns: usize, blocks: impl Fn(usize) -> Vec<(Cell, &'static str)>) -> BlockLog {
    let mut log = BlockLog::default();
    for turn in 0..turns {
        log.turns.push(Vec::new());
        for (cell, material) in blocks(turn) {
            log.place(cell, material);
        }
    }
    log
}

#[test]
fn degenerate_logs_pass_nothing() {
    for task in specifications() {
        let turns = task.turns.len();
        let cube = |low: i32, material: &'static str| {
            let cells =
                (0..12).flat_map(move |x| (low..low + 8).flat_map(move |y| (0..12).map(move |z| Cell::new(x, y, z))));
            cells.map(|cell| (cell, material)).collect::<Vec<_>>()
        };
        let logs = [
            ("nothing", log(turns, |_| Vec::new())),
            ("one block", log(turns, |_| vec![(Cell::new(0, 0, 0), "stone")])),
            ("everything below the ground", log(turns, |_| cube(-8, "stone"))),
            ("a solid cube", log(turns, |_| cube(0, "oak_planks"))),
            ("the same cell over and over", log(turns, |_| vec![(Cell::new(0, 0, 0), "white_bed"); 300])),
            (
                "a bed of bedrock and trapdoors",
                log(turns, |turn| {
                    let at = 10 * turn as i32;
                    vec![(Cell::new(at, 0, 0), "bedrock"), (Cell::new(at + 1, 0, 0), "oak_trapdoor")]
                }),
            ),
        ];
        for (name, log) in logs {
            assert!(!grade(&task, &log).overall, "{name} passes {}", task.id);
        }
    }
}

/// The verdict alone, without the stress check, which takes long and does not count for it.
fn grade_verdict(task: &Task, log: &BlockLog) -> bool {
    let mut task = task.clone();
    for turn in &mut task.turns {
        turn.checks.retain(|check| check.criterion() != Criterion::StructuralStability);
    }
    grade(&task, log).overall
}

#[test]
fn saboteurs_fail_and_every_check_is_failed_by_one() {
    let mut is_idle = vec![true; SABOTEURS.len()];
    let mut unfailed: BTreeSet<(String, String)> = BTreeSet::new();
    let mut failed: BTreeSet<(String, String)> = BTreeSet::new();
    let mut caught_in = vec![BTreeSet::new(); SABOTEURS.len()];
    let tasks = specifications();
    for task in &tasks {
        let good = build(task).unwrap();
        for (i, saboteur) in SABOTEURS.iter().enumerate() {
            let report = grade(task, &saboteur.spoil(good.clone()));
            for check in report.turns.iter().flat_map(|turn| &turn.checks) {
                let name = (task.family().to_owned(), check.name.to_string());
                if check.finding.holds() {
                    unfailed.insert(name);
                } else {
                    is_idle[i] = false;
                    failed.insert(name);
                }
            }
            if !report.overall {
                caught_in[i].insert(task.family().to_owned());
            }
        }
    }
    let families = tasks.iter().map(Task::family).collect::<BTreeSet<_>>().len();
    let public = embedded::latest().unwrap();
    let public = public.families();
    let mut milder = Vec::new();
    println!("| saboteur | hidden families that it fails | public ones |");
    println!("|---|---|---|");
    for (saboteur, caught) in SABOTEURS.iter().zip(&caught_in) {
        let fails = |task: &&[Task]| !grade_verdict(&task[0], &saboteur.spoil(build(&task[0]).unwrap()));
        let public_caught = public.iter().filter(|tasks| fails(tasks)).count();
        println!("| {} | {} of {families} | {public_caught} of {} |", saboteur.name, caught.len(), public.len());
        let (hidden_share, public_share) =
            (caught.len() as f64 / families as f64, public_caught as f64 / public.len() as f64);
        if hidden_share < public_share - 0.1 {
            milder.push(saboteur.name);
        }
    }
    assert!(milder.is_empty(), "{milder:?}");
    let never: Vec<_> = unfailed.difference(&failed).collect();
    assert!(never.is_empty(), "no saboteur fails {never:#?}");
    let idle: Vec<&str> = SABOTEURS.iter().zip(is_idle).filter(|(_, idle)| *idle).map(|(s, _)| s.name).collect();
    assert!(idle.is_empty(), "{idle:?} spoil nothing");
}

/// The scheme for training, on every hidden family; `src/grading/baseline.rs` tests the public ones.
#[test]
fn shaped_rewards_pay_nothing_for_nothing_and_all_for_a_good_build() {
    for mut task in specifications() {
        // Stress takes long, and is the same to a block wherever it is.
        for turn in &mut task.turns {
            turn.checks.retain(|check| check.criterion() != Criterion::StructuralStability);
        }
        let baseline = Baseline::of(&task, &Control::unhurried()).unwrap();
        let shaped = |log: &BlockLog| baseline.shaped(&scores(&task, log));
        assert!(baseline.can_be_beaten(), "{}", task.id);
        let turns = task.turns.len();
        assert_eq!(shaped(&build(&task).unwrap()), 1.0, "{}", task.id);
        assert_eq!(shaped(&log(turns, |_| Vec::new())), 0.0, "{}", task.id);
        for material in ["stone", "oak_door", "red_bed", "oak_planks"] {
            for y in [-4, -1, 0, 2, 5] {
                let one = log(turns, |turn| if turn == 0 { vec![(Cell::new(4, y, 1), material)] } else { Vec::new() });
                assert_eq!(shaped(&one), 0.0, "{}: {material} at {y}", task.id);
            }
        }
    }
}

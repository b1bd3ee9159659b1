//! Work of the engine and of the store: each case runs once to warm up and once counted.

use std::cell::RefCell;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use plumbline::app::rewards::reading::read_request;
use plumbline::app::submissions::decision::decide_all;
use plumbline::store::Store;
use plumbline::store::claims::Claimed;
use plumbline::store::location::Location;
use plumbline::store::queue::Lane;
use plumbline::store::reports::PackedReport;
use plumbline::store::submissions::NewSubmission;
use plumbline_engine::builders::build;
use plumbline_engine::checks::{Check, Subject};
use plumbline_engine::elasticity::{Control, fem, sph};
use plumbline_engine::grading::{grade_hashed, grade_log, score_log};
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::{Task, embedded};
use plumbline_engine::voxel::replay::Replay;
use plumbline_engine::voxel::{BlockLog, Cell, Structure};
use serde_json::{Value, json};

use crate::arguments::arguments;
use crate::submission::submission;
use crate::{Count, callgrind, total};

/// Number of submissions that a case of the store accepts, claims and records.
const SUBMISSIONS: usize = 64;

/// Number of equal structures that each check takes in turn.
const HOUSES: usize = 20;

/// A case: its name, how often it does its work, and the work.
type Case = (String, u32, Box<dyn FnMut() -> anyhow::Result<()>>);

/// Runs the cases under callgrind and reads what it counted.
pub fn counts(folder: &Path) -> anyhow::Result<Vec<Count>> {
    let out = folder.join("engine");
    let options = ["--zero-before=*counted_work", "--dump-after=*counted_work"];
    let ran = callgrind(&out, &options, &std::env::current_exe()?).arg("run").output();
    let ran = ran.context("cannot run valgrind; Debian's package valgrind has it")?;
    anyhow::ensure!(ran.status.success(), "the cases failed: {}", String::from_utf8_lossy(&ran.stderr));
    let names = String::from_utf8(ran.stdout)?;
    // The first dump of a case is that of its warm-up.
    let count = |(number, line): (usize, &str)| {
        let (times, name) = line.split_once(' ').context("a case has a number and a name")?;
        let counted = total(&folder.join(format!("engine.{}", 2 * number + 2)))?;
        Ok((name.to_owned(), counted / times.parse::<u64>()?))
    };
    names.lines().enumerate().map(count).collect()
}

/// Runs every case twice, and prints how often it did its work, and its name.
pub fn run() -> anyhow::Result<()> {
    for (name, times, mut work) in cases()? {
        counted_work(&mut *work)?;
        counted_work(&mut *work)?;
        println!("{times} {name}");
    }
    Ok(())
}

/// What callgrind counts: it knows the function by its name.
#[inline(never)]
fn counted_work(work: &mut dyn FnMut() -> anyhow::Result<()>) -> anyhow::Result<()> {
    black_box(work())
}

/// A case whose result does not matter. It runs several times: maps have random keys, and collide now and then.
fn case<T>(name: impl Into<String>, times: u32, mut work: impl FnMut() -> T + 'static) -> Case {
    let work = move || {
        for _ in 0..times {
            black_box(work());
        }
        Ok(())
    };
    (name.into(), times, Box::new(work))
}

fn task(id: &str) -> anyhow::Result<Task> {
    let suite = embedded::latest().map_err(|faults| anyhow::anyhow!("{faults:?}"))?;
    suite.tasks.into_iter().find(|task| task.id == id).with_context(|| format!("there is no task {id}"))
}

fn log_of(task: &Task) -> anyhow::Result<BlockLog> {
    build(task).map_err(|error| anyhow::anyhow!("{error}"))
}

/// Reads the same log again and again. Maps have random keys, and a structure keeps its maps: with one structure for
/// all, a map that collides much made every count of this process too high.
fn houses(stored: &[u8]) -> anyhow::Result<Arc<[Structure]>> {
    let house = |_| {
        let log = BlockLog::from_canonical_json(stored)?;
        Replay::new(&log).last().context("the house has no turns")
    };
    (0..HOUSES).map(house).collect()
}

fn cases() -> anyhow::Result<Vec<Case>> {
    let event = |i: i32| json!({ "action": "place", "x": i % 20, "y": i / 20, "z": 0, "material": "stone" });
    let events: Vec<Value> = (0..300).map(event).collect();
    let rows: Vec<Value> = (0..300).map(|i| json!([i % 20, i / 20, 0, 0])).collect();
    let body = |turn: Value| json!({ "task": 532, "suite": "mineceraft@2", "turns": [turn] }).to_string();
    let events = body(json!({ "events": events }));
    let rows = body(json!({ "palette": ["stone"], "rows": rows }));
    let read = |body: String| {
        move || {
            let mut faults = Faults::default();
            assert!(read_request(body.as_bytes(), &mut faults).is_ok_and(|request| request.is_some()));
            assert!(faults.is_empty(), "{faults:?}");
        }
    };
    let house = task("bedrooms/r5-build")?;
    let log = log_of(&house)?;
    let stored = log.canonical_json();
    let houses = houses(&stored)?;
    let mut cases = vec![
        case("read a request with 300 events", 20, read(events)),
        case("read a request with 300 rows", 20, read(rows)),
        case("read a stored log", 20, move || BlockLog::from_canonical_json(&stored).is_ok()),
        case("replay a house", 20, move || Replay::new(&log).last()),
    ];
    for (name, _) in Check::LIST {
        let check: Check = serde_json::from_value(json!({ "fn": name, "args": arguments(name) }))?;
        if !name.starts_with("structural_stability") {
            let (houses, mut next) = (Arc::clone(&houses), (0..HOUSES).cycle());
            let evaluate =
                move || check.evaluate(&Subject::unhurried(&houses[next.next().expect("a cycle has no end")]));
            cases.push(case(format!("check {name}"), HOUSES as u32, evaluate));
        }
    }
    for (name, found) in crate::found::read()? {
        let check: Check = serde_json::from_value(json!({ "fn": name, "args": arguments(&name) }))?;
        let built = crate::strokes::structure(&found.small, crate::found::SMALL);
        let palette = Arc::new(built.palette().clone());
        // A structure keeps what it has looked up, so each time takes a new one.
        let evaluate = move || {
            let fresh = Structure::new(Arc::clone(&palette), built.entries());
            check.evaluate(&Subject::unhurried(&fresh))
        };
        cases.push(case(format!("searched build for {name}"), 1, evaluate));
    }
    for id in ["walls/10x2x7-raise", "bedrooms/r5-build", "theatres/s35-build", "frames/s10-frame-build"] {
        let task = task(id)?;
        let log = log_of(&task)?;
        let (same_task, same_log) = (task.clone(), log.clone());
        let scores = move || score_log(&same_task, &same_log, &Control::unhurried()).is_ok();
        cases.push(case(format!("grade {id}"), 10, move || grade_log(&task, &log, &Control::unhurried()).is_ok()));
        cases.push(case(format!("score {id}"), 10, scores));
    }
    let roof = log_of(&task("one-layer-roofs/c5-span")?)?;
    let cells: Vec<Cell> = Replay::new(&roof).last().as_ref().map(Structure::cells).unwrap_or_default().to_vec();
    let same = cells.clone();
    cases.push(case("stress of a roof, published", 1, move || sph::simulate(&cells, &Control::unhurried()).is_ok()));
    cases.push(case("stress of a roof, equilibrium", 1, move || {
        fem::solve_equilibrium(&same, &Control::unhurried()).is_ok()
    }));
    cases.extend(store_cases()?);
    Ok(cases)
}

/// Acceptance, claim and record on a database of their own.
fn store_cases() -> anyhow::Result<Vec<Case>> {
    let runtime = Arc::new(tokio::runtime::Builder::new_current_thread().enable_all().build()?);
    let folder = tempfile::tempdir()?;
    let store = runtime.block_on(Store::open(&Location::File(folder.path().join("p.db")), None))?;
    let suite = embedded::suite(2).map_err(|faults| anyhow::anyhow!("{faults:?}"))?;
    runtime.block_on(store.put_suite(&suite, 0))?;
    let task = suite.tasks[0].clone();
    let log = log_of(&task)?;
    let graded = grade_hashed(&task, &task.content_hash(), &log, &Control::unhurried());
    let report = PackedReport::of(&graded.map_err(|error| anyhow::anyhow!("{error:?}"))?, 1)?;
    let new = submission(&suite, &task, &log)?;
    let number = RefCell::new(0_u64);
    let (accepting, recording) = ((store.clone(), Arc::clone(&runtime)), (store, runtime));
    let accept = move || {
        let (store, runtime) = &accepting;
        for _ in 0..SUBMISSIONS {
            *number.borrow_mut() += 1;
            let id = format!("00000000-0000-7000-8000-{:012}", number.borrow());
            let one = NewSubmission { id, ..new.clone() };
            runtime.block_on(store.accept(Arc::new([one]), None, decide_all, 0))?;
        }
        Ok(())
    };
    let record = move || {
        // The folder goes with the last case.
        let (store, runtime) = (&recording.0, &recording.1);
        let _kept = folder.path();
        runtime.block_on(async {
            let Claimed::Jobs(claims) = store.claim(&[Lane::Quick], 60_000, SUBMISSIONS).await? else {
                anyhow::bail!("nothing was queued");
            };
            let mut graded: Vec<_> = claims.into_iter().map(|claim| (claim, report.clone())).collect();
            store.record(&mut graded, 0).await?;
            Ok(())
        })
    };
    Ok(vec![
        (format!("accept {SUBMISSIONS} submissions one at a time"), 1, Box::new(accept)),
        (format!("claim and record {SUBMISSIONS} submissions"), 1, Box::new(record)),
    ])
}

//! Kills the service at each commit while its disk, or its line to the server, fails from time to time. Whatever was
//! acknowledged is still there, and nothing is stuck.
//!
//! The ordinary test tries a few crash points, each under one fault. With `PLUMBLINE_ALL_FAULTS=1` it tries every fault at
//! each crash point, which takes minutes: `PLUMBLINE_ALL_FAULTS=1 cargo test --test service crash_faults`.

use std::process::Command;
use std::time::Duration;

use super::scene::{LEASE, Scene, on_threads};
use crate::support::PROGRAM;
use crate::support::place::Place;

/// Number of scenes at a time.
const AT_ONCE: usize = 4;
/// Commits before and after which the service dies.
const COMMITS: [&str; 8] =
    ["create_run", "accept", "claim", "renew", "record", "cancel", "finish_run", "note_key_uses"];

/// Crash points of the ordinary test: the third submission is accepted, and the first is graded.
const ORDINARY: [&str; 4] = ["before accept 3", "after accept 3", "before record", "after record"];

/// Switches a fault on and off, so that work it prevents can go on in between.
async fn flicker(place: &Place, fault: u64) {
    loop {
        place.begin_fault(fault);
        tokio::time::sleep(Duration::from_millis(200)).await;
        place.end_fault();
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}

/// Kills a service at a moment of its work under a fault. Returns the number of submissions that were acknowledged.
async fn killed((moment, fault): (String, u64)) -> usize {
    let (mut scene, place) = Scene::with_faults().await;
    let mut command = Command::new(PROGRAM);
    command.env("PLUMBLINE_TEST_KILL", &moment);
    let service = place.start(command, &LEASE);
    let course = async {
        // `None` where it died in the middle.
        let is_through = scene.work(&service).await.is_some();
        if is_through && moment.ends_with("cancel") {
            // A line that stands still for a minute may let all be graded first, so that nothing is left to cancel.
            tokio::time::sleep(Duration::from_secs(1)).await;
            service.signal("KILL");
        }
        service.wait_for_end(&format!("{moment}, fault {fault}, {}", scene.last())).await;
    };
    tokio::select! {
        () = flicker(&place, fault) => {}
        () = course => {}
    }
    place.end_fault();
    scene.end_well(&format!("{moment}, {}", place.name_of(fault))).await;
    scene.acknowledged.len()
}

// The line to PostgreSQL passes bytes on while the test waits.
#[tokio::test(flavor = "multi_thread")]
async fn killed_at_each_commit_under_faults() {
    let (_scene, place) = Scene::with_faults().await;
    let kinds = place.kinds() as u64;
    let scenes: Vec<(String, u64)> = if std::env::var_os("PLUMBLINE_ALL_FAULTS").is_some() {
        let moments = COMMITS.iter().flat_map(|commit| ["before", "after"].map(|side| format!("{side} {commit}")));
        moments.flat_map(|moment| (0..kinds).map(move |fault| (moment.clone(), fault))).collect()
    } else {
        (0..).zip(ORDINARY).map(|(i, moment)| (moment.to_owned(), i % kinds)).collect()
    };
    let acknowledged = on_threads(scenes, AT_ONCE, killed).await;
    // A service that dies at its first run or submission has acknowledged none.
    let with_any = acknowledged.iter().filter(|count| **count > 0).count();
    assert!(2 * with_any > acknowledged.len(), "hardly anything was acknowledged: {acknowledged:?}");
}

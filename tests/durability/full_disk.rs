//! A full disk: what cannot be stored is refused, `/readyz` says so, and once there is space the service goes on
//! without a restart.

use std::os::unix::process::CommandExt as _;
use std::process::Command;
use std::time::Duration;

use crate::support::{PROGRAM, Service};
use reqwest::StatusCode;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use serde_json::json;

/// Bounds the size of a process's files, as a small disk would: writing beyond it fails.
fn bound_files(process: u32, bytes: Option<u64>) {
    let pid = Pid::from_raw(i32::try_from(process).unwrap());
    let limit = Rlimit { current: bytes, maximum: None };
    prlimit(pid, Resource::Fsize, limit).unwrap();
}

/// The program with the signal ignored that a file beyond its bound brings.
fn command() -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", "trap '' XFSZ; exec \"$0\" \"$@\"", PROGRAM]).process_group(0);
    command
}

/// Begins runs with metadata until one is refused, and says how; the database grows by each.
async fn fill(service: &Service) -> StatusCode {
    for i in 0..4_000 {
        let filling: String = (0..8_000).map(|k| char::from(b'a' + ((i * 7 + k * k) % 26) as u8)).collect();
        let new = json!({ "agent": "filler", "suite": "mineceraft-lite", "metadata": { "filling": filling } });
        let begun = service.post_json("/v1/runs", &new).await;
        if !begun.status.is_success() {
            return begun.status;
        }
    }
    panic!("nothing was refused");
}

async fn becomes(service: &Service, wanted: StatusCode) {
    for _ in 0..1_000 {
        if service.get("/readyz").await.status == wanted {
            return;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("/readyz is {}, not {wanted}", service.get("/readyz").await.status);
}

#[tokio::test]
async fn writing_goes_on_once_there_is_space_again() {
    if crate::support::database::is_postgres() {
        // Only a file is copied, locked, filled or taken over from an old release.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start_by(command(), &folder.path().join("p.db"), &["--open"]);
    becomes(&service, StatusCode::OK).await;
    let kept = service.begin_run("before", "mineceraft-lite").await;
    let size = std::fs::metadata(folder.path().join("p.db")).unwrap().len();
    bound_files(service.process_id(), Some(size.max(4 << 20) + (1 << 20)));
    assert_eq!(fill(&service).await, StatusCode::INTERNAL_SERVER_ERROR);
    // Nothing that is acknowledged is lost.
    let refused = service.post_json("/v1/runs", &json!({ "agent": "x", "suite": "mineceraft-lite" })).await;
    // A few bytes may still fit into a page that is there.
    if refused.status.is_success() {
        let id = refused.json()["id"].as_str().unwrap().to_owned();
        assert_eq!(
            service.get(&format!("/v1/runs/{id}")).await.status,
            StatusCode::OK,
            "what was acknowledged is there"
        );
    } else {
        assert!(refused.status.is_server_error(), "{}", refused.text);
    }
    assert_eq!(service.get(&format!("/v1/runs/{kept}")).await.status, StatusCode::OK);
    bound_files(service.process_id(), None);
    becomes(&service, StatusCode::OK).await;
    let after = service.begin_run("after", "mineceraft-lite").await;
    assert_eq!(service.get(&format!("/v1/runs/{after}")).await.json()["agent"], "after");
}

/// The same on a file system that is really full, where the system lets the test make a small one.
#[tokio::test]
async fn a_small_file_system_fills_and_is_freed() {
    if crate::support::database::is_postgres() {
        // Only a file is copied, locked, filled or taken over from an old release.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let disk = folder.path().join("disk");
    std::fs::create_dir(&disk).unwrap();
    let mount =
        Command::new("unshare").args(["-rm", "mount", "-t", "tmpfs", "-o", "size=1m", "small"]).arg(&disk).status();
    if !mount.is_ok_and(|status| status.success()) {
        eprintln!("SKIPPED: this system lets no test mount a small file system; the test with bounded files ran");
        return;
    }
    // Within the service's own name space of mounts; from outside, space is freed through its root.
    let mut command = Command::new("unshare");
    let script = "mount -t tmpfs -o size=32m small \"$1\"; dd if=/dev/zero of=\"$1/ballast\" bs=1M count=16 2>/dev/null; shift; exec \"$@\"";
    command.args(["-rm", "sh", "-c", script, "sh"]).arg(&disk).arg(PROGRAM);
    let service = Service::start_by(command, &disk.join("p.db"), &["--open"]);
    becomes(&service, StatusCode::OK).await;
    // Others fill the disk: a small write still fits into what the database has, and a submission does not.
    let inside = |name: &str| format!("/proc/{}/root{}", service.process_id(), disk.join(name).display());
    let mut rest = std::fs::File::create(inside("rest")).unwrap();
    while std::io::Write::write_all(&mut rest, &[0; 4_096]).is_ok() {}
    becomes(&service, StatusCode::SERVICE_UNAVAILABLE).await;
    tokio::time::sleep(Duration::from_millis(2_500)).await;
    assert_eq!(service.get("/readyz").await.status, StatusCode::SERVICE_UNAVAILABLE);
    std::fs::remove_file(inside("rest")).unwrap();
    drop(rest);
    becomes(&service, StatusCode::OK).await;
    // A full disk is the operator's to mend, and the request may be sent again.
    assert_eq!(fill(&service).await, StatusCode::SERVICE_UNAVAILABLE);
    becomes(&service, StatusCode::SERVICE_UNAVAILABLE).await;
    std::fs::remove_file(inside("ballast")).unwrap();
    becomes(&service, StatusCode::OK).await;
    let after = service.begin_run("after", "mineceraft-lite").await;
    assert_eq!(service.get(&format!("/v1/runs/{after}")).await.json()["agent"], "after");
}

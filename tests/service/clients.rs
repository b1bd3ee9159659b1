//! The OpenAPI document as others use it: a validator, two generators, and a generated client on its way through the
//! service.

use std::process::Command;

use crate::support::{PROGRAM, Service, repository};

fn succeeded(mut command: Command) -> Vec<u8> {
    let done = command.output().unwrap();
    let told = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{command:?}: {told}\n{}", String::from_utf8_lossy(&done.stdout));
    done.stdout
}

#[test]
fn generated_clients_go_the_whole_way() {
    // The tools stay there between runs.
    let tools = repository("target/clients");
    let mut generate = Command::new("bash");
    generate.arg(repository("tests/clients/generate")).arg(repository("openapi/plumbline.json")).arg(&tools);
    succeeded(generate);

    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let mut build = Command::new(PROGRAM);
    build.args(["build", "walls/5x1x5-raise", "--format", "submission"]);
    let built = folder.path().join("built.json");
    std::fs::write(&built, succeeded(build)).unwrap();
    let mut flow = Command::new(tools.join("venv/bin/python"));
    flow.arg(repository("tests/clients/flow.py")).arg(tools.join("python")).arg(&service.url).arg(&built);
    assert_eq!(succeeded(flow), b"ok\n");
    let mut flow = Command::new("node");
    flow.arg(tools.join("typescript/flow.js")).arg(&service.url).arg(&built);
    assert_eq!(succeeded(flow), b"ok\n");
}

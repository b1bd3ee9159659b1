//! Pages in a real browser (Debian's chromium), without a network.

use std::process::Command;

use crate::support::Service;

/// The document after scripts have run.
fn rendered(url: &str, wait_ms: u32) -> String {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--virtual-time-budget={wait_ms}"))
        .args(["--dump-dom", url])
        .output()
        .expect("chromium is not installed; bash tests/run installs it");
    String::from_utf8(output.stdout).unwrap()
}

#[tokio::test]
async fn the_home_page_shows_the_board_and_the_reference_its_operations() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let markup = "<b onclick=alert(1)>agent</b>";
    let run = service.begin_run(markup, "mineceraft-lite").await;
    service.post_json(&format!("/v1/runs/{run}/finish"), &serde_json::json!({ "skip": "unanswered" })).await;
    service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    let url = service.url.clone();
    let (home, docs) = tokio::task::spawn_blocking(move || {
        (rendered(&format!("{url}/"), 1_000), rendered(&format!("{url}/docs/"), 5_000))
    })
    .await
    .unwrap();
    assert!(home.contains("mineceraft-lite@1") && home.contains("0.0 %"), "{home}");
    assert!(home.contains("&lt;b onclick=alert(1)&gt;") && !home.contains("<b onclick"), "names are text, not markup");
    assert!(docs.contains("operations-submissions-create_submission"), "the reference shows its operations");
}

//! No model can make its request end without a reward, which a trainer would leave out instead of counting it as low.

use crate::support::Service;
use serde_json::json;

#[tokio::test]
async fn a_build_that_takes_too_long_to_simulate_earns_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let code =
        "for (let i = 0; i < 5001; i++) await skills.placeBlock(bot, 'stone', i % 71, Math.floor(i / 71) * 2, i % 3);";
    let task = "stressed-arches/2-wide-2-leg-build";
    let answer = format!("```js\n{code}\n```");
    let graded = service.post_json("/v1/grade", &json!({ "task": task, "answer": answer })).await.json();
    let why = graded["answer"]["why"].as_str().unwrap_or_default();
    assert!(graded["reward"] == 0.0 && why.contains("at most 5000 are allowed"), "{graded}");
    // A harness that ran the code itself is told so as a fault.
    let turns = json!({ "task": task, "turns": [{ "action_code": code }] });
    let refused = service.post_json("/v1/grade", &turns).await;
    assert!(refused.status == 422 && refused.text.contains("at most 5000 are allowed"), "{}", refused.text);
}

#[tokio::test]
async fn files_that_run_on_their_own_share_their_processor_time() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let slow = "(async (bot) => { let s = 0; for (let i = 0; i < 6e6; i++) s += i % 7; })";
    let answer = json!({ "turns": [{ "action_code": vec![slow; 64] }] }).to_string();
    let request = json!({ "suite": "mineceraft@1", "task": "walls/5x1x5-raise", "answer": answer });
    let graded = service.post_json("/v1/grade", &request).await.json();
    let why = graded["answer"]["why"].as_str().unwrap_or_default();
    assert!(graded["reward"] == 0.0 && why.contains("4000 ms of processor time in all files together"), "{graded}");
}

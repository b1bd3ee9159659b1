//! Repeats: runs of one configuration, taken together.

use crate::support::Service;
use serde_json::{Value, json};

#[tokio::test]
async fn runs_of_one_configuration_are_taken_together() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let (hash, other) = ("a".repeat(64), "b".repeat(64));
    let mut runs = Vec::new();
    // The first problems of the suite are left unsolved.
    for (unsolved, configuration) in
        [(5, Some(&hash)), (10, Some(&hash)), (0, Some(&hash)), (3, Some(&other)), (2, None)]
    {
        let body =
            json!({ "agent": "again", "suite": "mineceraft-lite", "card": { "configuration_sha256": configuration } });
        let run = service.post_json("/v1/runs", &body).await.json()["id"].as_str().unwrap().to_owned();
        service.answer_run(&run, unsolved).await;
        runs.push(run);
    }
    let path = "/v1/leaderboards/mineceraft-lite/repeats";
    let found = service.get(path).await.json();
    let groups = found["groups"].as_array().unwrap();
    assert_eq!(groups.len(), 1, "one run alone is no group: {found}");
    let group = &groups[0];
    assert_eq!((&group["runs"], &group["configuration_sha256"]), (&json!(runs[..3]), &json!(hash)));
    let near =
        |value: &Value, wanted: f64| assert!((value.as_f64().unwrap() - wanted).abs() < 1e-9, "{value} {wanted}");
    // 20, 15 and 25 of 25 problems are solved.
    near(&group["mean"], 0.8);
    near(&group["standard_deviation"], 0.2);
    near(&group["least"], 0.6);
    near(&group["most"], 1.0);
    // 15 problems by all three runs, 5 by two of them, 5 by one.
    let pass_all = &group["pass_all"];
    near(&pass_all[0]["rate"], 0.8);
    near(&pass_all[1]["rate"], (15.0 + 5.0 / 3.0) / 25.0);
    near(&pass_all[2]["rate"], 0.6);
    assert!(
        pass_all[2]["interval"]["low"].as_f64().unwrap() < 0.6
            && pass_all[2]["interval"]["high"].as_f64().unwrap() > 0.6
    );
    assert_eq!(group["interval"], pass_all[0]["interval"]);
    let page = service.get("/boards/mineceraft-lite").await.text;
    assert!(page.contains("Repeats") && page.contains("80.0 %"), "{page}");

    // A card that is edited moves its run.
    let moved = service.http.put(format!("{}/v1/runs/{}/card", service.url, runs[3]));
    service.send(moved.json(&json!({ "configuration_sha256": hash }))).await;
    assert_eq!(service.get(path).await.json()["groups"][0]["runs"].as_array().unwrap().len(), 4);
    assert!(service.get("/v1/leaderboards/none/repeats").await.status.is_client_error());
}

//! Tracks of prompts on boards: ranks and comparisons keep to one track.

use crate::support::Service;
use reqwest::StatusCode;
use serde_json::{Value, json};

const SUITE: &str = "mineceraft-lite";

/// Runs with short prompts are ranked among themselves, and the paper's rows stand beside them alone.
#[tokio::test]
async fn runs_of_one_track_are_compared_with_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let mut runs = Vec::new();
    for (agent, track, unsolved) in [("long", None, 0), ("short", Some("brief"), 20), ("shorter", Some("brief"), 24)] {
        let body = json!({ "agent": agent, "suite": SUITE, "track": track });
        let run = service.post_json("/v1/runs", &body).await;
        assert_eq!(run.status, StatusCode::CREATED, "{}", run.text);
        assert_eq!(run.json()["track"], track.unwrap_or("specified"));
        let id = run.json()["id"].as_str().unwrap().to_owned();
        service.answer_run(&id, unsolved).await;
        runs.push(id);
    }
    let path = format!("/v1/leaderboards/{SUITE}");
    let rows = |board: &Value| -> Vec<(String, u64, String)> {
        let row = |row: &Value| {
            let text = |name: &str| row[name].as_str().unwrap().to_owned();
            (text("agent"), row["rank"].as_u64().unwrap(), text("track"))
        };
        board["rows"].as_array().unwrap().iter().map(row).collect()
    };
    let all = service.get(&path).await.json();
    let [long, short, shorter] = [("long", 1, "specified"), ("short", 1, "brief"), ("shorter", 2, "brief")]
        .map(|(agent, rank, track)| (agent.to_owned(), rank, track.to_owned()));
    assert_eq!(rows(&all), [long.clone(), short.clone(), shorter.clone()]);
    assert_eq!(all["rows"][0]["places"], json!({ "first": 1, "last": 1 }), "the only one of its track");
    let brief = service.get(&format!("{path}?track=brief")).await.json();
    assert_eq!((rows(&brief), brief["reported"].as_array().unwrap().len()), (vec![short, shorter], 16));
    let specified = service.get(&format!("{path}?track=specified")).await.json();
    assert_eq!((rows(&specified), &specified["reported"]), (vec![long], &json!([])));
    assert_eq!(service.get(&format!("/v1/leaderboards/{SUITE}@2")).await.json()["reported"], json!([]));
    assert!(service.get(&format!("{path}?format=csv")).await.text.contains(",brief,"));
    let page = service.get(&format!("/boards/{SUITE}?track=brief")).await.text;
    assert!(
        page.contains("Reported elsewhere") && page.contains(">shorter</a>") && !page.contains(">long</a>"),
        "{page}"
    );

    let compared = service.get(&format!("{path}/compare?a={}&b={}", runs[0], runs[1])).await;
    assert_eq!(compared.status, StatusCode::BAD_REQUEST, "{}", compared.text);
    assert_eq!(service.get(&format!("{path}/compare?a={}&b={}", runs[1], runs[2])).await.status, StatusCode::OK);

    assert!(page.contains("Compare two runs"), "{page}");
    let mixed = service.get(&format!("/boards/{SUITE}")).await.text;
    assert!(!mixed.contains("Compare two runs"), "{mixed}");

    for (suite, track) in [("mineceraft@2", "brief"), (SUITE, "short"), (SUITE, "")] {
        let refused = service.post_json("/v1/runs", &json!({ "agent": "a", "suite": suite, "track": track })).await;
        assert_eq!(refused.faults(422), ["null /track"], "{suite} {track}: {}", refused.text);
    }
    assert_eq!(service.get("/v1/leaderboards/mineceraft@2?track=brief").await.status, StatusCode::BAD_REQUEST);

    // An episode of the run has the prompts of its track.
    let open = service.post_json("/v1/runs", &json!({ "agent": "b", "suite": SUITE, "track": "brief" })).await.json();
    let task = "bedrooms/r5-guesthouse";
    let episode = service.post_json("/v1/episodes", &json!({ "run": open["id"], "task": task })).await;
    let prompt = "Put up a guesthouse with five bedrooms. It holds exactly five beds.";
    let preamble = service.get("/v1/suites/mineceraft").await.json()["preamble"].clone();
    assert_eq!([&episode.json()["prompt"], &episode.json()["preamble"]], [&json!(prompt), &preamble]);
}

//! The suites and tasks over HTTP: filters, pages, entity tags, Lite draws, and checks that are shown without counting.

use crate::support::{Service, repository};
use plumbline_engine::builders::build;
use plumbline_engine::tasks::embedded;
use reqwest::StatusCode;
use serde_json::{Value, json};

#[tokio::test]
async fn tasks_are_found_by_category_type_criterion_and_text() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    for (query, total) in [
        ("", 723),
        ("category=civil-engineering", 117),
        ("type=columns", 12),
        ("type=accessibility&family=theatres", 9),
        ("criterion=structural_stability", 21),
        ("criterion=structural_stability&category=civil-engineering", 9),
        ("text=sea_lantern", 9),
        ("text=SEA_Lantern", 9),
        ("suite=mineceraft-lite&category=structural-elements", 7),
    ] {
        let page = service.get(&format!("/v1/tasks?limit=1&{query}")).await.json();
        assert_eq!((&page["total"], page["suite"].as_str().unwrap().ends_with("@2")), (&json!(total), true), "{query}");
    }
    // The search on the page ignores case too.
    let page = service.get("/suites/mineceraft/tasks?text=SEA_Lantern").await.text;
    assert!(page.contains("9 tasks"), "{page}");
    let page = service.get("/suites/mineceraft/tasks?text=Walls/5x1x5-RAISE").await.text;
    assert!(page.contains(">walls/5x1x5-raise</a>") && !page.contains("walls/5x1x5-courses"), "{page}");
    let unknown = service.get("/v1/tasks?category=towers").await;
    assert_eq!(unknown.status, StatusCode::BAD_REQUEST);
    assert!(unknown.text.contains("civil-engineering"), "{}", unknown.text);
}

#[tokio::test]
async fn a_task_tells_its_parameters_and_what_is_measured_and_is_not_sent_twice() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let answer = service.get("/v1/tasks/walls/5x2x7-courses").await;
    let task = answer.json();
    assert_eq!(task["parameters"], json!({ "w": 5, "t": 2, "h": 7 }));
    assert_eq!((&task["category"], &task["type"]), (&json!("structural-elements"), &json!("walls")));
    let first = &task["turns"][0]["checks"][0];
    assert_eq!(
        (&first["fn"], &first["args"]["expected_count"]),
        (&json!("material.is_block_cnt_equal_to"), &json!(70))
    );
    assert_eq!(first["asks"], "Exactly the expected number of blocks stand, counting one material if one is given");
    let known = service.http.get(format!("{}/v1/tasks/walls/5x2x7-courses", service.url));
    let known = service.send(known.header("if-none-match", &answer.headers["etag"])).await;
    assert_eq!((known.status, known.text.as_str()), (StatusCode::NOT_MODIFIED, ""));
    // The published version has one check less, so another entity.
    let published = service.get("/v1/tasks/walls/5x2x7-courses?suite=mineceraft@1").await;
    assert_ne!(published.headers["etag"], answer.headers["etag"]);
    assert_eq!(published.json()["turns"][0]["checks"].as_array().unwrap().len(), 5);
}

#[tokio::test]
async fn lite_suites_are_drawn_with_any_seed() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let expected: Value =
        serde_json::from_slice(&std::fs::read(repository("tests/conformance/run_expected.json")).unwrap()).unwrap();
    for seed in ["42", "0", "7"] {
        let suite = service.get(&format!("/v1/suites/mineceraft-lite?seed={seed}")).await.json();
        let numbers: Vec<&Value> = suite["drawn"].as_array().unwrap().iter().map(|task| &task["number"]).collect();
        assert_eq!(json!(numbers), expected["lite"][seed]["run_idx"]);
        assert_eq!((&suite["tasks"], suite["seed"].to_string().as_str()), (&json!(25), seed));
    }
    assert_eq!(service.get("/v1/suites/mineceraft-lite").await.json().get("drawn"), None);
    let full = service.get("/v1/suites/mineceraft?seed=7").await;
    assert_eq!(full.status, StatusCode::BAD_REQUEST);
    assert_eq!(service.get("/v1/suites/mineceraft-lite?seed=-7").await.status, StatusCode::BAD_REQUEST);
}

/// A true arch passes in version 2, whose report shows the published rule failing beside; in version 1 it fails.
#[tokio::test]
async fn a_true_arch_passes_beside_the_published_rule() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let suite = embedded::latest().unwrap();
    let task = suite.tasks.iter().find(|task| task.id == "arch-bridges/w10-b3-build").unwrap();
    let turns = build(task).unwrap().compact_turns();
    let mut overall = Vec::new();
    for version in ["mineceraft", "mineceraft@1"] {
        let body = json!({ "suite": version, "task": task.id, "turns": turns });
        let posted = service.post_json("/v1/submissions", &body).await.json();
        let path = format!("/v1/submissions/{}", posted["id"].as_str().unwrap());
        service.wait_for(&path, |submission| submission["state"] == "graded").await;
        let report = service.get(&format!("{path}/report")).await.json();
        overall.push(report["overall"].clone());
        let shown = report["turns"][0].get("informational").cloned().unwrap_or_default();
        let shown: Vec<(&Value, &Value)> =
            shown.as_array().into_iter().flatten().map(|check| (&check["fn"], &check["score"])).collect();
        let (top, bottom) = (json!("shape.is_top_surface_concave"), json!("shape.is_bottom_surface_concave"));
        let (holds, fails) = (json!(1.0), json!(0.0));
        let expected = if version == "mineceraft" { vec![(&top, &holds), (&bottom, &fails)] } else { Vec::new() };
        assert_eq!(shown, expected);
    }
    assert_eq!(overall, [json!(true), json!(false)]);
}

#[tokio::test]
async fn an_agent_gets_instructions_and_a_guide_whose_example_works() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let shown = service.get("/v1/tasks/walls/5x2x7-courses?for=agent").await;
    for told in ["checks", "parameters", "criteria", "informational"] {
        assert!(!shown.text.contains(&format!("\"{told}\"")), "{told}: {}", shown.text);
    }
    let whole = service.get("/v1/tasks/walls/5x2x7-courses").await;
    assert_eq!(shown.json()["turns"][0]["prompt"], whole.json()["turns"][0]["prompt"]);
    assert_ne!(shown.headers["etag"], whole.headers["etag"]);
    assert_eq!(service.get("/v1/tasks/walls/5x2x7-courses?for=me").await.status, StatusCode::BAD_REQUEST);
    let page = service.get("/v1/tasks?family=revisions&limit=1").await.json();
    assert_eq!(
        page["tasks"][0]["prompts"].as_array().unwrap().len() as u64,
        page["tasks"][0]["turns"].as_u64().unwrap()
    );

    for (profile, events) in [("published", 15), ("mindcraft", 20)] {
        let guide = service.get(&format!("/v1/agent-guide?profile={profile}")).await.json();
        let text = service.get(&format!("/v1/agent-guide?profile={profile}&format=markdown")).await;
        assert_eq!(
            (text.kind.as_str(), guide["text"].as_str().unwrap()),
            ("text/markdown; charset=utf-8", &*text.text)
        );
        let replay = json!({ "profile": profile, "action_code": guide["example"] });
        let replayed = service.post_json("/v1/replay", &replay).await.json();
        assert_eq!((&replayed["error"], &replayed["notes"]), (&Value::Null, &json!([])), "{replayed}");
        assert_eq!(replayed["events"].as_array().unwrap().len(), events, "{replayed}");
        // A model that answers with the whole guide has answered with its example.
        let answer =
            json!({ "task": "walls/5x1x5-raise", "profile": profile, "answer": guide["text"], "detail": "report" });
        let graded = service.post_json("/v1/grade", &answer).await.json();
        assert_eq!(graded["report"]["turns"][0]["blocks"], events, "{graded}");
    }
    assert_eq!(service.get("/v1/agent-guide?profile=none").await.status, StatusCode::BAD_REQUEST);
}

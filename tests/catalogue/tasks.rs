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
        assert_eq!((&page["total"], page["suite"].as_str().unwrap().ends_with("@4")), (&json!(total), true), "{query}");
    }
    // The search on the page ignores case too.
    let page = service.get("/suites/mineceraft/tasks?text=SEA_Lantern").await.text;
    assert!(page.contains("9 tasks"), "{page}");
    let page = service.get("/suites/mineceraft/tasks?text=Walls/5x1x5-RAISE").await.text;
    assert!(page.contains(">walls/5x1x5-raise<span") && !page.contains("walls/5x1x5-courses"), "{page}");
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
    let count = &task["turns"][0]["checks"][2];
    assert_eq!((&count["fn"], &count["args"]["min"]), (&json!("material.count_is_within"), &json!(70)));
    assert!(count["asks"].as_str().unwrap().starts_with("The number of blocks"), "{count}");
    let known = service.http.get(format!("{}/v1/tasks/walls/5x2x7-courses", service.url));
    let known = service.send(known.header("if-none-match", &answer.headers["etag"])).await;
    assert_eq!((known.status, known.text.as_str()), (StatusCode::NOT_MODIFIED, ""));
    // The published version has other checks, so it is another entity.
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
    let suite = embedded::suite(2).unwrap();
    let task = suite.tasks.iter().find(|task| task.id == "arch-bridges/w10-b3-build").unwrap();
    let turns = build(task).unwrap().compact_turns();
    let mut overall = Vec::new();
    for version in ["mineceraft@2", "mineceraft@1"] {
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
        let expected = if version == "mineceraft@2" { vec![(&top, &holds), (&bottom, &fails)] } else { Vec::new() };
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
        // Nothing is amiss; only that the commands of the second guide are nothing to the first profile.
        let mut notes = replayed["notes"].as_array().unwrap().iter();
        let is_expected = notes.all(|note| note.as_str().unwrap().contains("under published"));
        assert!(replayed["error"].is_null() && is_expected, "{replayed}");
        assert_eq!(replayed["events"].as_array().unwrap().len(), events, "{replayed}");
        // A model that answers with the whole guide has answered with its example.
        let answer =
            json!({ "task": "walls/5x1x5-raise", "profile": profile, "answer": guide["text"], "detail": "report" });
        let graded = service.post_json("/v1/grade", &answer).await.json();
        assert_eq!(graded["report"]["turns"][0]["blocks"], events, "{graded}");
    }
    assert_eq!(service.get("/v1/agent-guide?profile=none").await.status, StatusCode::BAD_REQUEST);
}

/// Prompts of both tracks, the preamble of the short one, and what no check measures.
#[tokio::test]
async fn a_suite_has_two_tracks_of_prompts() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let suite = service.get("/v1/suites/mineceraft").await.json();
    assert_eq!((&suite["id"], &suite["tracks"]), (&json!("mineceraft@4"), &json!(["specified", "brief"])));
    assert!(suite["preamble"].as_str().unwrap().contains("A door is one object"), "{suite}");
    let before = service.get("/v1/suites/mineceraft@2").await.json();
    assert_eq!((&before["tracks"], before.get("preamble")), (&json!(["specified"]), None));

    let path = "/v1/tasks/bedrooms/r3-hostel";
    let whole = service.get(path).await.json();
    assert_eq!(whole["unmeasured"], json!(["in which room a bed stands"]));
    let turn = &whole["turns"][0];
    assert_eq!(turn["brief"], "Create a hostel that offers three bedrooms. It holds exactly three beds.");
    let prompt = turn["prompt"].as_str().unwrap();
    assert!(prompt.contains("exactly three beds") && prompt.contains("Not measured: in which room"), "{prompt}");
    let brief = service.get(&format!("{path}?track=brief&for=agent")).await;
    assert_eq!(brief.json()["turns"], json!([{ "prompt": turn["brief"] }]));
    assert!(!brief.text.contains("nine cells"), "{}", brief.text);
    let listed = service.get("/v1/tasks?track=brief&family=revisions&limit=1").await.json();
    assert_eq!(listed["tasks"][0]["prompts"].as_array().unwrap().len(), 2);
    assert_eq!(listed["tasks"][0]["prompt"], "A client orders a house with exactly one room. Build it.");
    for wrong in ["?track=brief&suite=mineceraft@2", "?track=short", "?track="] {
        assert_eq!(service.get(&format!("{path}{wrong}")).await.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
}

//! Limits of episodes: steps, number, time.

use crate::support::epoch::{Scene, id};
use plumbline_engine::tasks::embedded;
use reqwest::StatusCode;
use serde_json::{Value, json};

fn task() -> String {
    embedded::latest().unwrap().tasks[0].id.clone()
}

async fn shown(scene: &Scene, key: &str, episode: &str) -> Value {
    let get = scene.service.http.get(format!("{}{episode}", scene.service.url)).bearer_auth(key);
    scene.service.send(get).await.json()
}

async fn limit(scene: &Scene, name: &str) -> i64 {
    scene.service.get("/v1/limits").await.json()[name].as_i64().unwrap()
}

#[tokio::test]
async fn an_episode_takes_so_many_steps_and_is_graded_with_them() {
    let scene = Scene::new(&["--per-instance", "1"]);
    let key = scene.key("lab");
    let most = limit(&scene, "episode_steps").await;
    let opened = scene.made(&key, "/v1/episodes", &json!({ "task": task() })).await;
    let episode = format!("/v1/episodes/{}", id(&opened));
    let steps = format!("{episode}/steps");
    for number in 1..=most {
        let event = json!({ "action": "place", "x": number % 100, "y": number / 100, "z": 0, "material": "stone" });
        scene.made(&key, &steps, &json!({ "step": number, "events": [event] })).await;
    }
    let shown = shown(&scene, &key, &episode).await;
    assert_eq!((&shown["steps_left"], &shown["state"]), (&json!(0), &json!("open")));
    let further = scene.post(&key, &steps, &json!({ "step": most + 1, "events": [] })).await;
    assert_eq!(further.status, StatusCode::CONFLICT, "{}", further.text);
    assert!(further.text.contains(&format!("{most} steps; submit it")), "{}", further.text);
    // What was made is not lost.
    scene.made(&key, &format!("{episode}/submit"), &json!({})).await;
}

#[tokio::test]
async fn an_owner_has_so_many_episodes_open_and_may_open_more_when_some_are_over() {
    let scene = Scene::new(&["--per-instance", "1"]);
    let key = scene.key("lab");
    let most = limit(&scene, "episodes_per_owner").await;
    let body = json!({ "task": task() });
    let first = scene.made(&key, "/v1/episodes", &body).await;
    for _ in 1..most {
        scene.made(&key, "/v1/episodes", &body).await;
    }
    let refused = scene.post(&key, "/v1/episodes", &body).await;
    assert!(refused.status.is_client_error(), "{}", refused.text);
    assert!(refused.text.contains(&most.to_string()), "the limit is named: {}", refused.text);
    let other = scene.key("other");
    scene.made(&other, "/v1/episodes", &body).await;

    // Expired ones make room. They take no steps, say so, and what they hold can still be read.
    let seconds = limit(&scene, "episode_seconds").await;
    scene.set_clock(seconds * 1_000 + 60_000);
    let path = format!("/v1/episodes/{}", id(&first));
    let late = scene.post(&key, &format!("{path}/steps"), &json!({ "step": 1, "events": [] })).await;
    assert_eq!(late.status, StatusCode::CONFLICT, "{}", late.text);
    assert!(late.text.contains("expired"), "{}", late.text);
    let shown = shown(&scene, &key, &path).await;
    assert_eq!(shown["state"], "expired", "{shown}");
    scene.made(&key, "/v1/episodes", &body).await;
}

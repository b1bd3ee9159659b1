//! Events of webhooks across the nodes of one PostgreSQL database.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::support::Service;
use crate::support::endpoint::Endpoint;
use crate::support::nodes::Nodes;

const ARGUMENTS: [&str; 4] = ["serve", "--webhooks-to-private-addresses", "--webhook-retry-seconds", "1,1,1"];

/// Posts as many logs of one block as a request takes at once, each to be graded, and returns their identifiers.
async fn post(node: &Service, key: &str, first: usize, count: usize) -> Vec<String> {
    let line = |x| json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": [[x, 0, 0, 0]] }] }).to_string();
    let lines: Vec<String> = (first..first + count).map(line).collect();
    let request = node.http.post(format!("{}/v1/submissions", node.url)).bearer_auth(key);
    let posted = node.send(request.header("content-type", "application/x-ndjson").body(lines.join("\n"))).await;
    assert_eq!(posted.status, StatusCode::ACCEPTED, "{}", posted.text);
    let accepted = posted.json();
    accepted["submissions"].as_array().unwrap().iter().map(|one| one["id"].as_str().unwrap().to_owned()).collect()
}

/// Both nodes look for new events all the time, and either may come second with fewer or more of them. No event is left
/// out, none becomes two messages, and a node that dies amid its attempts leaves them to the other.
#[tokio::test]
async fn no_event_is_lost_or_told_twice_between_nodes() {
    let scene = Nodes::new();
    let [survivor, dying] = [(); 2].map(|()| scene.start(&ARGUMENTS));
    let key = scene.key("lab");
    let endpoint = Endpoint::start(&[200]).await;
    let request = survivor.http.post(format!("{}/v1/webhooks", survivor.url)).bearer_auth(&key);
    let made = survivor.send(request.json(&json!({ "url": endpoint.url }))).await;
    assert_eq!(made.status, StatusCode::CREATED, "{}", made.text);

    let mut accepted = BTreeSet::new();
    for round in 0..4 {
        let (one, other) =
            tokio::join!(post(&survivor, &key, round * 200, 100), post(&dying, &key, round * 200 + 100, 100));
        accepted.extend(one.into_iter().chain(other));
    }
    endpoint.wait_for(200).await;
    dying.kill();

    let told = async {
        loop {
            let told: BTreeSet<String> = messages(&endpoint).into_values().map(|(submission, _)| submission).collect();
            if told.len() == accepted.len() {
                return told;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    // Attempts of a node that died are made again after a minute.
    let told = tokio::time::timeout(Duration::from_mins(4), told).await.unwrap_or_else(|_| {
        panic!("{} of {} submissions were told", messages(&endpoint).len(), accepted.len());
    });
    assert_eq!(told, accepted);
    // A message may come again under its own identifier, never under another.
    assert_eq!(messages(&endpoint).len(), accepted.len());
}

/// Returns the messages that came, by identifier: the submission, and the text, which never changes.
fn messages(endpoint: &Endpoint) -> BTreeMap<String, (String, Value)> {
    let mut messages: BTreeMap<String, (String, Value)> = BTreeMap::new();
    for (id, message) in endpoint.received.lock().unwrap().iter() {
        let submission = message["data"]["submission"].as_str().unwrap().to_owned();
        let first = messages.entry(id.clone()).or_insert_with(|| (submission, message.clone()));
        assert_eq!(first.1, *message, "the text of a message changed");
    }
    messages
}

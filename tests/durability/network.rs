//! A node on a network of its own, whose cable is pulled: nothing comes and nothing is refused, as from a machine that is
//! gone. Needs root, for network namespaces; elsewhere `tests/support/line.rs` alone stands in for the network.

use std::process::Command;
use std::time::Duration;

use serde_json::json;

use crate::support::audit::audit_books;
use crate::support::cluster::Cluster;
use crate::support::nodes::Nodes;
use crate::support::{PROGRAM, Service};

/// A network namespace with a cable to this one.
struct Network {
    name: String,
    cable: String,
    /// The beginning of the addresses of both ends.
    addresses: String,
}

fn ip(arguments: &[&str]) -> Result<(), String> {
    let output = Command::new("ip").args(arguments).output().map_err(|error| error.to_string())?;
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

impl Network {
    /// Makes a namespace whose end of the cable has the address `.2`; this one's has `.1`.
    fn new() -> Result<Self, String> {
        let id = std::process::id();
        let own =
            Self { name: format!("plt{id}"), cable: format!("plc{id}"), addresses: format!("10.213.{}.", id % 250) };
        let far = format!("{}f", own.cable);
        let (near_address, far_address) = (format!("{}1/30", own.addresses), format!("{}2/30", own.addresses));
        ip(&["netns", "add", &own.name])?;
        ip(&["link", "add", &own.cable, "type", "veth", "peer", "name", &far])?;
        ip(&["link", "set", &far, "netns", &own.name])?;
        ip(&["address", "add", &near_address, "dev", &own.cable])?;
        ip(&["link", "set", &own.cable, "up"])?;
        ip(&["-n", &own.name, "address", "add", &far_address, "dev", &far])?;
        ip(&["-n", &own.name, "link", "set", &far, "up"])?;
        ip(&["-n", &own.name, "link", "set", "lo", "up"])?;
        Ok(own)
    }

    /// Pulls the cable, or puts it in again.
    fn set(&self, state: &str) {
        ip(&["link", "set", &self.cable, state]).unwrap();
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        let _ = ip(&["link", "delete", &self.cable]);
        let _ = ip(&["netns", "delete", &self.name]);
    }
}

#[tokio::test]
async fn a_node_whose_cable_is_pulled_holds_nothing_up_and_comes_back() {
    let network = match Network::new() {
        Ok(network) => network,
        Err(why) => {
            eprintln!("this machine makes no network namespaces: {why}");
            return;
        }
    };
    let near = format!("{}1", network.addresses);
    let cluster = Cluster::start(&[&format!("listen_addresses=127.0.0.1,{near}")]);
    cluster.create("grades");
    cluster.trust(&format!("{}0/30", network.addresses)).await;
    let nodes = Nodes::on(cluster);
    let serves = nodes.start(&["serve", "--open", "--workers", "0"]);
    let work = ["work", "--workers", "1", "--lease-seconds", "4"];
    let far_url = nodes.url().replace("127.0.0.1", &near);
    let mut far = Command::new("ip");
    far.args(["netns", "exec", &network.name, PROGRAM]).args(work).args(["--database", &far_url, "--secrets"]);
    far.arg(nodes.folder.path().join("secrets"));
    let far = Service::launch(far);

    let post = async |from: usize, to: usize| {
        let mut ids = Vec::new();
        for x in from..to {
            let body = json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": [[x, 0, 0, 0], [x, 1, 0, 0]] }] });
            let answer = serves.post_json("/v1/submissions", &body).await;
            assert_eq!(answer.status, 202, "{}", answer.text);
            ids.push(answer.json()["id"].as_str().unwrap().to_owned());
        }
        ids
    };
    let graded = async |ids: &[String]| {
        for id in ids {
            let one = serves.wait_for(&format!("/v1/submissions/{id}"), |one| !one["ended_at"].is_null()).await;
            assert_eq!(one["state"], "graded", "{one}");
        }
    };
    let mut all = post(0, 5).await;
    graded(&all).await;
    // The cable is pulled while the node has work; another one does it.
    let during = post(5, 60).await;
    network.set("down");
    let more = post(60, 80).await;
    tokio::time::sleep(Duration::from_secs(5)).await;
    let waiting = serves.get(&format!("/v1/submissions/{}", more[19])).await.json();
    assert_ne!(waiting["state"], "graded", "nobody is there to grade it");
    let second = nodes.start(&work);
    graded(&during).await;
    graded(&more).await;
    // It comes back, and is the only one that works.
    network.set("up");
    second.kill();
    let last = post(80, 90).await;
    graded(&last).await;
    all.extend([during, more, last].concat());
    drop(far);
    audit_books(&nodes.pool().await, &all, "after a cable was pulled").await;
}

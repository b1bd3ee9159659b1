//! Bad input: always a clear problem that names the place, and a server unharmed.

use crate::support::Service;
use serde_json::json;

const LIMIT: usize = 32 << 20;

fn service() -> (tempfile::TempDir, Service) {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    (folder, service)
}

#[tokio::test]
async fn every_fault_of_a_body_is_told_at_once() {
    let (_folder, service) = service();
    let body = json!({
        "task": "no/such", "colour": 1,
        "turns": [{ "events": [
            { "action": "place", "x": 1.5, "y": 4_000, "z": "a", "material": "stone" },
            { "action": "dance", "x": 30_000_001, "y": 0, "z": 0 },
        ] }, { "palette": ["stone"], "rows": [[0, 0, 0, 7], [0, 0]] }],
    });
    let mut faults = service.post_json("/v1/submissions", &body).await.faults(422);
    faults.sort();
    let expected = [
        "null /colour",
        "null /task",
        "null /turns/0/events/0/x",
        "null /turns/0/events/0/y",
        "null /turns/0/events/0/z",
        "null /turns/0/events/1/action",
        "null /turns/0/events/1/x",
        "null /turns/1/rows/0/3",
        "null /turns/1/rows/1",
    ];
    assert_eq!(faults, expected);
    let nulls = json!({ "run": null, "suite": null, "task": 1.0, "turns": [
        { "events": [{ "action": "remove", "x": 0, "y": 0, "z": 0, "material": null }], "palette": null, "rows": null }
    ] });
    let accepted = service.post_json("/v1/submissions", &nulls).await;
    assert_eq!(accepted.status, 202, "null is as good as absent: {}", accepted.text);
    let run = json!({ "agent": "", "suite": "none", "metadata": [], "extra": 0 });
    let faults = service.post_json("/v1/runs", &run).await.faults(422);
    assert_eq!(faults, ["null /agent", "null /extra", "null /metadata", "null /suite"]);
    // Names that would look like another agent's.
    for (sent, expected) in [("  one ", Some("one")), ("o\u{200b}ne", None), ("\u{202e}one", None), ("👩‍🔬", Some("👩‍🔬"))]
    {
        let made = service.post_json("/v1/runs", &json!({ "agent": sent, "suite": "mineceraft" })).await;
        assert_eq!(made.json()["agent"].as_str(), expected, "{sent:?}: {}", made.text);
    }
}

#[tokio::test]
async fn a_missing_or_ill_fitting_log_is_refused_and_an_empty_turn_is_not() {
    let (_folder, service) = service();
    let (service, path) = (&service, "/v1/submissions");
    let post = async |turns: serde_json::Value| service.post_json(path, &json!({ "task": 1, "turns": turns })).await;
    assert_eq!(post(json!([])).await.faults(422), ["null /turns"]);
    assert_eq!(post(json!([{}])).await.faults(422), ["null /turns/0"]);
    assert_eq!(post(json!([{ "events": [] }, { "events": [] }])).await.faults(422), ["null /turns"]);
    assert_eq!(post(json!([{ "events": [] }])).await.status, 202);
    assert_eq!(service.post_json(path, &json!({})).await.faults(422), ["null /task", "null /turns"]);
}

#[tokio::test]
async fn what_is_not_json_is_told_with_its_line() {
    let (_folder, service) = service();
    let json = "application/json";
    assert_eq!(service.post("/v1/submissions", json, "{\"task\": 1,").await.faults(400), ["null "]);
    assert_eq!(service.post("/v1/submissions", json, "").await.faults(400), ["null "]);
    let huge = "{\"colour\":1,\"turns\":[{\"events\":[{\"x\":1e400}]}],\"task\":1}";
    let faults = service.post("/v1/submissions", json, huge).await.faults(422);
    assert_eq!(faults, ["null /colour", "null /turns/0/events/0/x"]);
    let lines = service.post("/v1/submissions", "application/x-ndjson", "{\"task\":1\n{}\nnone").await;
    assert_eq!(lines.faults(400), ["1 ", "2 /task", "2 /turns", "3 "]);
    assert!(service.post("/v1/submissions", "text/plain", "{}").await.faults(415).is_empty());
}

#[tokio::test]
async fn sizes_are_bounded_before_they_hurt() {
    let (_folder, service) = service();
    let json = "application/json";
    let rows = |n: usize| format!("{{\"task\":1,\"turns\":[{{\"rows\":[{}]}}]}}", vec!["[0,0,0]"; n].join(","));
    let ten_million = service.post("/v1/submissions", json, rows(10_000_000)).await;
    assert!(ten_million.faults(413).is_empty());
    let too_many = service.post("/v1/submissions", json, rows(400_001)).await;
    assert_eq!(too_many.faults(422), ["null /turns"]);
    let deep = format!("{{\"task\":1,\"turns\":{}{}}}", "[".repeat(100_000), "]".repeat(100_000));
    assert_eq!(service.post("/v1/submissions", json, deep).await.faults(422), ["null /turns/0"]);
    let deep = format!(
        "{{\"agent\":\"a\",\"suite\":\"mineceraft\",\"metadata\":{{\"a\":{}1{}}}}}",
        "[".repeat(200),
        "]".repeat(200)
    );
    let faults = service.post("/v1/runs", json, deep).await.faults(400);
    assert_eq!(faults, ["null /metadata"]);
    let blocks: Vec<_> = (0..100_001).map(|i| json!([i, 0, 0, 0])).collect();
    let body = json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": blocks }] });
    assert_eq!(service.post_json("/v1/submissions", &body).await.faults(422), ["null /turns"]);
    assert_eq!(service.get("/healthz").await.status, 200);
}

#[tokio::test]
async fn bombs_and_endless_bodies_are_cut_off() {
    let (_folder, service) = service();
    let gib = 1usize << 30;
    let bomb = {
        let mut encoder = zstd::Encoder::new(Vec::new(), 3).unwrap();
        std::io::copy(&mut std::io::Read::take(std::io::repeat(b' '), gib as u64), &mut encoder).unwrap();
        encoder.finish().unwrap()
    };
    assert!(bomb.len() < 1 << 20);
    let request = service.http.post(format!("{}/v1/submissions", service.url));
    let request = request.header("content-type", "application/json").header("content-encoding", "zstd").body(bomb);
    assert!(service.send(request).await.faults(413).is_empty());

    // A body that says how long it is, and is not sent: the answer comes from the header alone.
    let address = service.url.strip_prefix("http://").unwrap();
    let mut socket = std::net::TcpStream::connect(address).unwrap();
    let head = format!(
        "POST /v1/submissions HTTP/1.1\r\nhost: x\r\ncontent-type: application/json\r\ncontent-length: {gib}\r\n\r\n"
    );
    std::io::Write::write_all(&mut socket, head.as_bytes()).unwrap();
    let mut answer = [0u8; 12];
    std::io::Read::read_exact(&mut socket, &mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 413");

    let status = std::fs::read_to_string(format!("/proc/{}/status", service.process_id())).unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    let peak_kb: usize = peak.trim().trim_end_matches(" kB").parse().unwrap();
    assert!(peak_kb * 1024 < 8 * LIMIT, "peak memory {peak_kb} kB");
}

#[tokio::test]
async fn unknown_places_and_methods_are_problems_too() {
    let (_folder, service) = service();
    assert!(service.get("/nowhere").await.faults(404).is_empty());
    let one_segment = service.get("/v1/tasks/113").await.json();
    assert!(
        one_segment["detail"].as_str().unwrap().ends_with("; did you mean /v1/tasks/{family}/{instance}?"),
        "{one_segment}"
    );
    assert!(service.get("/v1/submissions/none").await.faults(404).is_empty());
    assert!(service.get("/v1/submissions/none/report").await.faults(404).is_empty());
    assert!(service.get("/v1/runs/none").await.faults(404).is_empty());
    assert!(service.get("/v1/leaderboards/none").await.faults(404).is_empty());
    assert!(service.get("/v1/tasks/none/none").await.faults(404).is_empty());
    assert_eq!(service.get("/v1/tasks?limit=0").await.json()["faults"][0]["parameter"], "limit");
    assert_eq!(service.get("/v1/tasks?colour=red").await.json()["faults"][0]["parameter"], "colour");
    // A misspelt name is told with what it may have meant.
    for (path, meant) in [
        ("/v1/tasks?family=wals", "walls"),
        ("/v1/tasks?type=frame", "frames"),
        ("/v1/tasks?criterion=shap", "shape"),
        ("/v1/tasks/walls/5x1x5-rais", "walls/5x1x5-raise"),
        ("/v1/leaderboards/mineceraft?sort=overal", "overall"),
    ] {
        let text = service.get(path).await.text;
        assert!(text.contains(&format!("did you mean {meant}")), "{path}: {text}");
    }
    let named = json!({ "task": "wall/5x1x5-raise", "turns": [] });
    assert!(service.post_json("/v1/validate", &named).await.text.contains("did you mean walls"));
    // Text that is no JSON is told with its place and the reason.
    let turns = |x: &str| format!("{{\"task\":113,\"turns\":[{{\"events\":[{{\"action\":\"place\",\"x\":{x}}}]}}]}}");
    for door in ["/v1/validate", "/v1/grade"] {
        let answer = service.post(door, "application/json", turns("NaN")).await;
        assert_eq!(answer.faults(400), ["null /turns/0/events"]);
        assert!(answer.text.contains("at line 1 column 55: JSON has no NaN"), "{}", answer.text);
        let answer = service.post(door, "application/json", b"{\"task\": \"\xff\"}".to_vec()).await;
        assert!(answer.status == 400 && answer.text.contains("not UTF-8: byte 0xff at offset 10"), "{}", answer.text);
    }
    // Bodies of plain data tell all their faults too.
    let run = service.post_json("/v1/replay", &json!({ "action_cod": "x", "extra": 1 })).await;
    let mut places = run.faults(422);
    places.sort();
    assert_eq!(places, ["null /action_cod", "null /action_code", "null /extra"]);
    assert!(run.text.contains("a replay has profile, and action_code or turns"), "{}", run.text);
    let delete = service.send(service.http.delete(format!("{}/v1/runs", service.url))).await;
    assert!(delete.faults(405).is_empty());
    let allowed = delete.headers["allow"].to_str().unwrap();
    assert!(["GET", "POST"].iter().all(|method| allowed.contains(method)), "{allowed}");
}

#[test]
fn slow_and_silent_clients_are_hung_up_on() {
    let (_folder, service) = service();
    let address = service.url.strip_prefix("http://").unwrap();
    let connect = |begin: &'static [u8]| {
        let mut socket = std::net::TcpStream::connect(address).unwrap();
        std::io::Write::write_all(&mut socket, begin).unwrap();
        socket.set_read_timeout(Some(std::time::Duration::from_secs(20))).unwrap();
        socket
    };
    for mut socket in [connect(b"GET /healthz HTTP/1.1\r\nhost:"), connect(b""), connect(b"PRI")] {
        let mut rest = Vec::new();
        std::io::Read::read_to_end(&mut socket, &mut rest).expect("the server closes the connection by itself");
    }
}

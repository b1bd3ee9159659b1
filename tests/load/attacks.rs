//! What one client does to the others: work that takes long, many requests at once, connections that take nothing.

use std::os::unix::fs::PermissionsExt as _;
use std::sync::Arc;
use std::time::Duration;

use crate::support::commands::key;
use crate::support::{Answer, Service};
use rand_mt::Mt64;
use reqwest::StatusCode;
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

type StepRange = std::iter::StepBy<std::ops::RangeInclusive<i32>>;

fn start(options: &[&str]) -> (tempfile::TempDir, Arc<Service>) {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), options);
    (folder, Arc::new(service))
}

fn turn(blocks: impl Iterator<Item = [i32; 3]>) -> Value {
    let events = blocks.map(|[x, y, z]| json!({ "action": "place", "x": x, "y": y, "z": z, "material": "stone" }));
    json!({ "events": events.collect::<Vec<_>>() })
}

/// A task with so many of a check in each of so many turns, and a log of it: what takes long is what is asked of few
/// blocks.
fn asking(check: &Value, checks: usize, turns: usize, blocks: Value, deadline_ms: u64) -> Value {
    let asked = json!({ "checks": vec![check; checks] });
    let mut log = vec![json!({ "events": [] }); turns];
    log[0] = blocks;
    json!({ "task": { "id": "hard/one", "turns": vec![asked; turns] }, "turns": log, "deadline_ms": deadline_ms })
}

/// A hall whose walls are single blocks, with gaps that a box 16 wide does not fit through. Between them are single blocks
/// that leave it many ways, which end at the walls, and beds to start from.
fn filled_hall() -> Value {
    const SIZE: [i32; 3] = [150, 120, 600];
    let [x, y, z] = SIZE.map(|size| (0..=size).step_by(15));
    let pairs = |a: StepRange, b: StepRange| a.flat_map(move |i| b.clone().map(move |j| (i, j)));
    let faces = pairs(x.clone(), y.clone())
        .flat_map(|(i, j)| [[i, j, 0], [i, j, SIZE[2]]])
        .chain(pairs(x, z.clone()).flat_map(|(i, k)| [[i, 0, k], [i, SIZE[1], k]]))
        .chain(pairs(y, z).flat_map(|(j, k)| [[0, j, k], [SIZE[0], j, k]]));
    let mut random = Mt64::new(24);
    let mut inside = move || SIZE.map(|size| 1 + (random.next_u64() % (size as u64 - 1)) as i32);
    let mut log = turn(faces.chain(std::iter::repeat_with(&mut inside).take(2_500)));
    let bed = |[x, y, z]: [i32; 3]| json!({ "action": "place", "x": x, "y": y, "z": z, "material": "red_bed" });
    let beds = std::iter::repeat_with(&mut inside).take(200).map(bed);
    log["events"].as_array_mut().unwrap().extend(beds);
    log
}

/// Minutes of work: a wide way out is looked for all over a hall that has none.
fn hard(deadline_ms: u64) -> Value {
    let args = json!({ "width": 16, "depth": 15, "height": 16, "start_material": "bed" });
    asking(&json!({ "fn": "shape.has_exit", "args": args }), 16, 64, filled_hall(), deadline_ms)
}

/// A beam that holds a stress simulation for long.
fn beam(length: i32, deadline_ms: u64) -> Value {
    let stress = json!({ "fn": "structural_stability.stress_score", "args": { "von_mises_stress": 1.0 } });
    asking(&stress, 1, 1, turn(std::iter::once([0, 0, 0]).chain((1..length).map(|i| [i - 1, 1, 0]))), deadline_ms)
}

fn easy() -> Value {
    json!({ "task": "walls/5x1x5-raise", "turns": [turn((0..25).map(|i| [i % 5, i / 5, 0]))] })
}

async fn grade(service: &Service, body: &Value, key: Option<&str>) -> Answer {
    let mut request = service.http.post(format!("{}/v1/grade", service.url)).json(body);
    if let Some(key) = key {
        request = request.bearer_auth(key);
    }
    service.send(request).await
}

#[tokio::test]
async fn hard_gradings_stop_nobody() {
    let (_folder, service) = start(&[]);
    let hard_ones: Vec<_> = (0..4)
        .map(|_| {
            let service = Arc::clone(&service);
            tokio::spawn(async move { grade(&service, &hard(8_000), None).await })
        })
        .collect();
    tokio::time::sleep(Duration::from_millis(500)).await;
    assert_eq!(service.get("/healthz").await.status, StatusCode::OK);
    assert_eq!(grade(&service, &easy(), None).await.status, StatusCode::OK);
    assert!(hard_ones.iter().all(|one| !one.is_finished()), "what is hard was to take longer than this");
    for one in hard_ones {
        let answer = one.await.unwrap();
        assert_eq!(answer.status, StatusCode::GATEWAY_TIMEOUT, "{}", answer.text);
        assert_eq!(answer.json()["reward"], Value::Null);
    }
}

#[tokio::test]
async fn one_owner_s_heavy_logs_do_not_time_out_another_s() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Arc::new(Service::start_as_told(&database, &[]));
    let (many, one) = (key(&database, "many"), key(&database, "one"));
    let heavy: Vec<_> = (0..8)
        .map(|i| {
            let (service, many) = (Arc::clone(&service), many.clone());
            tokio::spawn(async move { grade(&service, &beam(9_000 + i, 20_000), Some(&many)).await.status })
        })
        .collect();
    tokio::time::sleep(Duration::from_millis(500)).await;
    let small = grade(&service, &beam(300, 10_000), Some(&one)).await;
    assert_eq!(small.status, StatusCode::OK, "{}", small.text);
    // Also what is long has its turn, beside one of the other's.
    let longer = grade(&service, &beam(1_500, 20_000), Some(&one)).await;
    assert_eq!(longer.status, StatusCode::OK, "{}", longer.text);
    for one in heavy {
        one.abort();
    }
}

#[tokio::test]
async fn what_a_client_that_left_asked_for_ends() {
    let (_folder, service) = start(&[]);
    for _ in 0..3 {
        let gone = tokio::time::timeout(Duration::from_millis(300), grade(&service, &hard(50_000), None)).await;
        assert!(gone.is_err(), "what is hard was to take longer than this");
    }
    let line = hard(50_000).to_string();
    let batch =
        service.http.post(format!("{}/v1/grade:batch", service.url)).header("content-type", "application/x-ndjson");
    let batch = batch.body([line.as_str(); 3].join("\n")).send();
    if let Ok(Ok(mut begun)) = tokio::time::timeout(Duration::from_secs(5), batch).await {
        let _ = tokio::time::timeout(Duration::from_millis(300), begun.chunk()).await;
    }
    // Long ones have their turn in time, so none of those that nobody waits for goes on.
    let next = grade(&service, &beam(1_500, 15_000), None).await;
    assert_eq!(next.status, StatusCode::OK, "{}", next.text);
}

/// Memory of the process, in MiB.
fn resident(service: &Service) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", service.process_id())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() >> 10
}

#[tokio::test]
async fn findings_and_the_cache_of_results_are_bounded() {
    let (_folder, service) = start(&[]);
    let vault = json!({ "fn": "shape.is_vault", "args": { "min_clear": 1 } });
    let arch = json!({ "fn": "shape.is_true_arch", "args": { "support_y": 0 } });
    for (i, check) in [&vault, &arch].into_iter().cycle().take(16).enumerate() {
        let length = 10_000 + i as i32;
        // A long bridge: what is measured is a list as long as it.
        let bridge = turn((0..length).map(|x| [x, i32::from(x > 0 && x < length - 1) * 3, 0]));
        let mut body = asking(check, 12, 64, bridge, 50_000);
        body["detail"] = "report".into();
        let graded = grade(&service, &body, None).await;
        assert_eq!(graded.status, StatusCode::OK, "{}", &graded.text[..300]);
        let found = &graded.json()["report"]["turns"][0]["checks"][0];
        for (_, list) in found["measured"].as_object().unwrap() {
            assert!(list.as_array().is_none_or(|list| list.len() <= 64), "{found}");
        }
        assert!(found["measured"]["along_x"].is_null() || found["shortened"] == true, "{found}");
        let memory = resident(&service);
        assert!(memory < 256, "{memory} MiB after {} requests", i + 1);
    }
    let long: Vec<String> = (0..65).map(|i| format!("m{i}")).collect();
    let layers = json!({ "fn": "dependency.layers_follow", "args": { "layers": long, "min_blocks": 0 } });
    let listed = grade(&service, &asking(&layers, 1, 1, turn(std::iter::once([0, 0, 0])), 1_000), None).await;
    assert_eq!(listed.faults(422), ["null /task/turns/0/checks"]);
    let too_many = asking(&vault, 17, 64, turn(std::iter::once([0, 0, 0])), 1_000);
    assert_eq!(grade(&service, &too_many, None).await.faults(422), ["null /task/turns"]);
}

#[tokio::test]
async fn endless_scripts_delay_no_other() {
    let (_folder, service) = start(&[]);
    // Each is code of its own, because what one did is remembered.
    let endless: Vec<_> = (0..16)
        .map(|i| {
            let service = Arc::clone(&service);
            let body = json!({ "action_code": format!("(async (bot) => {{ for (let i = {i}; ; ) {{}} }})") });
            tokio::spawn(async move { service.post_json("/v1/replay", &body).await })
        })
        .collect();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let empty = service.post_json("/v1/replay", &json!({ "action_code": "(async (bot) => {})" })).await;
    assert_eq!(empty.status, StatusCode::OK, "{}", empty.text);
    let done = endless.iter().filter(|one| one.is_finished()).count();
    assert!(done < 8, "{done} endless scripts came before one that does nothing");
    for one in endless {
        let stopped = one.await.unwrap();
        assert_eq!(stopped.faults(422), ["null /action_code"]);
        assert!(stopped.text.contains("more than 2000 ms"), "{}", stopped.text);
    }
}

#[tokio::test]
async fn memory_that_ran_out_is_a_limit_also_where_the_script_hides_it() {
    let (_folder, service) = start(&[]);
    let place = "await skills.placeBlock(bot, 'stone', 0, 0, 0);";
    let fill = "const kept = []; for (;;) kept.push(new Array(1000).fill(kept.length));";
    for code in [
        format!("(async (bot) => {{ {place} {fill} }})"),
        format!("(async (bot) => {{ {place} try {{ {fill} }} catch (error) {{ }} }})"),
        format!(
            "(async (bot) => {{ {place} let s = 'x'; const all = []; for (;;) {{ all.push({{ s: s + all.length }}); }} }})"
        ),
    ] {
        let stopped = service.post_json("/v1/replay", &json!({ "action_code": code })).await;
        assert_eq!(stopped.faults(422), ["null /action_code"], "{code}");
        assert!(stopped.text.contains("bytes of memory"), "{code}: {}", stopped.text);
    }
    let thrown = json!({ "action_code": format!("(async (bot) => {{ {place} throw null; }})") });
    let answer = service.post_json("/v1/replay", &thrown).await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.text);
    let thrown = answer.json();
    assert_eq!(
        (thrown["error"]["message"].as_str(), thrown["events"].as_array().map(Vec::len)),
        (Some("thrown: null"), Some(1)),
        "{}",
        answer.text
    );
}

#[tokio::test]
async fn a_stress_field_is_computed_once() {
    let (_folder, service) = start(&[]);
    let log = turn((0..200).map(|i| [i % 20, i / 20, 0]));
    let posted = service.post_json("/v1/submissions", &json!({ "task": "walls/5x1x5-raise", "turns": [log] })).await;
    assert_eq!(posted.status, StatusCode::ACCEPTED, "{}", posted.text);
    let id = posted.json()["id"].as_str().unwrap().to_owned();
    let mut shown = Vec::new();
    for format in ["json", "ndjson", "arrays", "json"] {
        let field = service.get(&format!("/v1/submissions/{id}/stress?format={format}")).await;
        assert_eq!(field.status, StatusCode::OK, "{}", field.text);
        shown.push(field.text);
    }
    assert_eq!(shown[0], shown[3]);
    let metrics = service.get("/metrics").await.text;
    assert!(metrics.contains("plumbline_stress_fields_computed_total 1\n"), "{metrics}");
}

#[tokio::test]
async fn one_address_has_its_part_of_the_streams_and_all_are_told() {
    let (_folder, service) = start(&[]);
    let limits = service.get("/v1/limits").await.json();
    let each = limits["event_streams_per_sender"].as_u64().unwrap() as usize;
    let mut streams = Vec::new();
    for _ in 0..each {
        let stream = service.http.get(format!("{}/v1/events", service.url)).send().await.unwrap();
        assert_eq!(stream.status(), StatusCode::OK);
        streams.push(stream);
    }
    assert_eq!(service.get("/v1/events").await.status, StatusCode::TOO_MANY_REQUESTS);
    let posted = service
        .post_json("/v1/submissions", &json!({ "task": "walls/5x1x5-raise", "turns": [{ "events": [] }] }))
        .await;
    let id = posted.json()["id"].as_str().unwrap().to_owned();
    for stream in &mut streams {
        let told =
            tokio::time::timeout(Duration::from_secs(20), stream.chunk()).await.expect("an event").unwrap().unwrap();
        assert!(String::from_utf8_lossy(&told).contains(&id));
    }
}

/// Sends bytes as they are, and gives the first line of what comes back.
async fn raw(service: &Service, text: &str) -> String {
    let mut stream = TcpStream::connect(service.url.trim_start_matches("http://")).await.unwrap();
    stream.write_all(text.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    let _ = tokio::time::timeout(Duration::from_secs(5), stream.read_to_end(&mut answer)).await;
    String::from_utf8_lossy(&answer).lines().next().unwrap_or_default().to_owned()
}

#[tokio::test]
async fn a_request_names_one_host() {
    let (_folder, service) = start(&[]);
    let with = |hosts: &str, version: &str| format!("GET /healthz HTTP/{version}\r\n{hosts}Connection: close\r\n\r\n");
    assert_eq!(raw(&service, &with("Host: a\r\n", "1.1")).await, "HTTP/1.1 200 OK");
    assert_eq!(raw(&service, &with("", "1.1")).await, "HTTP/1.1 400 Bad Request");
    assert_eq!(raw(&service, &with("Host: a\r\nHost: b\r\n", "1.1")).await, "HTTP/1.1 400 Bad Request");
    assert_eq!(raw(&service, &with("", "1.0")).await, "HTTP/1.0 200 OK");
}

#[tokio::test]
async fn heads_are_as_long_as_the_limits_say() {
    let (_folder, service) = start(&[]);
    let limits = service.get("/v1/limits").await.json();
    let most = |name: &str| usize::try_from(limits[name].as_u64().unwrap()).unwrap();
    let asking =
        |path: &str, headers: &str| format!("GET {path} HTTP/1.1\r\nHost: a\r\n{headers}Connection: close\r\n\r\n");
    let path = |bytes: usize| format!("/{}", "a".repeat(bytes - 1));
    assert_eq!(raw(&service, &asking(&path(most("path_bytes")), "")).await, "HTTP/1.1 404 Not Found");
    assert_eq!(raw(&service, &asking(&path(most("path_bytes") + 1), "")).await, "HTTP/1.1 414 URI Too Long");
    // Two are there already.
    let headers = |count: usize| "X: y\r\n".repeat(count - 2);
    assert_eq!(raw(&service, &asking("/healthz", &headers(most("headers")))).await, "HTTP/1.1 200 OK");
    let refused = "HTTP/1.1 431 Request Header Fields Too Large";
    assert_eq!(raw(&service, &asking("/healthz", &headers(most("headers") + 1))).await, refused);
    let long = |bytes: usize| format!("X: {}\r\n", "y".repeat(bytes));
    assert_eq!(raw(&service, &asking("/healthz", &long(most("head_bytes") - 100))).await, "HTTP/1.1 200 OK");
    // Not a byte more than is read: what is left unread when a connection closes may take the answer with it.
    let cut = &asking("/healthz", &long(most("head_bytes")))[..most("head_bytes")];
    assert_eq!(raw(&service, cut).await, refused);
}

#[tokio::test]
async fn who_takes_no_answers_does_not_delay_the_end() {
    let (_folder, service) = start(&[]);
    let request = "GET /openapi.json HTTP/1.1\r\nHost: a\r\n\r\n".repeat(500);
    let mut stuck = Vec::new();
    for _ in 0..20 {
        let mut stream = TcpStream::connect(service.url.trim_start_matches("http://")).await.unwrap();
        let _ = tokio::time::timeout(Duration::from_millis(200), stream.write_all(request.as_bytes())).await;
        stuck.push(stream);
    }
    tokio::time::sleep(Duration::from_millis(500)).await;
    let ended = tokio::task::spawn_blocking(move || Arc::into_inner(service).unwrap().terminate());
    // The grace for answers under way is ten seconds; these are given one.
    let ended = tokio::time::timeout(Duration::from_secs(8), ended).await.expect("it ends before the grace is over");
    assert!(ended.unwrap(), "it ended badly");
}

#[tokio::test]
async fn keys_of_one_owner_share_a_rate_and_tables_hold_no_formulas() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start_as_told(&database, &["--rate-per-key", "5"]);
    let keys = [key(&database, "lab"), key(&database, "lab")];
    let send =
        |i: usize| service.send(service.http.get(format!("{}/v1/limits", service.url)).bearer_auth(&keys[i % 2]));
    let answers = futures_util::future::join_all((0..10).map(send)).await;
    let refused = answers.iter().filter(|answer| answer.status == StatusCode::TOO_MANY_REQUESTS).count();
    assert!(refused >= 3, "{refused} of ten requests at once were refused, where five a second are allowed");
    let docs = service.get("/docs/").await;
    assert_eq!(docs.status, StatusCode::OK);
    assert!(docs.headers["content-security-policy"].to_str().unwrap().contains("default-src 'none'"));
}

#[tokio::test]
async fn what_is_written_is_for_its_own_user_alone() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let mode = |name: &str| std::fs::metadata(file(name)).unwrap().permissions().mode() & 0o777;
    {
        let service = Service::start(&file("p.db"), &[]);
        service.finished_run("=1+1", 2).await;
        let table = service.get("/v1/leaderboards/mineceraft-lite?format=csv").await.text;
        assert!(table.contains(",'=1+1,"), "{table}");
        for name in ["p.db", "p.db-wal", "p.db-shm"] {
            assert_eq!(mode(name), 0o600, "{name}");
        }
    }
    let run = |arguments: &[&str]| {
        let done = crate::support::epoch::run(arguments, Some(&file("p.db")));
        assert!(done.status.success(), "{}", crate::support::epoch::said(&done));
    };
    run(&["backup", file("copy.db").to_str().unwrap()]);
    run(&["export", file("lines").to_str().unwrap()]);
    assert_eq!((mode("copy.db"), mode("lines"), mode("lines/runs.ndjson")), (0o600, 0o700, 0o600));
    // What an older program left open is taken from others when the service starts.
    std::fs::set_permissions(file("p.db"), std::fs::Permissions::from_mode(0o644)).unwrap();
    let _service = Service::start(&file("p.db"), &[]);
    assert_eq!(mode("p.db"), 0o600);
}

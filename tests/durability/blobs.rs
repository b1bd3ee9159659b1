//! Large logs outside the database, in a folder and in a bucket: what is acknowledged is there, nobody takes another place
//! for theirs, a place that does not answer loses nothing, and orphans are swept.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use plumbline::client::without_tls;
use plumbline::store::db::{query, query_scalar};
use serde_json::{Value, json};

use crate::support::audit::audit;
use crate::support::bucket::{ANY_SIGNATURE, BUCKET, BucketServer};
use crate::support::commands::{plumbline, refused, succeeded};
use crate::support::database::{copied, named, pool};
use crate::support::line::{Line, Passes};
use crate::support::{PROGRAM, Service};

/// A submission of blocks here and there, which packs badly: with 12,000 it becomes an object, with 100 it does not.
pub(super) fn scattered(blocks: u32, seed: u32) -> Value {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(1);
    let mut next = |below: u32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) % below
    };
    let rows: Vec<[u32; 4]> = (0..blocks).map(|_| [next(60), next(60), next(60), 0]).collect();
    json!({ "task": 1, "turns": [{ "palette": ["stone"], "rows": rows }] })
}

pub(super) const LARGE: u32 = 12_000;
pub(super) const SMALL: u32 = 100;

pub(super) struct Scene {
    folder: tempfile::TempDir,
}

impl Scene {
    pub(super) fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(super) fn blobs(&self, name: &str) -> String {
        format!("file://{}", self.path(name).display())
    }

    fn command(&self, database: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(PROGRAM);
        command.arg("serve").args(named(&self.path(database))).args(arguments).args(["--open", "--lease-seconds", "2"]);
        command
    }

    pub(super) fn start(&self, database: &str, arguments: &[&str]) -> Service {
        Service::launch(self.command(database, arguments))
    }

    /// Starts the service so that it dies at a crash point.
    pub(super) fn start_dying(&self, database: &str, at: &str) -> Service {
        let mut command = self.command(database, &[]);
        command.env("PLUMBLINE_TEST_KILL", at);
        Service::launch(command)
    }

    /// Starts the service where it must not start, and gives what it says.
    fn refused(&self, database: &str, arguments: &[&str], environment: &[(&str, String)]) -> String {
        let arguments = [&["serve", "--listen", "127.0.0.1:0", "--open"], arguments].concat();
        let mut limited = Command::new("timeout");
        let output: Output = limited
            .arg("30")
            .arg(PROGRAM)
            .args(arguments)
            .args(named(&self.path(database)))
            .envs(environment.iter().cloned())
            .output()
            .unwrap();
        refused(&output)
    }

    /// The column of a log, as text if it refers to an object.
    pub(super) async fn reference(&self, database: &str, id: &str) -> Option<String> {
        let log: Vec<u8> = query_scalar("SELECT log FROM submissions WHERE id = $1")
            .bind(id)
            .fetch_one(&pool(&self.path(database)).await)
            .await
            .unwrap();
        let text = String::from_utf8(log).ok()?;
        Some(text.strip_prefix("object:")?.to_owned())
    }
}

/// Files in a folder and the folders in it, by their paths from there.
pub(super) fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            found.extend(files(&path).iter().map(|below| format!("{name}/{below}")));
        } else {
            found.push(name);
        }
    }
    found.sort();
    found
}

pub(super) async fn post(service: &Service, body: &Value) -> String {
    let answer = service.post_json("/v1/submissions", body).await;
    assert_eq!(answer.status, 202, "{}", answer.text);
    answer.json()["id"].as_str().unwrap().to_owned()
}

pub(super) async fn graded(service: &Service, id: &str) -> Value {
    service.wait_for(&format!("/v1/submissions/{id}"), |submission| submission["state"] == "graded").await
}

#[tokio::test]
async fn large_logs_are_objects_and_every_door_reads_them() {
    let scene = Scene::new();
    let service = scene.start("p.db", &["--blobs", &scene.blobs("blobs")]);
    let (large, small) = (post(&service, &scattered(LARGE, 1)).await, post(&service, &scattered(SMALL, 2)).await);
    graded(&service, &large).await;
    graded(&service, &small).await;
    let log = service.get(&format!("/v1/submissions/{large}/log")).await;
    assert_eq!(log.json()["turns"][0].as_array().map(Vec::len), Some(LARGE as usize));
    let name = scene.reference("p.db", &large).await.unwrap();
    assert_eq!(scene.reference("p.db", &small).await, None, "small logs are rows");
    let mut found = files(&scene.path("blobs"));
    found.retain(|file| file != "plumbline.sweep");
    assert_eq!(found, [name.clone(), "plumbline.id".to_owned()]);
    let object = std::fs::read(scene.path("blobs").join(&name)).unwrap();
    let hash: String = plumbline_engine::tasks::hex(&sha2::Digest::finalize(sha2::Digest::chain_update(
        <sha2::Sha256 as sha2::Digest>::new(),
        &object,
    )));
    assert!(name.ends_with(&format!("/{hash}")), "{name} is not named by its SHA-256");

    // An export holds everything, and is imported where there are no blobs.
    succeeded(&plumbline(&["export", scene.path("lines").to_str().unwrap()], &scene.path("p.db")));
    service.kill();
    // The database notes the place.
    let service = scene.start("p.db", &[]);
    let again = service.get(&format!("/v1/submissions/{large}/log")).await;
    assert_eq!(again.text, log.text);
    let another = post(&service, &scattered(LARGE, 3)).await;
    assert!(scene.reference("p.db", &another).await.is_some());
    graded(&service, &another).await;
    service.kill();
    succeeded(&plumbline(&["migrate", "--create"], &scene.path("q.db")));
    succeeded(&plumbline(&["import", scene.path("lines").to_str().unwrap()], &scene.path("q.db")));
    let other = scene.start("q.db", &[]);
    assert_eq!(other.get(&format!("/v1/submissions/{large}/log")).await.text, log.text);
    other.kill();

    // What is damaged or gone is an error, never another log.
    let object_file = scene.path("blobs").join(&name);
    std::fs::write(&object_file, b"other").unwrap();
    let service = scene.start("p.db", &[]);
    let path = format!("/v1/submissions/{large}/log");
    assert_eq!(service.get(&path).await.status, 500);
    std::fs::remove_file(&object_file).unwrap();
    assert_eq!(service.get(&path).await.status, 500);
    std::fs::write(&object_file, object).unwrap();
    assert_eq!(service.get(&path).await.text, log.text);
}

#[tokio::test]
async fn nobody_takes_another_place_for_theirs() {
    let scene = Scene::new();
    let service = scene.start("p.db", &["--blobs", &scene.blobs("first")]);
    let large = post(&service, &scattered(LARGE, 1)).await;
    graded(&service, &large).await;
    let log = service.get(&format!("/v1/submissions/{large}/log")).await.text;
    service.kill();

    let told = scene.refused("p.db", &["--blobs", &scene.blobs("empty")], &[]);
    assert!(told.contains("lacks the blobs of this database") && told.contains("/first"), "{told}");
    let told = scene.refused("q.db", &["--blobs", &scene.blobs("first")], &[]);
    assert!(told.contains("holds blobs of another database"), "{told}");
    for (place, why) in [("blobs", "file:///"), ("ftp://x/y", "s3://NAME"), ("s3://a:b@c", "AWS_ACCESS_KEY_ID")] {
        let told = scene.refused("p.db", &["--blobs", place], &[]);
        assert!(told.contains(why), "{place}: {told}");
    }
    // A copy is the same place under another name, and is noted from then on.
    std::fs::rename(scene.path("first"), scene.path("moved")).unwrap();
    let service = scene.start("p.db", &[]);
    assert_eq!(service.get(&format!("/v1/submissions/{large}/log")).await.status.as_u16(), 503);
    service.kill();
    scene.start("p.db", &["--blobs", &scene.blobs("moved")]).kill();
    let service = scene.start("p.db", &[]);
    assert_eq!(service.get(&format!("/v1/submissions/{large}/log")).await.text, log);
}

#[tokio::test]
async fn a_kill_loses_nothing_and_orphans_are_swept() {
    let scene = Scene::new();
    let clock = scene.path("clock");
    std::fs::write(&clock, "0").unwrap();
    let start = || {
        let mut command = scene.command("p.db", &["--blobs", &scene.blobs("blobs")]);
        command.env("PLUMBLINE_TEST_CLOCK", &clock);
        Service::launch(command)
    };
    let mut acknowledged = Vec::new();
    for round in 0..2 {
        let service = start();
        for i in 0..4 {
            acknowledged.push(post(&service, &scattered(LARGE, 10 * round + i)).await);
        }
        service.kill();
    }
    // An orphan, as a transaction that failed leaves it, beside an object of somebody else.
    let day = scene.reference("p.db", &acknowledged[0]).await.unwrap()[..10].to_owned();
    let orphan = scene.path("blobs").join(&day).join("0".repeat(64));
    std::fs::write(&orphan, b"nobody's").unwrap();
    std::fs::write(scene.path("blobs").join("notes.txt"), b"an operator's").unwrap();
    let service = start();
    for id in &acknowledged {
        graded(&service, id).await;
    }
    service.kill();
    assert!(orphan.exists(), "it may be of a transaction that goes on");
    // Three days later.
    std::fs::write(&clock, (3 * 86_400_000).to_string()).unwrap();
    let service = start();
    let gone = async {
        while orphan.exists() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(Duration::from_mins(2), gone).await.expect("the orphan is swept");
    for id in &acknowledged {
        assert_eq!(service.get(&format!("/v1/submissions/{id}/log")).await.status, 200);
    }
    assert!(scene.path("blobs/notes.txt").exists());
    service.kill();
    audit(&scene.path("p.db"), &acknowledged, "after kills, with blobs").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bucket_that_does_not_answer_refuses_large_logs_for_a_while() {
    let scene = Scene::new();
    let server = BucketServer::start().await;
    let line = Line::to(server.port).await;
    let start = |arguments: &[&str]| {
        let mut command = scene.command("p.db", arguments);
        command.envs(BucketServer::environment(line.port));
        tokio::task::block_in_place(|| Service::launch(command))
    };
    let service = start(&["--blobs", &format!("s3://{BUCKET}/of/lab")]);
    let first = post(&service, &scattered(LARGE, 1)).await;
    graded(&service, &first).await;
    let log = service.get(&format!("/v1/submissions/{first}/log")).await;
    assert_eq!(log.json()["turns"][0].as_array().map(Vec::len), Some(LARGE as usize));
    let name = scene.reference("p.db", &first).await.unwrap();
    assert!(server.objects().await.contains(&format!("of/lab/{name}")), "{:?}", server.objects().await);

    // Without workers, jobs wait. Then the bucket goes away.
    service.kill();
    let service = start(&["--workers", "0"]);
    let waiting = post(&service, &scattered(LARGE, 2)).await;
    service.kill();
    line.set(Passes::Cut);
    let service = start(&[]);
    let notice = service.said.lock().unwrap().join("\n");
    let large = service.post_json("/v1/submissions", &scattered(LARGE, 3)).await;
    assert_eq!(large.status, 503, "{}", large.text);
    assert!(large.headers.contains_key("retry-after") && large.text.contains("large logs"), "{}", large.text);
    let small = post(&service, &scattered(SMALL, 4)).await;
    graded(&service, &small).await;
    assert_eq!(service.get(&format!("/v1/submissions/{first}/log")).await.status, 503);
    assert_eq!(service.get(&format!("/v1/submissions/{first}/report")).await.status, 200, "{notice}");
    let still = service.get(&format!("/v1/submissions/{waiting}")).await.json();
    assert!(["queued", "grading"].contains(&still["state"].as_str().unwrap()), "{still}");

    line.set(Passes::All);
    graded(&service, &waiting).await;
    let third = post(&service, &scattered(LARGE, 3)).await;
    graded(&service, &third).await;
    service.kill();
    audit(&scene.path("p.db"), &[first.clone(), waiting, small, third], "after a bucket that did not answer").await;
    // What refers to it is all that the database holds of a large log.
    let longest: i64 = query("SELECT CAST(MAX(length(log)) AS BIGINT) AS longest FROM submissions")
        .fetch_one(&pool(&scene.path("p.db")).await)
        .await
        .unwrap()
        .get("longest")
        .unwrap();
    assert!(longest < 1_000, "{longest}");

    // A bucket that was emptied is another place: no large log may go there.
    let identifier = server.url(&format!("/{BUCKET}/of/lab/plumbline.id"));
    let client = without_tls().build().unwrap();
    let may_do_all = |request: reqwest::RequestBuilder| request.header("authorization", ANY_SIGNATURE).send();
    let identity =
        may_do_all(client.get(&identifier)).await.unwrap().error_for_status().unwrap().bytes().await.unwrap();
    may_do_all(client.delete(&identifier)).await.unwrap().error_for_status().unwrap();
    let told = scene.refused("p.db", &[], &BucketServer::environment(line.port));
    assert!(told.contains("plumbline.id") && told.contains(&format!("s3://{BUCKET}/of/lab")), "{told}");
    may_do_all(client.put(&identifier).body(identity)).await.unwrap().error_for_status().unwrap();
    let service = start(&[]);
    assert_eq!(service.get(&format!("/v1/submissions/{first}/log")).await.text, log.text);
    service.kill();
}

/// A copy of a database knows the same place, but not what the original writes later.
#[tokio::test]
async fn a_copy_of_the_database_deletes_nothing_of_the_original() {
    let scene = Scene::new();
    let clock = scene.path("clock");
    let days = |days: i64| std::fs::write(&clock, (days * 86_400_000).to_string()).unwrap();
    let start = |database: &str| {
        let mut command = scene.command(database, &["--blobs", &scene.blobs("blobs")]);
        command.env("PLUMBLINE_TEST_CLOCK", &clock);
        Service::launch(command)
    };
    let token = || std::fs::read_to_string(scene.path("blobs/plumbline.sweep")).unwrap_or_default();
    let swept = async |before: &str| {
        let changes = async || {
            while token() == before {
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        };
        tokio::time::timeout(Duration::from_mins(2), changes()).await.expect("the original sweeps");
    };
    days(0);
    let original = start("p.db");
    swept("").await;
    original.terminate();
    copied(&scene.path("p.db"), &scene.path("q.db"));
    // The original goes on for a day, and sweeps again.
    days(1);
    let (before, original) = (token(), start("p.db"));
    let id = post(&original, &scattered(LARGE, 1)).await;
    graded(&original, &id).await;
    swept(&before).await;
    let object = scene.path("blobs").join(scene.reference("p.db", &id).await.unwrap());
    // Much later the copy is started, to try something. To it, the object is an orphan.
    days(9);
    let copy = start("q.db");
    let warned = async {
        while !copy.said.lock().unwrap().iter().any(|line| line.contains("of which this one is a copy")) {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(Duration::from_mins(2), warned)
        .await
        .unwrap_or_else(|_| panic!("{:#?}", copy.said.lock().unwrap()));
    assert!(object.exists(), "the copy deleted what the original refers to");
    assert_eq!(original.get(&format!("/v1/submissions/{id}/log")).await.status, 200);
    // On the next day the copy finds that again, and leaves the place to the original, which sweeps on.
    let (before, warnings) =
        (token(), || copy.said.lock().unwrap().iter().filter(|line| line.contains("is a copy")).count());
    days(10);
    swept(&before).await;
    let warned_again = async {
        while warnings() < 2 {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(Duration::from_mins(2), warned_again).await.expect("the copy says so each day");
    let before = token();
    days(11);
    swept(&before).await;
    assert!(object.exists());
}

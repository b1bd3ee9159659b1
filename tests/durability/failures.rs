//! Submissions that the service failed to grade: listed, and graded once the cause is mended, with the books in order.

use plumbline::store::db::{query, query_as, query_scalar};
use plumbline_engine::hidden::verify::{Kept, verify};
use serde_json::{Value, json};

use super::blobs::{LARGE, Scene as BlobScene, scattered};
use crate::support::audit::audit;
use crate::support::commands::{plumbline, refused, succeeded};
use crate::support::database::pool;
use crate::support::epoch::{Scene, all_are_graded, answer_to, id};

/// What is listed where nothing has failed.
const NONE: &str = "no submission waits for a failure to be mended";

/// The folder of large logs lost one, which a backup still had.
#[tokio::test]
async fn a_log_that_was_lost_and_found_is_graded_and_its_run_ends() {
    let scene = BlobScene::new();
    let blobs = scene.blobs("blobs");
    let database = scene.path("p.db");
    let service = scene.start("p.db", &["--blobs", &blobs, "--workers", "1"]);
    let run = service.begin_run("a", "mineceraft").await;
    let quick = json!({ "run": run, "task": 2, "turns": [{ "events": [] }] });
    let quick = service.post_json("/v1/submissions", &quick).await.json()["id"].as_str().unwrap().to_owned();
    service.wait_for(&format!("/v1/submissions/{quick}"), |found| found["state"] == "graded").await;
    service.kill();

    let dying = scene.start_dying("p.db", "after accept");
    let mut large = scattered(LARGE, 1);
    large["run"] = run.clone().into();
    let request = dying.http.post(format!("{}/v1/submissions", dying.url)).json(&large);
    assert!(request.send().await.is_err(), "the service died at the commit");
    dying.wait_for_end("after accept").await;
    let large: String = query_scalar("SELECT id FROM submissions WHERE state = 'queued'")
        .fetch_one(&pool(&database).await)
        .await
        .unwrap();
    let object = scene.path("blobs").join(scene.reference("p.db", &large).await.unwrap());
    let found = scene.path("found");
    std::fs::rename(&object, &found).unwrap();

    let service = scene.start("p.db", &[]);
    let path = format!("/v1/submissions/{large}");
    service.wait_for(&path, |submission| submission["state"] == "grader_error").await;
    // A failure of ours is neither unanswered nor a score: the run waits until it is mended.
    let finish = service.post_json(&format!("/v1/runs/{run}/finish"), &json!({ "skip": "unanswered" })).await;
    assert_eq!(finish.json()["skipped"], 721, "{}", finish.text);
    let skip = json!({ "skip": [2] });
    service.post_json(&format!("/v1/runs/{run}/finish"), &skip).await.faults(409);
    let waiting = service.get(&format!("/v1/runs/{run}")).await.json();
    assert_eq!((&waiting["state"], &waiting["grader_errors"]), (&json!("finishing"), &json!(1)));
    let listed = succeeded(&plumbline(&["failures", "list"], &database));
    assert!(listed.contains(&large) && listed.contains(&format!("run {run}, task 1 of")), "{listed}");
    assert!(!listed.contains(&quick) && listed.contains("is lost"), "{listed}");
    let metrics = service.get("/metrics").await.text;
    assert!(metrics.contains("plumbline_corrupt_rows_total 1\n"), "the damage must be seen");

    // Nothing of a deleted run is graded.
    let rows = pool(&database).await;
    let delete = "UPDATE runs SET deleted_at_ms = $1";
    query(delete).bind(1_i64).execute(&rows).await.unwrap();
    assert_eq!(succeeded(&plumbline(&["failures", "list"], &database)), NONE);
    let told = refused(&plumbline(&["failures", "retry", &large], &database));
    assert!(told.contains("its run is deleted"), "{told}");
    query(delete).bind(None::<i64>).execute(&rows).await.unwrap();

    let told = refused(&plumbline(&["failures", "retry"], &database));
    assert!(told.contains("--all"), "{told}");
    // While the cause lasts, what is retried fails again, and is listed again.
    let told = succeeded(&plumbline(&["failures", "retry", &large], &database));
    let failed = service.get(&path).await.json();
    let successor = failed["superseded_by"].as_str().unwrap();
    assert!(failed["state"] == "grader_error" && told.contains(&format!("{large}: queued again as {successor}")));
    let has_failed = |run: &Value| run["grader_errors"] == 1 && run["pending"] == 0;
    service.wait_for(&format!("/v1/runs/{run}"), has_failed).await;
    std::fs::rename(&found, &object).unwrap();
    let told = refused(&plumbline(&["failures", "retry", &large, &quick, "nothing"], &database));
    let again = format!("it was posted or queued again already, as {successor}");
    for reason in [&*again, "it is graded; only", "there is no such submission"] {
        assert!(told.contains(reason), "{reason}: {told}");
    }
    let told = succeeded(&plumbline(&["failures", "retry", "--all"], &database));
    assert!(told.contains("queued again: 1"), "{told}");
    let finished = service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    assert_eq!((&finished["graded"], &finished["grader_errors"]), (&json!(2), &json!(0)));
    let page = service.get(&format!("/submissions/{large}")).await.text;
    assert!(page.contains(&format!("<a href=\"/submissions/{successor}\">")), "{page}");
    // Whoever has the first identifier comes to the one that counts.
    let second = service.get(&format!("/v1/submissions/{successor}")).await.json();
    let last = second["superseded_by"].as_str().unwrap();
    let last = service.get(&format!("/v1/submissions/{last}")).await.json();
    assert!(last["state"] == "graded" && last.get("superseded_by").is_none(), "{last}");
    assert_eq!(succeeded(&plumbline(&["failures", "list"], &database)), NONE);
    service.kill();
    audit(&database, &[large, quick], "after the retries").await;
}

/// The owner of a hidden answer cannot see that its grading failed, so nobody but the operator can mend it.
#[tokio::test]
async fn a_hidden_answer_that_could_not_be_read_is_graded_before_its_entry_is_complete_and_not_after() {
    let mut scene = Scene::withholding();
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "official", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    let database = scene.file("p.db");
    let rows = pool(&database).await;
    let mut logs: Vec<(String, Vec<u8>)> = Vec::new();
    for instance in &drawn[..2] {
        scene.restart(Some("after answer_instance"));
        let path = format!("{}/v1/instances/{}/answer", scene.service.url, id(instance));
        let body = answer_to(instance, &scene.pool(), false);
        let request = scene.service.http.post(path).bearer_auth(&lab).json(&body);
        assert!(request.send().await.is_err(), "the service died at the commit");
        let queued = "SELECT id, log FROM submissions WHERE state = 'queued'";
        let (id, log): (String, Vec<u8>) = query_as(queued).fetch_one(&rows).await.unwrap();
        query("UPDATE submissions SET log = $1 WHERE id = $2").bind(vec![0_u8]).bind(&id).execute(&rows).await.unwrap();
        scene.restart(None);
        has_failed(&scene, logs.len() as i64 + 1).await;
        logs.push((id, log));
    }
    let listed = succeeded(&plumbline(&["failures", "list"], &database));
    for (instance, (submission, log)) in drawn.iter().zip(&logs) {
        assert!(
            listed.contains(submission) && listed.contains(&format!("hidden instance {}", id(instance))),
            "{listed}"
        );
        let mend = query("UPDATE submissions SET log = $1 WHERE id = $2").bind(log.clone()).bind(submission);
        mend.execute(&rows).await.unwrap();
    }
    succeeded(&plumbline(&["failures", "retry", &logs[0].0], &database));
    all_are_graded(&scene, 1).await;
    scene.publish_every = 1;
    scene.restart(None);
    scene.end_epoch().await;
    let told = refused(&plumbline(&["failures", "retry", &logs[1].0], &database));
    assert!(told.contains("its entry is complete"), "{told}");
    assert_eq!(succeeded(&plumbline(&["failures", "list"], &database)), NONE);
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await.text;
    let verified = verify(&serde_json::from_str(&reveal).unwrap(), &Kept::default()).unwrap();
    assert!(verified.breaches.is_empty(), "{:?}", verified.breaches);
    // One is charged, the other is refunded.
    let shown = succeeded(&plumbline(&["quota", "show", "--name", "lab"], &database));
    assert!(shown.contains("reserved 0, charged 1"), "{shown}");
    let acknowledged: Vec<String> = logs.into_iter().map(|(id, _)| id).collect();
    audit(&database, &acknowledged, "after the epoch").await;
}

/// Waits until so many submissions have ended as failures, as only the operator can see it.
async fn has_failed(scene: &Scene, wanted: i64) {
    let pool = pool(&scene.file("p.db")).await;
    for _ in 0..3_000 {
        let count = "SELECT COUNT(*) FROM submissions WHERE state = 'grader_error'";
        let found: i64 = query_scalar(count).fetch_one(&pool).await.unwrap();
        if found == wanted {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    panic!("fewer than {wanted} have failed");
}

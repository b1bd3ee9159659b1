//! Boards over HTTP: order, pages, formats, comparisons, time travel, and what people do to rows.

use std::process::Command;

use crate::support::{PROGRAM, Service};
use plumbline_engine::tasks::{Task, embedded};
use reqwest::StatusCode;
use serde_json::{Value, json};

const SUITE: &str = "mineceraft-lite";

fn names(board: &Value) -> Vec<&str> {
    board["rows"].as_array().unwrap().iter().map(|row| row["agent"].as_str().unwrap()).collect()
}

#[tokio::test]
async fn rows_are_ordered_compared_and_told_in_every_form() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let best = service.finished_run("=best, \"1\"", 0).await;
    let next = service.finished_run("next", 2).await;
    service.finished_run("last", 20).await;
    service.begin_run("next", SUITE).await;
    let path = format!("/v1/leaderboards/{SUITE}");
    let answer = service.get(&path).await;
    let board = answer.json();
    assert_eq!(names(&board), ["=best, \"1\"", "next", "last"]);
    let row = |i: usize| &board["rows"][i];
    assert_eq!(row(0)["overall"], json!({ "pass": 25, "of": 25, "rate": 1.0 }));
    // Two of two and none cannot be told apart; twenty can.
    let places: Vec<&Value> = (0..3).map(|i| &row(i)["places"]).collect();
    assert_eq!(
        places,
        [&json!({ "first": 1, "last": 2 }), &json!({ "first": 1, "last": 2 }), &json!({ "first": 3, "last": 3 })]
    );
    assert_eq!([&row(1)["attempts"], &row(2)["attempts"]], [&json!(2), &json!(1)]);
    let interval = &row(0)["interval"];
    assert!(interval["low"].as_f64().unwrap() < 0.9 && interval["high"] == json!(1.0), "{interval}");
    assert_eq!(board["reported"], json!([]), "the paper's prompts are those of another track");

    // The same again is 304; another order is another document.
    let tag = answer.headers["etag"].to_str().unwrap().to_owned();
    let again = service.http.get(format!("{}{path}", service.url)).header("if-none-match", &tag);
    assert_eq!(service.send(again).await.status, StatusCode::NOT_MODIFIED);
    let turned = service.get(&format!("{path}?sort=overall&order=asc")).await;
    assert_eq!(names(&turned.json()), ["last", "next", "=best, \"1\""]);
    assert_ne!(turned.headers["etag"].to_str().unwrap(), tag);

    // Pages: one row each, until there is none.
    let mut seen = Vec::new();
    let mut after = String::new();
    loop {
        let page = service.get(&format!("{path}?limit=1{after}")).await.json();
        assert_eq!(page["total"], 3);
        seen.extend(names(&page).into_iter().map(str::to_owned));
        let Some(next) = page["next_after"].as_str() else { break };
        after = format!("&after={next}");
    }
    assert_eq!(seen, ["=best, \"1\"", "next", "last"]);
    assert_eq!(names(&service.get(&format!("{path}?agent=NEX")).await.json()), ["next"]);
    assert!(names(&service.get(&format!("{path}?provenance=re-run-by-host")).await.json()).is_empty());
    for wrong in ["sort=beauty", "limit=0", "after=nobody", "as_of=yesterday", "colour=red", "provenance=nonce-bound"] {
        let answer = service.get(&format!("{path}?{wrong}")).await;
        answer.faults(400);
        assert_eq!(answer.json()["faults"][0]["parameter"], wrong.split('=').next().unwrap(), "{}", answer.text);
    }
    let wrong = service.get(&format!("{path}?sort=beauty&limit=x&agnet=a")).await.json();
    let names: Vec<&Value> = wrong["faults"].as_array().unwrap().iter().map(|fault| &fault["parameter"]).collect();
    assert_eq!(names, ["sort", "limit", "agnet"], "{wrong}");

    let table = service.get(&format!("{path}?format=csv")).await;
    assert_eq!(table.kind, "text/csv; charset=utf-8");
    let mut reader = csv::Reader::from_reader(table.text.as_bytes());
    let records: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!((records.len(), &records[0][4]), (3, "'=best, \"1\""));
    assert_eq!(service.get(&format!("{path}?format=ndjson")).await.text.lines().count(), 3);
    let feed = service.get(&format!("{path}/feed.atom")).await;
    assert!(
        feed.kind.starts_with("application/atom+xml") && feed.text.matches("<entry>").count() == 3,
        "{}",
        feed.text
    );
    assert!(!feed.text.contains("\"1\""), "text of agents is escaped: {}", feed.text);

    for by in ["family", "category", "type", "wording", "criterion"] {
        let told = service.get(&format!("{path}/breakdown?by={by}")).await.json();
        let groups = told["groups"].as_array().unwrap().len();
        assert!(told["rows"].as_array().unwrap().iter().all(|row| row["cells"].as_array().unwrap().len() == groups));
        // The few tasks of the draw are of different problems.
        let first = if by == "wording" { Value::Null } else { json!(1.0) };
        assert_eq!(told["rows"][0]["cells"][0]["rate"], first, "{by}");
    }
    let told = service.get(&format!("{path}/compare?a={best}&b={next}")).await.json();
    assert_eq!([&told["common"], &told["both"], &told["p_value"]], [&json!(25), &json!(23), &json!(0.5)]);
    assert_eq!((told["only_a"].as_array().unwrap().len(), told["only_b"].as_array().unwrap().len()), (2, 0));
    service.get(&format!("{path}/compare?a={best}&b=nobody")).await.faults(404);

    // The links of the page keep its filters; order and page are none.
    let page = service.get(&format!("/boards/{SUITE}?provenance=self-reported&sort=shape&limit=2")).await.text;
    assert!(page.contains("3 runs that match"), "{page}");
    let links = page.split("href=\"").filter(|part| part.starts_with(&format!("/boards/{SUITE}?sort=")));
    let links: Vec<&str> = links.map(|part| part.split('"').next().unwrap()).collect();
    assert_eq!(links.len(), 12, "eleven columns and the next page: {links:?}");
    assert!(
        links.iter().all(|link| link.contains("provenance=self-reported") && link.contains("limit=2")),
        "{links:?}"
    );
    let sorted = service.get(&format!("/boards/{SUITE}?sort=shape&order=asc&agent=&coverage=")).await.text;
    assert!(sorted.contains("3 runs.") && !sorted.contains("that match"), "{sorted}");
    let none = service.get(&format!("/boards/{SUITE}?coverage=incomplete")).await.text;
    assert!(none.contains("No finished runs match the filters"), "{none}");
}

#[tokio::test]
async fn what_is_done_to_a_row_is_told_for_ever() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    let one = service.finished_run("one", 0).await;
    tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    let between = jiff::Timestamp::now();
    tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    service.finished_run("two", 3).await;
    let path = format!("/v1/leaderboards/{SUITE}");
    let then = format!("{path}?as_of={between}");
    assert_eq!(names(&service.get(&then).await.json()), ["one"]);
    // A date stands for its end.
    let today = format!("{path}?as_of={}", &jiff::Timestamp::now().to_string()[..10]);
    assert_eq!(names(&service.get(&today).await.json()).len(), 2);

    let key = |scopes: &str, name: &str| {
        let arguments = ["keys", "create", "--name", name, "--scopes", scopes];
        let made =
            Command::new(PROGRAM).args(arguments).args(crate::support::database::named(&database)).output().unwrap();
        String::from_utf8(made.stdout).unwrap().trim().to_owned()
    };
    let (operator, lab) = (key("admin", "operator"), key("submit", "lab"));
    let act = |key: &str, body: Value| {
        let request = service.http.post(format!("{}/v1/runs/{one}/board-actions", service.url)).bearer_auth(key);
        service.send(request.json(&body))
    };
    let hide = json!({ "action": "hide", "reason": "the logs are another's <b>" });
    assert_eq!(act(&lab, hide.clone()).await.status, StatusCode::FORBIDDEN);
    for reason in [" ", "a\0b", "a\u{202e}b", "\u{7}"] {
        assert_eq!(act(&operator, json!({ "action": "hide", "reason": reason })).await.faults(422), ["null /reason"]);
    }
    assert_eq!(act(&operator, hide.clone()).await.status, StatusCode::OK);
    assert_eq!(act(&operator, hide.clone()).await.status, StatusCode::CONFLICT);
    // An open run has no row: the remedy is another.
    let open = service.post_json("/v1/runs", &json!({ "agent": "three", "suite": SUITE })).await.json()["id"].clone();
    let open = format!("{}/v1/runs/{}/board-actions", service.url, open.as_str().unwrap());
    let refused = service.send(service.http.post(open).bearer_auth(&operator).json(&hide)).await;
    assert!(refused.text.contains("run-not-finished") && refused.text.contains("DELETE /v1/runs/"), "{}", refused.text);
    assert_eq!(names(&service.get(&path).await.json()), ["two"]);
    assert_eq!(names(&service.get(&then).await.json()), ["one"], "the past stays");
    let page = async || service.get(&format!("/boards/{SUITE}?as_of={between}")).await.text;
    assert!(page().await.contains("hidden or withdrawn since"), "and its page says what came later");
    let restore = json!({ "action": "restore", "reason": "a mistake" });
    assert_eq!(act(&operator, restore).await.status, StatusCode::OK);
    assert_eq!(names(&service.get(&path).await.json()), ["one", "two"]);
    assert!(!page().await.contains("hidden or withdrawn since"));
    let entries = service.get(&format!("{path}/actions")).await.json();
    let told: Vec<String> = entries["actions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| format!("{} {} {}", entry["actor"], entry["action"], entry["reason"]))
        .collect();
    assert_eq!(told, [r#""operator" "restore" "a mistake""#, r#""operator" "hide" "the logs are another's <b>""#]);
    // Not even by hand.
    let pool = crate::support::database::pool(&database).await;
    for statement in ["DELETE FROM board_actions", "UPDATE board_actions SET reason = ''"] {
        assert!(
            plumbline::store::db::query(statement).execute(&pool).await.unwrap_err().to_string().contains("permanent")
        );
    }
}

/// Runs without answers are listed apart, and move nobody's place; what is skipped on purpose counts as failed.
#[tokio::test]
async fn empty_runs_spoil_no_places() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    service.finished_run("best", 0).await;
    service.finished_run("good", 20).await;
    let path = format!("/v1/leaderboards/{SUITE}");
    let before = service.get(&path).await.json();
    assert_eq!(before["rows"][0]["places"], json!({ "first": 1, "last": 1 }));
    for i in 0..20 {
        let run = service.begin_run(&format!("empty {i}"), SUITE).await;
        // With a body, with none, and with an empty form, as clients happen to send it.
        match i % 3 {
            0 => service.post_json(&format!("/v1/runs/{run}/finish"), &json!({})).await,
            1 => service.send(service.http.post(format!("{}/v1/runs/{run}/finish", service.url))).await,
            _ => service.post(&format!("/v1/runs/{run}/finish"), "application/x-www-form-urlencoded", "").await,
        };
        service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    }
    let after = service.get(&path).await.json();
    assert_eq!(after["rows"], before["rows"]);
    assert_eq!(
        (&after["total"], &after["incomplete"], &after["minimum_coverage"]),
        (&json!(2), &json!(20), &json!(1.0))
    );
    let apart = service.get(&format!("{path}?coverage=incomplete&limit=3")).await.json();
    assert_eq!(
        (&apart["total"], &apart["rows"][0]["rank"], &apart["rows"][0]["places"]),
        (&json!(20), &Value::Null, &Value::Null)
    );
    assert!(service.get(&format!("/boards/{SUITE}")).await.text.contains("Incomplete runs"));

    // Whoever says that the rest is left out on purpose is compared, and has failed it.
    let run = service.begin_run("honest", SUITE).await;
    let suite = embedded::lite(&embedded::latest().unwrap(), 42);
    let one = crate::support::good_build(&suite.tasks[0], false, Some(&run));
    service.post_json("/v1/submissions", &one).await;
    let finish = format!("/v1/runs/{run}/finish");
    let answered = json!({ "skip": [suite.tasks[1].id, suite.tasks[0].id, suite.tasks[0].number] });
    assert_eq!(service.post_json(&finish, &answered).await.faults(422), ["null /skip/1", "null /skip/2"]);
    let wrong = json!({ "skip": [suite.tasks[1].number, {}, "walls/nine", 1.5], "tasks": [] });
    let mut faults = service.post_json(&finish, &wrong).await.faults(422);
    faults.sort();
    assert_eq!(faults, ["null /skip/1", "null /skip/2", "null /skip/3", "null /tasks"]);
    assert_eq!(service.post_json(&finish, &json!({ "skip": "all" })).await.faults(422), ["null /skip"]);
    let mut many = vec![json!(suite.tasks[1].number); 1_000];
    many[3] = json!("walls/nine");
    assert_eq!(service.post_json(&finish, &json!({ "skip": many })).await.faults(422), ["null /skip", "null /skip/3"]);
    // Also where the body comes compressed, and so without a length.
    let packed = zstd::encode_all(json!({ "skip": "unanswered" }).to_string().as_bytes(), 3).unwrap();
    let request = service.http.post(format!("{}{finish}", service.url)).header("content-encoding", "zstd");
    let finished = service.send(request.header("content-type", "application/json").body(packed)).await;
    assert_eq!(finished.json()["skipped"], 24, "{}", finished.text);
    service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    assert_eq!(service.post_json(&finish, &json!({ "skip": "unanswered" })).await.status, StatusCode::CONFLICT);
    assert_eq!(service.post_json(&finish, &json!({})).await.status, StatusCode::OK, "finishing again is nothing");
    let board = service.get(&path).await.json();
    assert_eq!(names(&board), ["best", "good", "honest"]);
    let row = &board["rows"][2];
    assert_eq!(
        (&row["skipped"], &row["coverage"]["pass"], &row["overall"]["pass"]),
        (&json!(24), &json!(1), &json!(1))
    );
    assert_eq!(board["rows"][0]["places"], json!({ "first": 1, "last": 1 }));
    // Also beside another: the skipped problems are common to both, and failed.
    let compared = format!("compare?a={}&b={run}", board["rows"][1]["run"].as_str().unwrap());
    let told = service.get(&format!("{path}/{compared}")).await.json();
    let solved_by_both = told["both"].as_u64().unwrap();
    let (only_a, only_b) = (told["only_a"].as_array().unwrap().len(), told["only_b"].as_array().unwrap().len());
    assert_eq!(
        (told["common"].as_u64(), only_a as u64 + solved_by_both, only_b as u64 + solved_by_both),
        (Some(25), 5, 1)
    );
    let page = service.get(&format!("/boards/{SUITE}/{compared}")).await.text;
    assert!(page.contains("on the 25 problems"), "{page}");
}

#[tokio::test]
async fn runs_are_listed_and_open_ones_deleted() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let mut service = Service::start_as_told(&database, &[]);
    service.http = client_of(&database, "first");
    let own: Vec<String> =
        [service.begin_run("Alpha 1", "mineceraft").await, service.begin_run("beta", SUITE).await].into();
    let log = json!({ "run": own[1], "task": 15, "turns": [{ "events": [] }] });
    let submission = service.post_json("/v1/submissions", &log).await.json()["id"].as_str().unwrap().to_owned();
    service.http = client_of(&database, "second");
    let other = service.finished_run("gamma", 0).await;
    let listed = async |query: &str| {
        let page = service.get(&format!("/v1/runs{query}")).await.json();
        page["runs"]
            .as_array()
            .unwrap_or_else(|| panic!("{page}"))
            .iter()
            .map(|run| run["id"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(listed("").await, [other.clone(), own[1].clone(), own[0].clone()]);
    let only_other = vec![other.clone()];
    assert_eq!(listed("?mine=true").await, only_other);
    assert_eq!(listed("?state=open&agent=ALPHA").await, [own[0].clone()]);
    assert_eq!(listed("?state=finished&suite=mineceraft-lite@4").await, only_other);
    assert_eq!(listed("?limit=1").await, only_other);
    assert_eq!(listed(&format!("?after={other}&limit=1")).await, [own[1].clone()]);
    assert!(
        listed("?until=2020-01-01T00:00:00Z").await.is_empty()
            && listed("?since=2020-01-01T00:00:00Z").await.len() == 3
    );
    let run = service.get(&format!("/v1/runs/{other}")).await.json();
    let today = &run["created_at"].as_str().unwrap()[..10];
    assert_eq!(listed(&format!("?since=2020-01-01&until={today}&limit=1")).await, only_other, "a date is a whole day");
    assert!(listed("?until=2020-01-01").await.is_empty());
    let wrong = "/v1/runs?state=fine&limit=0&suite=none&after=none&since=once&until=2020-02-30&colour=red";
    let problem = service.get(wrong).await;
    assert_eq!(problem.faults(400).len(), 7, "{}", problem.text);

    let delete = |run: &str| service.send(service.http.delete(format!("{}/v1/runs/{run}", service.url)));
    assert_eq!(delete(&own[1]).await.status, StatusCode::OK, "the operator's key may");
    assert_eq!(service.get(&format!("/v1/runs/{}", own[1])).await.json()["state"], "deleted");
    assert_eq!(listed("").await, [other.clone(), own[0].clone()]);
    assert_eq!(listed("?state=deleted").await, [own[1].clone()]);
    assert_eq!(delete(&own[1]).await.status, StatusCode::CONFLICT);
    assert_eq!(delete(&other).await.status, StatusCode::CONFLICT, "a finished run stays");
    assert_eq!(delete("none").await.status, StatusCode::NOT_FOUND);
    assert_eq!(service.post_json("/v1/submissions", &log).await.status, StatusCode::CONFLICT);
    let ended = service.get(&format!("/v1/submissions/{submission}")).await.json();
    assert!(["graded", "cancelled"].contains(&ended["state"].as_str().unwrap()), "{ended}");
    let finish = service.post_json(&format!("/v1/runs/{}/finish", own[1]), &json!({})).await;
    assert_eq!(finish.status, StatusCode::CONFLICT);
    // Who follows it is told, with the task.
    let events = service.get(&format!("/v1/events?run={}", own[1])).await.text;
    assert!(events.contains("\"state\":\"deleted\"") && events.contains("\"task\":\"foundations/"), "{events}");
}

/// A client that sends an owner's key.
fn client_of(database: &std::path::Path, owner: &str) -> reqwest::Client {
    let made = Command::new(PROGRAM)
        .args(["keys", "create", "--scopes", "admin", "--name", owner])
        .args(crate::support::database::named(database))
        .output()
        .unwrap();
    let key = String::from_utf8(made.stdout).unwrap();
    let mut headers = reqwest::header::HeaderMap::new();
    headers.insert("authorization", format!("Bearer {}", key.trim()).parse().unwrap());
    plumbline::client::without_tls().default_headers(headers).build().unwrap()
}

#[tokio::test]
async fn near_identical_runs_of_two_owners_are_flagged_and_the_host_may_run_again() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let mut service = Service::start_as_told(&database, &[]);
    let mut runs = Vec::new();
    for (owner, unsolved) in [("first", 0), ("copier", 0), ("other", 18)] {
        service.http = client_of(&database, owner);
        runs.push(service.finished_run(owner, unsolved).await);
        if owner == "first" {
            // The same again by the same owner is no copy.
            service.finished_run("first again", 0).await;
        }
    }
    let board = service.get("/v1/leaderboards/mineceraft-lite").await.json();
    let similar = |run: &str| {
        let row = board["rows"].as_array().unwrap().iter().find(|row| row["run"] == run).unwrap();
        row["similar_to"].as_array().unwrap().iter().map(|run| run.as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(similar(&runs[0]), [runs[1].clone()]);
    assert_eq!(similar(&runs[1]).len(), 2, "both runs of the first owner");
    assert!(similar(&runs[2]).is_empty());
    assert!(service.get("/boards/mineceraft-lite").await.text.contains("possible copy"));
    assert!(service.get(&format!("/runs/{}", runs[0])).await.text.contains("near-identical"));

    let new = json!({ "agent": "first", "suite": "mineceraft-lite", "provenance": "re-run-by-host" });
    let again = service.post_json("/v1/runs", &new).await;
    assert_eq!(again.json()["provenance"], "re-run-by-host", "{}", again.text);
    let wrong = json!({ "agent": "first", "suite": "mineceraft-lite", "provenance": "sworn" });
    assert_eq!(service.post_json("/v1/runs", &wrong).await.faults(422), ["null /provenance"]);
    let rows = |filter: &str| format!("/v1/leaderboards/mineceraft-lite?provenance={filter}");
    assert_eq!(service.get(&rows("self-reported")).await.json()["total"], 4);
    assert_eq!(service.get(&rows("re-run-by-host")).await.json()["total"], 0);
}

/// Posts a run that answers each task of the Lite suite with one block beside the others.
async fn run_of_single_blocks(service: &Service, agent: &str) {
    let run = service.begin_run(agent, SUITE).await;
    let suite = embedded::lite(&embedded::latest().unwrap(), embedded::LITE_SEED);
    let line = |task: &Task| {
        let turns = vec![json!({ "palette": ["stone"], "rows": [[9, 1, 9, 0]] }); task.turns.len()];
        json!({ "task": task.number, "run": run, "turns": turns }).to_string()
    };
    let lines: Vec<String> = suite.tasks.iter().map(line).collect();
    let accepted = service.post("/v1/submissions", "application/x-ndjson", lines.join("\n")).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED, "{}", accepted.text);
    service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
}

#[tokio::test]
async fn the_home_page_shows_a_build_that_failed_and_never_an_empty_one() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--board-coverage", "0"]);
    service.finished_run("good", 0).await;
    service.finished_run("built nothing", 20).await;
    let home = service.get("/").await.text;
    assert!(home.contains("good") && !home.contains("Build for"), "{home}");
    run_of_single_blocks(&service, "one block").await;
    let home = service.get("/").await.text;
    assert_eq!(home.matches("<canvas").count(), 2, "{home}");
    let pair = home.split("class=\"pair\"").nth(1).unwrap().split("</section>").next().unwrap();
    assert!(pair.contains("one block") && !pair.contains("built nothing"), "{pair}");
}

#[tokio::test]
async fn a_board_of_another_time_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let now = service.get(&format!("/boards/{SUITE}")).await.text;
    assert!(!now.contains("as of 2026") && now.contains("Moderation log</a>: nothing so far"), "{now}");
    let then = service.get(&format!("/boards/{SUITE}?as_of=2026-01-01")).await.text;
    assert!(then.contains("The board as of 2026-01-01</strong>, the end of that day in UTC"), "{then}");
}

//! Pages in a real browser (Debian's chromium), without a network.

use std::process::Command;

use crate::support::Service;

/// The document after scripts have run.
fn rendered(url: &str, wait_ms: u32) -> String {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--virtual-time-budget={wait_ms}"))
        .args(["--dump-dom", url])
        .output()
        .expect("chromium is not installed; bash tests/run installs it");
    String::from_utf8(output.stdout).unwrap()
}

#[tokio::test]
async fn the_home_page_shows_the_board_and_the_reference_its_operations() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let markup = "<b onclick=alert(1)>agent</b>";
    let run = service.begin_run(markup, "mineceraft-lite").await;
    service.post_json(&format!("/v1/runs/{run}/finish"), &serde_json::json!({ "skip": "unanswered" })).await;
    service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    let url = service.url.clone();
    let (home, docs) = tokio::task::spawn_blocking(move || {
        (rendered(&format!("{url}/"), 1_000), rendered(&format!("{url}/docs/"), 5_000))
    })
    .await
    .unwrap();
    assert!(home.contains("mineceraft-lite@1") && home.contains("0.0 %"), "{home}");
    assert!(home.contains("&lt;b onclick=alert(1)&gt;") && !home.contains("<b onclick"), "names are text, not markup");
    assert!(docs.contains("/docs/create_submission"), "the reference shows its operations");
}

#[tokio::test]
async fn errors_are_pages_for_browsers_and_problems_for_programs() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let browser = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8";
    let kind = async |path: &str, accept: &str| {
        let answer = service.http.get(format!("{}{path}", service.url)).header("accept", accept).send().await.unwrap();
        let kind = answer.headers()["content-type"].to_str().unwrap().split(';').next().unwrap().to_owned();
        (answer.status().as_u16(), kind, answer.text().await.unwrap())
    };
    for path in ["/nosuch", "/assets/nosuch.css", "/boards/nosuch", "/get_reward"] {
        let (status, kind, text) = kind(path, browser).await;
        assert!(status >= 400 && kind == "text/html" && text.contains("<h1>"), "{path}: {status} {kind}");
    }
    for (path, accept) in [("/v1/nosuch", browser), ("/nosuch", "*/*"), ("/nosuch", "application/json")] {
        assert_eq!(kind(path, accept).await.1, "application/problem+json", "{path} {accept}");
    }
}

#[tokio::test]
async fn readers_learn_who_runs_the_service_and_what_its_words_mean() {
    let folder = tempfile::tempdir().unwrap();
    let named = ["--operator", "Structural Lab <1>", "--contact", "board@lab.example"];
    let service = Service::start(&folder.path().join("p.db"), &named);
    let about = service.get("/about").await.text;
    for told in ["Structural Lab &#60;1&#62;", "href=\"mailto:board@lab.example\"", "Self-reported", "Possible copy"] {
        assert!(about.contains(told), "{told}: {about}");
    }
    for page in ["/", "/boards/mineceraft", "/epochs", "/about"] {
        assert!(service.get(page).await.text.contains("<footer><a href=\"/about\">"), "{page}");
    }
    let unnamed = Service::start(&folder.path().join("q.db"), &[]);
    assert!(unnamed.get("/about").await.text.contains("has not said who they are"));

    let asked = service.http.get(format!("{}/boards/mineceraft?bogus=1", service.url)).header("accept", "text/html");
    let told = service.send(asked).await;
    assert_eq!(told.status.as_u16(), 400);
    assert!(
        told.text.contains("bogus: there is no such parameter") && told.text.contains("<a href=\"?\">"),
        "{}",
        told.text
    );
}

#[tokio::test]
async fn a_run_that_left_a_task_out_is_compared_without_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let built = service.finished_run("steady", 0).await;
    let empty = service.begin_run("absent", "mineceraft-lite").await;
    service.post_json(&format!("/v1/runs/{empty}/finish"), &serde_json::json!({ "skip": "unanswered" })).await;
    service.wait_for(&format!("/v1/runs/{empty}"), |run| run["state"] == "finished").await;
    let page = service.get(&format!("/boards/mineceraft-lite/compare?a={built}&b={empty}")).await.text;
    assert!(page.contains("No answer") && page.contains(&format!("/runs/{built}/tasks/")), "{page}");
    assert!(!page.contains(&format!("/runs/{empty}/tasks/")) && !page.contains("/compare?run_a="), "{page}");
    // Every picture and every link of the page is there.
    for address in page.split(['"']).filter(|text| text.starts_with("/runs/")) {
        assert_eq!(service.get(address).await.status.as_u16(), 200, "{address}");
    }
}

#[tokio::test]
async fn assets_are_kept_under_their_version_alone() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let home = service.get("/").await.text;
    let versioned = home.split("href=\"").find(|rest| rest.starts_with("/assets/style.css?")).unwrap();
    let versioned = versioned.split('"').next().unwrap();
    for (path, kept) in [(versioned, true), ("/assets/style.css", false), ("/assets/style.css?0.1.0", false)] {
        let answer = service.http.get(format!("{}{path}", service.url)).send().await.unwrap();
        let told = answer.headers()["cache-control"].to_str().unwrap().to_owned();
        assert_eq!((told.contains("immutable"), told.contains("no-cache")), (kept, !kept), "{path}: {told}");
        let tag = answer.headers()["etag"].clone();
        let again =
            service.http.get(format!("{}{path}", service.url)).header("if-none-match", tag).send().await.unwrap();
        assert_eq!(again.status().as_u16(), 304, "{path}");
    }
}

#[tokio::test]
async fn thumbnails_are_small_pictures_of_builds() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let run = service.finished_run("steady", 3).await;
    let listed = service.get(&format!("/v1/runs/{run}/submissions")).await.json();
    let [empty, full] = [&listed["submissions"][0], &listed["submissions"][24]];
    let id = full["id"].as_str().unwrap();
    let picture = async |path: String| {
        let answer = service.http.get(format!("{}{path}", service.url)).send().await.unwrap();
        let kind = answer.headers()["content-type"].to_str().unwrap().to_owned();
        (answer.status().as_u16(), kind, answer.bytes().await.unwrap())
    };
    let build = picture(format!("/submissions/{id}/thumbnail.png")).await;
    assert_eq!((build.0, build.1.as_str(), &build.2[1..4]), (200, "image/png", &b"PNG"[..]));
    assert!(build.2.len() < 40_000, "{}", build.2.len());
    assert_eq!(picture(format!("/submissions/{id}/thumbnail.png")).await, build, "drawn once");
    assert_eq!(picture(format!("/runs/{run}/tasks/{}/thumbnail.png", full["number"])).await, build);
    let reference = format!("/suites/mineceraft-lite/tasks/{}/thumbnail.png", full["number"]);
    assert_eq!(picture(reference).await, build, "the run built what the reference builder builds");
    assert_ne!(picture(format!("/runs/{run}/tasks/{}/thumbnail.png", empty["number"])).await.2, build.2);
    for path in [
        "/submissions/nosuch/thumbnail.png",
        "/suites/mineceraft-lite/tasks/1/thumbnail.png",
        "/runs/x/tasks/1/thumbnail.png",
    ] {
        assert_eq!(picture(path.to_owned()).await.0, 404, "{path}");
    }
}

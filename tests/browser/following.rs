//! Pages of what is under way follow it, charts show what is on the board, and operators act on rows.

use super::driver::Browser;
use crate::support::Service;
use crate::support::commands::{plumbline, succeeded};
use fantoccini::Locator;
use fantoccini::key::Key;
use serde_json::json;

const GRADED: &str = "return document.querySelector('.outcome strong').textContent";

#[tokio::test]
async fn the_page_of_a_run_follows_it_until_it_has_finished() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let run = service.begin_run("steady", "mineceraft-lite").await;
    let browser = Browser::open().await;
    browser.page.goto(&format!("{}/runs/{run}", service.url)).await.unwrap();
    assert_eq!(browser.run(GRADED).await, "0 of 25");
    service.answer_run(&run, 3).await;
    browser.wait(GRADED, |told| told.as_str().is_some_and(|told| told.ends_with('%'))).await;
    assert_eq!(browser.run("return document.querySelectorAll('[data-live]').length").await, 0, "it has ended");
    browser.is_well(&service).await;

    // The page of its agent, found by the search box in the head of every page.
    let field = browser.page.find(Locator::Css("header input[name=text]")).await.unwrap();
    field.send_keys("stea").await.unwrap();
    field.send_keys(&String::from(char::from(Key::Enter))).await.unwrap();
    browser.wait("return location.pathname", |path| *path == "/search").await;
    browser.click("main a[href='/agents/steady']").await;
    browser.wait("return document.querySelector('h1').textContent", |name| *name == "steady").await;
    browser.see("agent").await;
    browser.is_well(&service).await;
    for width in [1030, 1000, 700, 320] {
        browser.page.set_window_size(width, 800).await.unwrap();
        browser.page.refresh().await.unwrap();
        browser.is_well(&service).await;
    }
    browser.page.close_window().await.unwrap();
}

#[tokio::test]
async fn charts_show_the_runs_of_a_board_with_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let (good, bad) = (service.finished_run("steady", 0).await, service.finished_run("<b>hasty</b>", 20).await);
    for (run, amount) in [(&good, 4.5), (&bad, 0.02)] {
        let card = json!({ "cost": { "amount": amount, "currency": "USD", "prices_as_of": "2026-11-01" } });
        let put = service.http.put(format!("{}/v1/runs/{run}/card", service.url)).json(&card);
        assert!(service.send(put).await.status.is_success());
    }
    let charts = "/boards/mineceraft-lite/charts";
    let page = service.get(charts).await.text;
    for name in ["intervals", "cost", "progress", "profile", "matrix"] {
        let svg = service.get(&format!("{charts}/{name}.svg")).await;
        assert_eq!(svg.headers["content-type"], "image/svg+xml", "{name}");
        resvg::usvg::Tree::from_str(&svg.text, &resvg::usvg::Options::default())
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(!svg.text.contains("<b>") && svg.text.contains("&lt;b&gt;hasty"), "{name}: {}", svg.text);
        let table = service.get(&format!("{charts}/{name}.csv")).await.text;
        assert!(table.contains(&good) && table.contains(&bad), "{name}: {table}");
        assert!(page.contains(&format!("{charts}/{name}.svg").replace("lite/", "lite@4/")), "{name}");
    }
    let cost = service.get(&format!("{charts}/cost.csv")).await.text;
    assert!(cost.contains("<b>hasty</b>,0.2,0.02,USD,true"), "{cost}");
    let alone = service.get(&format!("{charts}/progress.csv?agent=steady")).await.text;
    assert!(alone.contains(&good) && !alone.contains(&bad), "{alone}");
    for (wrong, status) in
        [("nosuch.svg", 404), ("cost.png", 404), ("cost.svg?track=nosuch", 400), ("cost.svg?as_of=x", 400)]
    {
        assert_eq!(service.get(&format!("{charts}/{wrong}")).await.status.as_u16(), status, "{wrong}");
    }
    let before = service.get(&format!("{charts}?as_of=2020-01-01")).await;
    assert!(before.text.contains("No finished runs yet"), "{}", before.text);

    let browser = Browser::open().await;
    browser.page.set_window_size(1280, 1000).await.unwrap();
    browser.page.goto(&format!("{}{charts}", service.url)).await.unwrap();
    let drawn = "return [...document.images].filter(i => i.complete && i.naturalWidth > 100).length";
    browser.wait(drawn, |count| count.as_u64().is_some_and(|count| count >= 2)).await;
    browser.see("charts").await;
    browser.is_well(&service).await;
    browser.page.goto(&format!("{}/boards/mineceraft-lite/compare?a={good}&b={bad}", service.url)).await.unwrap();
    let counts = "return [...document.querySelectorAll('.counts td')].map(cell => cell.textContent).join()";
    assert_eq!(browser.run(counts).await, ",5,20,0,0");
    browser.see("compare").await;
    browser.is_well(&service).await;
    browser.page.close_window().await.unwrap();
}

#[tokio::test]
async fn an_operator_signs_in_and_hides_a_row_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    let made =
        |scopes: &str| succeeded(&plumbline(&["keys", "create", "--name", scopes, "--scopes", scopes], &database));
    let (admin, submit) = (made("admin"), made("submit"));
    let run = service.finished_run("hasty", 1).await;
    let browser = Browser::open().await;
    browser.page.goto(&format!("{}/moderation", service.url)).await.unwrap();
    let enter = async |name: &str, text: &str| {
        browser.page.find(Locator::Css(&format!("main [name={name}]"))).await.unwrap().send_keys(text).await.unwrap();
    };
    enter("key", &submit).await;
    browser.click("main form button").await;
    browser
        .wait("return document.querySelector('[role=alert]')?.textContent", |why| {
            *why == "This key lacks the scope admin."
        })
        .await;
    enter("key", &admin).await;
    browser.click("main form button").await;
    browser
        .wait("return location.pathname + document.querySelectorAll('main table').length", |at| *at == "/moderation1")
        .await;
    assert_eq!(browser.run("return document.cookie").await, "", "scripts do not see the key");
    let page = browser.run("return document.documentElement.outerHTML").await;
    assert!(!page.as_str().unwrap().contains(&admin), "the page does not show the key");
    browser.see("moderation").await;
    enter("run", &format!("{}/runs/{run}", service.url)).await;
    enter("reason", "the blocks are another agent's").await;
    browser.click("main form[action$=actions] button").await;
    browser.wait("return location.pathname", |path| *path == format!("/runs/{run}")).await;
    let told = browser.run("return document.querySelector('#moderation-log + ul').textContent").await;
    assert!(told.as_str().unwrap().contains("hidden by admin: the blocks are another agent's"), "{told}");
    assert_eq!(service.get("/v1/leaderboards/mineceraft-lite").await.json()["total"], 0);
    let log = service.get("/boards/mineceraft-lite/log").await.text;
    assert!(log.contains("hidden") && log.contains(&run), "{log}");

    // The cookie counts for this page alone, and another site's form is refused.
    let cookie = format!("plumbline_key={admin}");
    let act = |path: String| service.http.post(format!("{}{path}", service.url)).header("cookie", &cookie);
    let by_api = act(format!("/v1/runs/{run}/board-actions")).json(&json!({ "action": "restore", "reason": "x" }));
    assert_eq!(service.send(by_api).await.status.as_u16(), 401);
    let form = [("run", run.as_str()), ("action", "restore"), ("reason", "x")];
    let body: String = form_urlencoded::Serializer::new(String::new()).extend_pairs(form).finish();
    let foreign = act("/moderation/actions".to_owned()).header("origin", "https://evil.example").body(body.clone());
    let foreign = foreign.header("content-type", "application/x-www-form-urlencoded");
    assert_eq!(service.send(foreign).await.status.as_u16(), 403);
    let nobody = service.http.post(format!("{}/moderation/actions", service.url)).body(body);
    let nobody = nobody.header("content-type", "application/x-www-form-urlencoded").header("accept", "text/html");
    let refused = service.send(nobody).await;
    assert!(refused.status.as_u16() == 401 && refused.text.contains("<h1>"), "{}", refused.text);
    browser.page.goto(&format!("{}/moderation", service.url)).await.unwrap();
    browser.click("main form[action$=sign-out] button").await;
    browser.wait("return document.querySelectorAll('main [name=key]').length", |count| *count == 1).await;
    browser.page.close_window().await.unwrap();
}

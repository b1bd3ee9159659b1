//! Every page is examined by axe-core in a real browser: on a desktop and a phone, light and dark.

use std::process::Command;

use super::driver::Browser;
use crate::support::commands::{plumbline, succeeded};
use crate::support::epoch::Scene;
use crate::support::pages::must_be_asked_for;
use crate::support::{Service, repository};
use fantoccini::Locator;
use serde_json::{Value, json};

/// Version of axe-core, from npm.
const AXE: &str = "4.14.1";

/// Its rules on colours.
const COLOURS: [&str; 2] = ["color-contrast", "link-in-text-block"];

/// The script of axe-core. It is installed once, below `target`.
fn axe() -> String {
    let folder = repository("target/axe");
    let script = folder.join("node_modules/axe-core/axe.min.js");
    if !script.exists() {
        std::fs::create_dir_all(&folder).unwrap();
        let mut install = Command::new("npm");
        install.args(["install", "--silent", "--no-audit", "--no-fund", "--no-save", "--prefix", "."]);
        let done = install.arg(format!("axe-core@{AXE}")).current_dir(&folder).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }
    std::fs::read_to_string(script).unwrap()
}

#[tokio::test]
async fn pages_have_no_faults_that_axe_finds() {
    let mut scene = Scene::new(&[]);
    let key = scene.key("lab");
    scene.service.use_key(Some(&key));
    let made = plumbline(&["keys", "create", "--name", "operator", "--scopes", "admin"], &scene.file("p.db"));
    let admin = succeeded(&made);
    let service = &scene.service;
    let good = service.finished_run("steady", 0).await;
    let bad = service.finished_run("hasty", 20).await;
    let card = json!({ "model": { "name": "m-7b", "openness": "open-weights" },
                       "cost": { "amount": 4.5, "currency": "USD", "prices_as_of": "2026-11-01" } });
    let put = service.http.put(format!("{}/v1/runs/{good}/card", service.url)).json(&card);
    assert!(service.send(put).await.status.is_success());
    let listed = service.get(&format!("/v1/runs/{bad}/submissions")).await.json();
    let [first, last] = [0, 24].map(|i| listed["submissions"][i]["id"].as_str().unwrap().to_owned());
    let number = &listed["submissions"][0]["number"];
    let pages = [
        "/".to_owned(),
        "/boards/mineceraft-lite".to_owned(),
        "/boards/mineceraft-lite?track=brief&sort=shape".to_owned(),
        format!("/boards/mineceraft-lite/compare?a={good}&b={bad}"),
        format!("/runs/{good}"),
        format!("/runs/{bad}?show=failed"),
        format!("/submissions/{first}"),
        format!("/submissions/{last}"),
        format!("/compare?a={first}&b={last}"),
        format!("/submissions/{last}/evidence.html"),
        "/suites/mineceraft-lite/tasks".to_owned(),
        format!("/suites/mineceraft-lite/tasks/{number}"),
        "/epochs".to_owned(),
        "/epochs/autumn".to_owned(),
        "/boards/mineceraft-lite/charts".to_owned(),
        "/boards/mineceraft-lite/log".to_owned(),
        "/agents/steady".to_owned(),
        "/search?text=e".to_owned(),
        "/moderation".to_owned(),
        "/docs/".to_owned(),
        "/docs/create_submission".to_owned(),
        "/docs/schemas/NewSubmissionBody".to_owned(),
        "/nosuch".to_owned(),
        "/boards/mineceraft-lite?nosuch=1".to_owned(),
        "/about".to_owned(),
    ];
    let is_page = |route: &str| route.split_once('.').is_none_or(|(_, kind)| kind == "html");
    // A problem of a run leads to the page of its answer.
    must_be_asked_for(&pages, |route| {
        is_page(route) && !route.ends_with("/{file}") && route != "/runs/{id}/tasks/{number}"
    });
    let signed_in = ["/moderation".to_owned()];
    let (axe, browser) = (axe(), Browser::open().await);
    let examine = "const done = arguments[arguments.length - 1]; document.querySelectorAll('details').forEach(d => { d.open = true; }); \
                   axe.run(document, arguments[0]).then(found => done(found.violations.map(v => \
                   [v.id, v.help, v.nodes.slice(0, 3).map(n => n.target.join(' '))])))";
    let mut faults = Vec::new();
    let sizes = [(1280, 900), (390, 844)];
    let rounds = sizes.map(|size| (size, &pages[..])).into_iter().chain(sizes.map(|size| (size, &signed_in[..])));
    for (round, ((width, height), pages)) in rounds.enumerate() {
        browser.page.set_window_size(width, height).await.unwrap();
        if round == sizes.len() {
            sign_in(&browser, service, &admin).await;
        }
        for page in pages {
            browser.page.goto(&format!("{}{page}", service.url)).await.unwrap();
            browser.run(&axe).await;
            for (theme, colours) in [("light", "none"), ("dark", "none"), ("dark", "active")] {
                let features = json!({ "features": [{ "name": "prefers-color-scheme", "value": theme },
                                                    { "name": "forced-colors", "value": colours }] });
                browser.command("Emulation.setEmulatedMedia", features).await;
                // All else that axe looks at is the same in every theme.
                let rules = if theme == "light" { json!({}) } else { json!({ "runOnly": COLOURS }) };
                let found = browser.page.execute_async(examine, vec![rules]).await.unwrap();
                let found: Vec<&Value> = found.as_array().unwrap().iter().collect();
                faults.extend(
                    found.into_iter().map(|fault| format!("{page} {width} {theme}, forced colours {colours}: {fault}")),
                );
                let wide = "return document.documentElement.scrollWidth - document.documentElement.clientWidth";
                if browser.run(wide).await != 0 {
                    let widest = "return [...document.querySelectorAll('main *')].filter(e => e.getBoundingClientRect().right > innerWidth) \
                                  .map(e => e.tagName + '.' + e.className).slice(0, 5)";
                    faults
                        .push(format!("{page} {width} {theme}: wider than the window: {}", browser.run(widest).await));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
    browser.page.close_window().await.unwrap();
}

/// Signs an operator in, so that the page of moderation shows its tables.
async fn sign_in(browser: &Browser, service: &Service, key: &str) {
    browser.page.goto(&format!("{}/moderation", service.url)).await.unwrap();
    browser.page.find(Locator::Css("main [name=key]")).await.unwrap().send_keys(key).await.unwrap();
    browser.click("main form button").await;
    browser.wait("return document.querySelectorAll('main table').length > 0", |has_tables| *has_tables == true).await;
}

//! Pages as people use them, in a real browser that is driven: sort, filter, follow, turn on stress, step through the
//! replay. Screenshots of what it sees go to `target/screenshots`.

use super::driver::Browser;
use crate::support::epoch::Scene;
use crate::support::{Service, good_build};
use fantoccini::Locator;
use fantoccini::key::Key;
use plumbline_engine::checks::Criterion;
use plumbline_engine::tasks::embedded;
use serde_json::{Value, json};

const ROWS: &str = "return [...document.querySelectorAll('table')][0].tBodies[0].rows.length";
const CANVAS: &str = "return {...document.querySelector('.viewer canvas').dataset}";

/// Whether the lowest level alone is shown, the path of the builder, and the first material.
const KEPT: &str = "const find = (name) => document.querySelector(`[data-control=${name}]`); return [find('slice').value === find('slice').min, \
                    find('walk').checked, find('materials').querySelector('input').checked]";

#[tokio::test]
async fn a_reader_finds_the_way_from_the_board_to_the_evidence() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let markup = "<img src=x onerror=alert(1)>";
    service.finished_run("steady", 0).await;
    service.finished_run(markup, 8).await;
    let browser = Browser::open().await;
    let page = &browser.page;

    // Home, on a phone; then the board: sort by a column, filter by a name.
    page.set_window_size(390, 844).await.unwrap();
    page.goto(&service.url).await.unwrap();
    browser.see("home-phone").await;
    browser.is_well(&service).await;
    page.set_window_size(1280, 1000).await.unwrap();
    page.goto(&format!("{}/boards/mineceraft-lite", service.url)).await.unwrap();
    assert_eq!(browser.run(ROWS).await, 2);
    assert_eq!(browser.run("return document.querySelectorAll('main img').length").await, 0, "names are text");
    browser.see("board").await;
    browser.click(".figures > summary").await;
    browser.click(".figures a[href*='sort=material']").await;
    let sorted = "return document.querySelector('th[aria-sort]').textContent.trim() + location.search";
    browser.wait(sorted, |told| told == "material ▼?sort=material").await;
    browser.click("th[aria-sort] a").await;
    browser.wait(sorted, |told| told.as_str().is_some_and(|told| told.starts_with("material ▲"))).await;
    let field = page.find(Locator::Css("input[name=agent]")).await.unwrap();
    field.send_keys("steady").await.unwrap();
    field.send_keys(&String::from(char::from(Key::Enter))).await.unwrap();
    browser.wait(ROWS, |rows| *rows == 1).await;
    browser.is_well(&service).await;

    // On to the run, and to a problem's evidence with the build in 3D.
    browser.click("th a[href^='/runs/']").await;
    browser.wait("return document.querySelectorAll('.problems .solved').length", |solved| *solved == 25).await;
    browser.see("run").await;
    browser.is_well(&service).await;
    assert_eq!(browser.run("return document.querySelectorAll('main a:not(details a)').length < 15").await, true);
    browser.click("details.family > summary").await;
    let is_drawn = "const i = document.querySelector('.cards img'); return i.complete && i.naturalWidth";
    browser.wait(is_drawn, |width| width.as_u64().is_some_and(|pixels| pixels > 100)).await;
    browser.see("run-open").await;
    browser.click(".cards a").await;
    browser.wait(CANVAS, |canvas| canvas["blocks"].as_str().is_some_and(|blocks| blocks != "0")).await;
    browser.is_well(&service).await;
    page.set_window_size(390, 844).await.unwrap();
    browser.see("submission-phone").await;
    browser.is_well(&service).await;
    page.close_window().await.unwrap();
}

#[tokio::test]
async fn a_build_is_looked_at_from_all_sides() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let suite = embedded::latest().unwrap();
    let is_stressed = |task: &&plumbline_engine::tasks::Task| {
        task.checks().any(|check| check.criterion() == Criterion::StructuralStability)
    };
    let task = suite.tasks.iter().find(is_stressed).unwrap();
    let id = service.post_json("/v1/submissions", &good_build(task, false, None)).await.json()["id"]
        .as_str()
        .unwrap()
        .to_owned();
    // A wall with one block in the air beside it.
    let floating = json!({ "task": "walls/5x1x5-raise", "turns": [{ "palette": ["stone"], "rows": [[0, 0, 0, 0], [3, 5, 3, 0]] }] });
    let other = service.post_json("/v1/submissions", &floating).await.json()["id"].as_str().unwrap().to_owned();
    for id in [&id, &other] {
        service.wait_for(&format!("/v1/submissions/{id}"), |submission| submission["state"] == "graded").await;
    }
    let browser = Browser::open().await;
    let page = &browser.page;
    page.set_window_size(1100, 1200).await.unwrap();
    page.goto(&format!("{}/submissions/{id}", service.url)).await.unwrap();
    let whole = browser.wait(CANVAS, |canvas| canvas["faces"].is_string()).await;
    // The pixel in the middle, read in the frame that draws it.
    let painted = "const done = arguments[0], c = document.querySelector('.viewer canvas'), gl = c.getContext('webgl2'); \
                   c.dispatchEvent(new KeyboardEvent('keydown', { key: 'Home' })); \
                   requestAnimationFrame(() => { const p = new Uint8Array(4); \
                   gl.readPixels(c.width / 2, c.height / 2, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, p); done([...p]); })";
    let pixel = || async { page.execute_async(painted, Vec::new()).await.unwrap() };
    let by_material = pixel().await;
    assert_eq!(by_material[3], 255, "something is drawn in the middle");
    browser.see("by-material").await;

    // Stress by both methods, with a scale.
    let legend = "return document.querySelector('[data-control=legend]').textContent";
    for method in ["fem", "sph"] {
        browser.click(&format!("[data-control=colour] option[value={method}]")).await;
        browser.wait(legend, |told| told.as_str().is_some_and(|told| told.ends_with("Pa"))).await;
        assert_eq!(browser.run(CANVAS).await["mode"], method);
        browser.see(&format!("by-stress-{method}")).await;
    }
    assert_ne!(pixel().await, by_material, "stress has other colours");

    // Step back through the replay, slice, hide, turn with the keyboard; the address keeps it.
    let events: u64 = whole["step"].as_str().unwrap().parse().unwrap();
    let before_last = json!((events - 1).to_string());
    browser.click("[data-control=back]").await;
    browser.wait(CANVAS, |canvas| canvas["step"] == before_last).await;
    browser.click("[data-control=walk]").await;
    browser.see("path").await;
    browser.run("const s = document.querySelector('[data-control=slice]'); s.value = s.min; s.dispatchEvent(new Event('input'))").await;
    let fewer = |canvas: &Value| canvas["blocks"].as_str().unwrap().parse::<u64>().unwrap() < events - 1;
    browser.wait(CANVAS, fewer).await;
    browser.click("[data-control=materials] input").await;
    let before = browser.run("return location.hash").await;
    let canvas = page.find(Locator::Css(".viewer canvas")).await.unwrap();
    canvas.send_keys(&String::from(char::from(Key::Left))).await.unwrap();
    assert_eq!(browser.run("return getComputedStyle(document.querySelector('.keys')).display").await, "block");
    let after = browser.wait("return location.hash", |hash| *hash != before).await;
    page.goto(&format!("{}/submissions/{id}{}", service.url, after.as_str().unwrap())).await.unwrap();
    page.refresh().await.unwrap();
    browser.wait(CANVAS, |canvas| canvas["step"] == before_last && canvas["mode"] == "sph").await;
    assert_eq!(browser.run(KEPT).await, json!([true, true, false]));
    browser.is_well(&service).await;

    // Witnesses; two side by side; a task's good build.
    page.goto(&format!("{}/submissions/{other}", service.url)).await.unwrap();
    browser.wait(CANVAS, |canvas| canvas["faces"] == "12").await;
    // The verdict stands before the build, failed checks first; opening one shows its blocks alone, closing it all.
    let texts = "return [...document.querySelectorAll('details.check > summary')].map(s => s.innerText)";
    let told = browser.run(texts).await;
    assert!(told[0].as_str().unwrap().contains("No block floats\n1 of 2 blocks float"), "{told}");
    browser.click("details.check > summary").await;
    browser.wait(legend, |told| told == "1 flagged block, in red").await;
    assert_eq!(browser.run(CANVAS).await["mode"], "witness");
    browser.see("flagged").await;
    browser.click("details.check > summary").await;
    browser.wait(CANVAS, |canvas| canvas["mode"] == "material").await;
    // The wheel scrolls the page until the view has the focus.
    let wheel = "const c = document.querySelector('.viewer canvas'); \
                 return c.dispatchEvent(new WheelEvent('wheel', { deltaY: 100, cancelable: true }))";
    browser.run("document.activeElement.blur()").await;
    assert_eq!(browser.run(wheel).await, json!(true), "the page scrolls");
    browser.run("document.querySelector('.viewer canvas').focus()").await;
    assert_eq!(browser.run(wheel).await, json!(false), "the view takes it");
    browser.click("[data-control=colour] option[value=witness]").await;
    browser.wait(legend, |told| told.as_str().is_some_and(|told| told.ends_with("flagged blocks, in red"))).await;
    browser.see("witnesses").await;
    page.goto(&format!("{}/compare?a={id}&b={other}", service.url)).await.unwrap();
    browser.wait("return document.querySelectorAll('.viewer.live').length", |live| *live == 2).await;
    browser.see("side-by-side").await;
    browser.is_well(&service).await;
    page.goto(&format!("{}/suites/mineceraft/tasks/{}", service.url, task.number)).await.unwrap();
    browser.wait(CANVAS, |canvas| canvas["faces"].is_string()).await;

    // The evidence as one file, opened from disk, where there is no service.
    let file = folder.path().join("evidence.html");
    let evidence = service.get(&format!("/submissions/{id}/evidence.html")).await;
    assert!(evidence.headers["content-security-policy"].to_str().unwrap().contains("script-src 'sha256-"));
    std::fs::write(&file, evidence.text).unwrap();
    browser.is_well(&service).await;
    page.goto(&format!("file://{}", file.display())).await.unwrap();
    browser.wait(CANVAS, |canvas| canvas["blocks"] == whole["blocks"]).await;
    browser.click("[data-control=colour] option[value=fem]").await;
    browser.wait(legend, |told| told.as_str().is_some_and(|told| told.ends_with("Pa"))).await;
    let errors: Vec<Value> = browser.log("browser").await.into_iter().filter(|e| e["level"] == "SEVERE").collect();
    assert!(errors.is_empty(), "{errors:?}");

    // Without scripts there is a picture.
    let picture = service.get(&format!("/submissions/{id}/view.svg")).await;
    assert!(picture.kind == "image/svg+xml" && picture.text.matches("<path").count() > 50);
    page.close_window().await.unwrap();
}

#[tokio::test]
async fn a_reader_sees_epochs_their_clocks_and_what_they_revealed() {
    let scene = Scene::new(&[]);
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "official", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    scene.answer(&lab, &drawn, 2).await;
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    scene.service.wait_for(&format!("/v1/entries/{entry}"), |entry| entry["state"] == "complete").await;
    let service = &scene.service;
    let browser = Browser::open().await;
    let page = &browser.page;
    page.set_window_size(390, 844).await.unwrap();
    page.goto(&format!("{}/epochs", service.url)).await.unwrap();
    browser.see("epochs-phone").await;
    browser.is_well(service).await;
    browser.click("th a[href='/epochs/autumn']").await;
    // The clock runs.
    let left = "return document.querySelector('time[data-until]').textContent";
    let first = browser.wait(left, |told| told.as_str().is_some_and(|told| told.contains("min"))).await;
    browser.wait(left, |told| *told != first).await;
    let told = browser.run("return document.body.textContent").await;
    assert!(
        told.as_str().unwrap().contains("Entries registered: 1. Scores are published when the epoch is over"),
        "{told}"
    );
    page.set_window_size(1280, 1000).await.unwrap();
    browser.see("epoch").await;
    browser.is_well(service).await;
    scene.end_epoch().await;
    page.refresh().await.unwrap();
    browser.wait(ROWS, |rows| *rows == 1).await;
    let told = browser.run("return document.querySelector('tbody').textContent").await;
    assert!(told.as_str().unwrap().contains("24 of 26"), "{told}");
    // A heading stands above its column; on a phone each cell begins with it.
    let edges = "return [...document.querySelectorAll('.rows tr')].map(row => Math.round(row.children[3].getBoundingClientRect().right))";
    let edges = browser.run(edges).await;
    assert!(edges[0].is_number() && edges[0] == edges[1], "{edges}");
    browser.see("epoch-over").await;
    browser.is_well(service).await;
    page.set_window_size(390, 844).await.unwrap();
    let label = "return getComputedStyle(document.querySelector('.rows td:nth-of-type(2)'), '::before').content";
    assert_eq!(browser.run(label).await, "\"overall\"");
    browser.see("epoch-over-phone").await;
    browser.is_well(service).await;
    page.close_window().await.unwrap();
}

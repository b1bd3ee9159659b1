//! The announcement of an epoch in the log: it is public at once, so an operator who withholds it is found.

use plumbline_engine::hidden::announcements::{Announcement, EpochFact, receipt};
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::receipts::{LogHead, LogPage, Signer};
use plumbline_engine::hidden::reveal::Reveal;
use plumbline_engine::hidden::verify::{Kept, verify};
use serde_json::json;

use crate::support::epoch::{Scene, appended};

/// What is broken in a reveal by the pages of the log.
fn breaches(reveal: &Reveal, page: &LogPage) -> Vec<String> {
    let kept = Kept { log: page.receipts.clone(), heads: page.head.iter().cloned().collect(), ..Kept::default() };
    let found = verify(reveal, &kept).unwrap();
    found.breaches.iter().map(|breach| format!("{}: {}", breach.subject, breach.detail)).collect()
}

#[tokio::test]
async fn an_epoch_is_announced_for_all_to_see_before_anything_of_it() {
    let scene = Scene::new(&["--per-instance", "1"]);
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "dev", 1).await;
    scene.draw(&lab, &entry, 1).await;
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    scene.end_epoch().await;
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await.json();
    let reveal: Reveal = serde_json::from_value(reveal).unwrap();
    let pages = scene.service.get("/v1/receipts?limit=1000").await.json();
    let saved = || serde_json::from_value::<LogPage>(pages.clone()).unwrap();
    assert_eq!(breaches(&reveal, &saved()), [""; 0]);

    let mut withheld = saved();
    (withheld.receipts[0].receipt, withheld.receipts[0].signature) = (None, None);
    let told = breaches(&reveal, &withheld);
    assert!(told.len() == 1 && told[0].starts_with("log: does not announce the epoch, or withholds"), "{told:?}");

    // The operator, who has the key, announces it again, as late as the terms of the reveal were made.
    let key = std::fs::read_to_string(scene.file("p.db.secrets/receipts.key")).unwrap();
    let signer = Signer::new(&unhex(key.trim()).unwrap());
    let fact = EpochFact { commitment: Box::new(reveal.commitment.clone()), committed_at_ms: 7 };
    let (last, body) = (withheld.receipts.last().unwrap().clone(), receipt(&Announcement::Epoch(fact)));
    let file = appended(&last, body, &signer);
    withheld.head = Some(LogHead::signed(file.seq, file.link.clone(), 8, &signer));
    withheld.receipts.push(file);
    let told = breaches(&reveal, &withheld);
    assert!(told.len() == 1 && told[0].contains("announces the epoch after receipt 2, which is one"), "{told:?}");

    // Pages that were not saved are missed as such, and nobody is accused of withholding.
    let mut partial = saved();
    partial.receipts.truncate(1);
    (partial.receipts[0].receipt, partial.receipts[0].signature) = (None, None);
    let mut later = reveal;
    later.receipts.iter_mut().flatten().for_each(|file| file.seq += 5);
    let told = breaches(&later, &partial);
    assert!(!told.iter().any(|told| told.contains("withholds")), "{told:?}");
}

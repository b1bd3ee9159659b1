//! The page of an epoch in an archive, which is not signed: compared with the commitment and with the signed end.

use serde_json::{Value, json};

use crate::clock::rfc3339;
use plumbline_engine::hidden::FIRST_WITH_KEPT_PART;
use plumbline_engine::hidden::announcements::{Announcement, announcement};
use plumbline_engine::hidden::evidence::{Fact, fact};
use plumbline_engine::hidden::feedback::{Feedback, Tier, released_bits};
use plumbline_engine::hidden::receipts::ReceiptFile;
use plumbline_engine::hidden::reveal::{Reveal, RevealedInstance};

/// Returns in which members the page of an epoch that is over differs from the reveal and its receipts; `raw` is the reveal
/// as JSON, which may have members that this program does not know, and `log` the public log, which announces the epoch.
pub(super) fn differences(page: &Value, raw: &Value, reveal: &Reveal, log: &[ReceiptFile]) -> Vec<String> {
    let commitment = &reveal.commitment;
    let facts = reveal.receipts.iter().flatten().filter_map(|file| fact(file.receipt.as_ref()?));
    let closed = facts.filter_map(|fact| if let Fact::Closed(closed) = fact { Some(closed) } else { None }).next_back();
    let entries = |tier: Tier| reveal.entries.iter().filter(|entry| entry.tier == tier).count();
    let told = |tier: Tier| tier.feedback(commitment.dev_feedback);
    let mut expected: Vec<(&str, Value)> = vec![
        ("id", commitment.epoch.clone().into()),
        ("state", "closed".into()),
        ("opens_at", rfc3339(commitment.opens_at_ms).into()),
        ("closes_at", rfc3339(commitment.closes_at_ms).into()),
        ("entries", json!({ "dev": entries(Tier::Dev), "official": entries(Tier::Official) })),
        ("commitment", raw["commitment"].clone()),
        ("feedback", json!({ "open": Feedback::Full, "dev": told(Tier::Dev), "official": told(Tier::Official) })),
    ];
    let pool = reveal.specifications.len();
    let (siblings, own): (Vec<_>, Vec<_>) = reveal.instances.iter().partition(|one| one.leaf as usize >= pool);
    let answered = |all: &[&RevealedInstance]| all.iter().filter(|one| one.log_sha256.is_some()).count();
    expected.extend([("issued", own.len().into()), ("answered", answered(&own).into())]);
    if commitment.siblings.is_some() {
        expected
            .extend([("siblings_issued", siblings.len().into()), ("siblings_answered", answered(&siblings).into())]);
    }
    if let Some(beacon) = &commitment.beacon {
        expected.push(("registration_closes_at", rfc3339(beacon.emitted_at_ms()).into()));
        expected.push(("pool", raw["pool"].clone()));
    }
    if let Some(rules) = &commitment.rules {
        expected.extend([
            ("instance_seconds", rules.instance_seconds.into()),
            ("dev_entries_per_owner", rules.dev_entries_per_owner.into()),
            ("official_entries_per_owner", rules.official_entries_per_owner.into()),
            ("budget_bits", f64::from(rules.budget_bits).into()),
        ]);
    }
    if let Some(closed) = closed {
        let early = Some(&closed).filter(|closed| closed.closed_at_ms < commitment.closes_at_ms);
        expected.push(("closed_early_at", early.map(|closed| rfc3339(closed.closed_at_ms)).into()));
        expected.push(("closed_reason", early.map(|closed| closed.reason.clone()).into()));
    }
    let mut announced = log.iter().filter_map(|file| announcement(file.receipt.as_ref()?));
    let committed = announced.find_map(|told| match told {
        Announcement::Epoch(told) if told.commitment.epoch == commitment.epoch => Some(told.committed_at_ms),
        _ => None,
    });
    expected.extend(committed.map(|at_ms| ("committed_at", rfc3339(at_ms).into())));
    let differs = |(name, wanted): (&str, Value)| {
        let found = page.get(name).unwrap_or(&Value::Null);
        let is_same = *found == wanted;
        let told = if name == "commitment" {
            "commitment: is not the one of the reveal".to_owned()
        } else {
            format!("{name}: says {found}, and the reveal with its receipts says {wanted}")
        };
        (!is_same).then_some(told)
    };
    expected.into_iter().filter_map(differs).chain(untrue_bits(page, reveal)).collect()
}

/// Returns how the released bits on the page differ from those of the completed entries. Programs of the first protocol
/// counted them in another way.
fn untrue_bits(page: &Value, reveal: &Reveal) -> Option<String> {
    let commitment = &reveal.commitment;
    if commitment.protocol() < FIRST_WITH_KEPT_PART || reveal.entries.iter().any(|own| own.completed_at_ms.is_none()) {
        return None;
    }
    let answered =
        |entry: &str| reveal.instances.iter().filter(|own| own.entry == entry && own.log_sha256.is_some()).count();
    let bits: f64 = reveal
        .entries
        .iter()
        .map(|own| released_bits(own.tier.feedback(commitment.dev_feedback), answered(&own.id)))
        .sum();
    let told = &page["released_bits"];
    // The page has one decimal place.
    let is_same = told.as_f64().is_some_and(|told| (told - bits).abs() < 0.051);
    (!is_same).then(|| format!("released_bits: says {told}, and the completed entries release {bits:.1}"))
}

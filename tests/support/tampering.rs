//! What an operator may change in a reveal.

use plumbline_engine::hidden::canonical::canonical_json;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::epoch::Scene;

/// Every way in which an operator may change what is revealed, with a name each.
#[expect(clippy::too_many_lines, reason = "a list")]
pub fn tamperings(reveal: &Value) -> Vec<(String, Value)> {
    let mut all: Vec<(String, Value)> = Vec::new();
    let mut change = |name: &str, how: &dyn Fn(&mut Value)| {
        let mut changed = reveal.clone();
        how(&mut changed);
        assert_ne!(changed, *reveal, "{name} changes nothing");
        all.push((name.to_owned(), changed));
    };
    let find =
        |wanted: &dyn Fn(&Value) -> bool| reveal["instances"].as_array().unwrap().iter().position(wanted).unwrap();
    let passing = find(&|own| own["overall"] == true);
    let failing = find(&|own| own["overall"] == false);
    let entries = reveal["entries"].as_array().unwrap().len();
    let receipts = reveal["receipts"].as_array().unwrap().len();
    change("grades of a lab erased as failures of the service", &|changed| {
        let entry = changed["entries"][0]["id"].clone();
        for own in changed["instances"].as_array_mut().unwrap().iter_mut().filter(|own| own["entry"] == entry) {
            (own["overall"], own["scores"]) = (Value::Null, Value::Null);
        }
    });
    change("one grade erased", &|changed| {
        let own = &mut changed["instances"][passing];
        (own["overall"], own["scores"]) = (Value::Null, Value::Null);
    });
    change("an answer declared unanswered", &|changed| {
        let own = &mut changed["instances"][passing];
        (own["overall"], own["scores"], own["log_sha256"]) = (Value::Null, Value::Null, Value::Null);
    });
    change("a failing verdict made a passing one", &|changed| changed["instances"][failing]["overall"] = true.into());
    change("another answer's log and grade", &|changed| {
        for member in ["log_sha256", "overall", "scores"] {
            changed["instances"][failing][member] = reveal["instances"][passing][member].clone();
        }
    });
    change("the last entry dropped with its instances", &|changed| {
        let entry = changed["entries"].as_array_mut().unwrap().pop().unwrap()["id"].clone();
        changed["instances"].as_array_mut().unwrap().retain(|own| own["entry"] != entry);
    });
    change("the last entry dropped with its receipts too", &|changed| {
        let entry = changed["entries"].as_array_mut().unwrap().pop().unwrap()["id"].clone();
        let gone: Vec<Value> = changed["instances"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|own| own["entry"] == entry)
            .map(|own| own["id"].clone())
            .collect();
        changed["instances"].as_array_mut().unwrap().retain(|own| own["entry"] != entry);
        let is_of = |receipt: &Value| {
            let body = &receipt["receipt"];
            [&body["entry"]["id"], &body["draw"]["entry"], &body["answer"]["entry"], &body["completed"]["entry"]]
                .contains(&&entry)
                || gone.contains(&body["instance"])
        };
        changed["receipts"].as_array_mut().unwrap().retain(|receipt| !is_of(receipt));
    });
    for member in [
        "agent",
        "owner",
        "configuration_hash",
        "runs",
        "registered_at_ms",
        "finalized_at_ms",
        "completed_at_ms",
        "tier",
    ] {
        change(&format!("an entry's {member} changed"), &|changed| {
            let own = &mut changed["entries"][0][member];
            *own = match member {
                "tier" => "dev".into(),
                "agent" | "owner" => "somebody else".into(),
                "configuration_hash" => "0".repeat(64).into(),
                _ => (own.as_i64().unwrap() + 1).into(),
            };
        });
    }
    change("a phantom entry", &|changed| {
        let mut phantom = changed["entries"][0].clone();
        phantom["id"] = "0198c0de-0000-7000-8000-000000000003".into();
        changed["entries"].as_array_mut().unwrap().push(phantom);
    });
    change("a duplicate entry", &|changed| {
        let own = changed["entries"][entries - 1].clone();
        changed["entries"].as_array_mut().unwrap().push(own);
    });
    change("two entries that share their ids", &|changed| {
        changed["entries"][1]["id"] = changed["entries"][0]["id"].clone();
    });
    change("the key of draws left out", &|changed| {
        changed["commitment"].as_object_mut().unwrap().remove("draw_key").unwrap();
    });
    change("another key of draws", &|changed| changed["commitment"]["draw_key"] = "ab".repeat(32).into());
    let of_draw = |own: &Value| own["receipt"].get("draw").is_some();
    let drawn = reveal["receipts"].as_array().unwrap().iter().position(of_draw).unwrap();
    change("the proof of a draw left out", &|changed| {
        changed["receipts"][drawn]["receipt"]["draw"].as_object_mut().unwrap().remove("proof").unwrap();
    });
    change("the proof of a draw changed", &|changed| {
        changed["receipts"][drawn]["receipt"]["draw"]["proof"] = "0".repeat(160).into();
    });
    change("a run drawn with more than one nonce", &|changed| {
        changed["instances"][3]["nonce"] = "chosen afterwards".into();
    });
    change("a run drawn with another nonce", &|changed| {
        let entry = changed["entries"][0]["id"].clone();
        for own in changed["instances"].as_array_mut().unwrap().iter_mut().filter(|own| own["entry"] == entry) {
            own["nonce"] = "chosen afterwards".into();
        }
    });
    change("another specification", &|changed| {
        changed["instances"][2]["leaf"] = reveal["instances"][5]["leaf"].clone();
    });
    change("two instances changed places", &|changed| changed["instances"].as_array_mut().unwrap().swap(0, 1));
    change("an instance taken out", &|changed| drop(changed["instances"].as_array_mut().unwrap().remove(7)));
    change("an instance of another id", &|changed| {
        changed["instances"][1]["id"] = "5f0c0000-0000-4000-8000-000000000000".into();
    });
    change("a transcript promised afterwards", &|changed| {
        changed["instances"][1]["transcript_sha256"] = "0".repeat(64).into();
    });
    change("a transcript shown that was not", &|changed| changed["instances"][1]["transcript_checked"] = true.into());
    change("an entry that never ended", &|changed| {
        let id = changed["entries"][0]["id"].clone();
        for member in ["finalized_at_ms", "completed_at_ms"] {
            changed["entries"][0][member] = Value::Null;
        }
        let receipts = changed["receipts"].as_array_mut().unwrap();
        receipts.retain(|receipt| receipt["receipt"]["completed"]["entry"] != id);
    });
    change("a prompt changed", &|changed| {
        changed["specifications"][4]["task"]["turns"][0]["prompt"] = "Do nothing.".into();
    });
    change("rules changed", &|changed| changed["commitment"]["rules"]["official_entries_per_owner"] = 1_000.into());
    change("the closing time changed", &|changed| changed["commitment"]["closes_at_ms"] = 1.into());
    for at in [0, receipts / 2, receipts - 1] {
        change(&format!("receipt {at} taken out"), &|changed| {
            drop(changed["receipts"].as_array_mut().unwrap().remove(at));
        });
        change(&format!("receipt {at} twice"), &|changed| {
            let own = changed["receipts"][at].clone();
            changed["receipts"].as_array_mut().unwrap().push(own);
        });
        change(&format!("receipt {at} in another place"), &|changed| {
            let own = &mut changed["receipts"][at]["seq"];
            *own = (own.as_i64().unwrap() + 1_000).into();
        });
        change(&format!("receipt {at} with another salt"), &|changed| {
            let own = &mut changed["receipts"][at];
            own["receipt"]["salt"] = "0".repeat(64).into();
            own["hash"] = plumbline_engine::tasks::hex(&Sha256::digest(canonical_json(&own["receipt"]))).into();
        });
    }
    change("no receipts at all", &|changed| changed["receipts"] = json!([]));
    all
}

/// A reveal in which the last entry never was, with receipts that are signed anew.
pub fn forged_without_the_last_entry(scene: &Scene, reveal: &Value) -> Value {
    signed_anew(scene, tamperings(reveal).into_iter().find(|(name, _)| name.contains("receipts too")).unwrap().1)
}

/// Reveals whose first draw asked for something else than its specifications, or does not say what it asked, with receipts
/// that are signed anew.
pub fn forged_with_other_prompts(scene: &Scene, reveal: &Value) -> [Value; 2] {
    [json!("00".repeat(32)), Value::Null].map(|hash| forged_with_prompts(scene, reveal, &hash))
}

fn forged_with_prompts(scene: &Scene, reveal: &Value, hash: &Value) -> Value {
    let mut forged = reveal.clone();
    let mut receipts = forged["receipts"].as_array_mut().unwrap().iter_mut();
    let draw = receipts.find(|file| file["receipt"].get("draw").is_some()).unwrap();
    match hash {
        Value::Null => drop(draw["receipt"]["draw"].as_object_mut().unwrap().remove("prompts_sha256")),
        hash => draw["receipt"]["draw"]["prompts_sha256"][0] = hash.clone(),
    }
    signed_anew(scene, forged)
}

fn signed_anew(scene: &Scene, mut forged: Value) -> Value {
    use plumbline_engine::hidden::receipts::{FIRST_LINK, Signer, link};
    let secret = std::fs::read_to_string(scene.file("p.db.secrets/receipts.key")).unwrap();
    let signer = Signer::new(&plumbline_engine::hidden::canonical::unhex(secret.trim()).unwrap());
    let receipts = forged["receipts"].as_array_mut().unwrap();
    let count = receipts.len();
    let mut previous = FIRST_LINK;
    for (seq, file) in (1..).zip(receipts.iter_mut()) {
        if file["receipt"].get("closed").is_some() {
            file["receipt"]["closed"]["receipts"] = (count - 1).into();
        }
        let signed = signer.sign(&file["receipt"]);
        let next = link(&previous, &signed.hash);
        let hex = |bytes: &[u8]| Value::from(plumbline_engine::tasks::hex(bytes));
        (file["seq"], file["hash"], file["signature"]) = (seq.into(), hex(&signed.hash), signed.signature.into());
        (file["previous"], file["link"]) = (hex(&previous), hex(&next));
        previous = next;
    }
    forged
}

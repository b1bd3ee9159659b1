//! The transparency log, read over HTTP with another implementation of its formats: checkpoint, tiles and proofs.

use std::collections::HashMap;

use crate::support::Service;
use crate::support::commands::{refused, succeeded};
use crate::support::database::is_postgres;
use plumbline_engine::tasks::hex;
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use signed_note::{Note, StandardVerifier, VerifierList};
use tlog_tiles::{Checkpoint, Hash, Tile, TileHashReader, TileReader};

/// Tiles as they were downloaded.
struct Tiles(HashMap<String, Vec<u8>>);

impl TileReader for Tiles {
    fn height(&self) -> u8 {
        8
    }

    fn read_tiles(&self, tiles: &[Tile]) -> Result<Vec<Vec<u8>>, tlog_tiles::Error> {
        Ok(tiles.iter().map(|tile| self.0[&path_of(tile)].clone()).collect())
    }

    fn save_tiles(&self, _tiles: &[Tile], _data: &[Vec<u8>]) {}
}

/// The path of a tile: that of the other implementation is that of its predecessor, with the height.
fn path_of(tile: &Tile) -> String {
    tile.path().replacen("tile/8/", "", 1)
}

/// Reads and verifies the checkpoint.
async fn checkpoint(service: &Service) -> Checkpoint {
    let key = service.get("/log/key").await.text;
    let known = VerifierList::new(vec![Box::new(StandardVerifier::new(key.trim()).unwrap())]);
    let note = Note::from_bytes(service.get("/log/checkpoint").await.text.as_bytes()).unwrap();
    note.verify(&known).unwrap();
    Checkpoint::from_bytes(note.text()).unwrap()
}

async fn tiles(service: &Service, size: u64) -> Tiles {
    let mut tiles = HashMap::new();
    for tile in Tile::new_tiles(8, 0, size) {
        let path = path_of(&tile);
        let answer = service.http.get(format!("{}/log/tile/{path}", service.url)).send().await.unwrap();
        assert_eq!(answer.status().as_u16(), 200, "{path}");
        assert!(answer.headers()["cache-control"].to_str().unwrap().contains("immutable"));
        tiles.insert(path, answer.bytes().await.unwrap().to_vec());
    }
    Tiles(tiles)
}

#[tokio::test]
async fn another_implementation_reads_the_log_and_proves_what_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    let empty = checkpoint(&service).await;
    assert_eq!((empty.size(), empty.hash()), (0, &tlog_tiles::EMPTY_HASH));
    let mut runs = Vec::new();
    for number in 0..11 {
        runs.push(service.finished_run(&format!("agent {number}"), 0).await);
    }
    let early = checkpoint(&service).await;
    assert!(early.size() >= 275, "{}", early.size());
    runs.push(service.finished_run("agent 11", 3).await);
    let late = checkpoint(&service).await;
    assert!(late.size() > early.size() && late.origin() == early.origin());

    // Every tile is authentic under the root, and the earlier log is the beginning of the later one.
    let read = tiles(&service, late.size()).await;
    let reader = TileHashReader::new(late.size(), *late.hash(), &read);
    assert_eq!(tlog_tiles::tree_hash(late.size(), &reader).unwrap(), *late.hash());
    let proof = tlog_tiles::prove_tree(late.size(), early.size(), &reader).unwrap();
    tlog_tiles::check_tree(&proof, late.size(), *late.hash(), early.size(), *early.hash()).unwrap();
    // That implementation does not compare every full tile with the one above, so that is done here.
    let above = read.0.iter().find(|(path, _)| path.starts_with("1/000")).unwrap().1;
    assert_eq!(Tile::subtree_hash(&read.0["0/000"]).0, above[..32]);
    let mut forged = read.0["0/000"].clone();
    forged[40] ^= 1;
    assert_ne!(Tile::subtree_hash(&forged).0, above[..32]);

    // The entries are the hashes of the receipts, in order.
    let page = service.get("/v1/receipts?limit=256").await.json();
    let hashes: Vec<&str> =
        page["receipts"].as_array().unwrap().iter().map(|own| own["hash"].as_str().unwrap()).collect();
    let bundle = service.http.get(format!("{}/log/tile/entries/000", service.url)).send().await.unwrap();
    let bundle = bundle.bytes().await.unwrap();
    let told: Vec<String> = bundle.chunks(34).map(|entry| hex(&entry[2..])).collect();
    assert!(bundle.chunks(34).all(|entry| entry[..2] == [0, 32]));
    assert_eq!(told, hashes);

    // A receipt carries its proof, which the other implementation and the command check.
    let listed = service.get(&format!("/v1/runs/{}/submissions", runs[4])).await.json();
    let submission = listed["submissions"][7]["id"].as_str().unwrap();
    let receipt = service.get(&format!("/v1/submissions/{submission}/receipt")).await.json();
    let bytes = |text: &Value| -> [u8; 32] {
        let text = text.as_str().unwrap();
        std::array::from_fn(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).unwrap())
    };
    let path = receipt["inclusion"]["path"].as_array().unwrap().iter().map(|hash| Hash(bytes(hash))).collect();
    let index = receipt["seq"].as_u64().unwrap() - 1;
    let own = Sha256::new().chain_update([0]).chain_update(bytes(&receipt["hash"])).finalize();
    assert_eq!(receipt["inclusion"]["size"], late.size());
    tlog_tiles::check_record(&path, late.size(), *late.hash(), index, Hash(own.into())).unwrap();
    let file = folder.path().join("receipt.json");
    let key =
        service.get("/.well-known/plumbline-receipts.json").await.json()["public_key"].as_str().unwrap().to_owned();
    let verify = |receipt: &Value| {
        std::fs::write(&file, receipt.to_string()).unwrap();
        std::process::Command::new(crate::support::PROGRAM)
            .args(["verify-receipt", file.to_str().unwrap(), "--key", &key])
            .output()
            .unwrap()
    };
    assert!(succeeded(&verify(&receipt)).contains("is in the log plumbline.log/"));
    for change in ["path", "size", "checkpoint"] {
        let mut changed = receipt.clone();
        match change {
            "path" => drop(changed["inclusion"]["path"].as_array_mut().unwrap().pop()),
            "size" => changed["inclusion"]["size"] = (late.size() - 1).into(),
            _ => {
                let note = changed["inclusion"]["checkpoint"].as_str().unwrap();
                changed["inclusion"]["checkpoint"] = note.replacen("log/", "log/0", 1).into();
            }
        }
        assert!(refused(&verify(&changed)).contains("does not hold"), "{change}");
    }
    for missing in ["0/009", "0/001", "entries/001.p/255", "9/000", "x", "0/000.p/300"] {
        assert_eq!(service.get(&format!("/log/tile/{missing}")).await.status.as_u16(), 404, "{missing}");
    }

    // The name of the log stays when its key changes.
    drop(service);
    std::fs::remove_file(folder.path().join("p.db.secrets/receipts.key")).unwrap();
    let service = Service::start(&database, &["--new-receipt-key"]);
    service.finished_run("agent 12", 0).await;
    let last = checkpoint(&service).await;
    assert!(last.size() > late.size() && last.origin() == late.origin(), "{}", last.origin());
}

#[tokio::test]
async fn two_histories_are_found_by_whoever_saw_the_other() {
    if is_postgres() {
        // A server's database is not copied with a folder: what a witness sees is the same on both.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let [ours, theirs] = ["a", "b"].map(|name| folder.path().join(name));
    std::fs::create_dir(&ours).unwrap();
    let service = Service::start(&ours.join("p.db"), &[]);
    service.finished_run("first", 0).await;
    let key = service.get("/log/key").await.text;
    let witness = |state: &str, url: &str, more: &[&str]| {
        let mut command = std::process::Command::new(crate::support::PROGRAM);
        command.args(["witness", url, "--state"]).arg(folder.path().join(state)).args(more);
        command.output().unwrap()
    };
    let first = refused(&witness("one", &service.url, &[]));
    assert!(first.contains("--log-key"), "{first}");
    let wrong = key.replacen("log/", "log/0", 1);
    assert!(refused(&witness("one", &service.url, &["--log-key", &wrong])).contains("--log-key"));
    for state in ["one", "two"] {
        let note =
            succeeded(&witness(state, &service.url, &["--log-key", &key, "--name", &format!("w.example/{state}")]));
        assert!(note.contains(&format!("\n— w.example/{state} ")), "{note}");
    }

    // The operator copies the service as it is, and lets the copies go different ways.
    drop(service);
    let copied = std::process::Command::new("cp").arg("-r").args([&ours, &theirs]).status().unwrap();
    assert!(copied.success());
    let services = [Service::start(&ours.join("p.db"), &[]), Service::start(&theirs.join("p.db"), &[])];
    services[0].finished_run("second", 0).await;
    services[1].finished_run("another", 0).await;
    succeeded(&witness("one", &services[0].url, &[]));
    succeeded(&witness("two", &services[1].url, &[]));
    services[0].finished_run("third", 0).await;
    services[1].finished_run("third", 0).await;
    for (state, url) in [("one", &services[1].url), ("two", &services[0].url)] {
        let told = refused(&witness(state, url, &[]));
        assert!(
            told.contains("BROKEN  the service shows another history") && told.matches("plumbline.log/").count() >= 4,
            "{told}"
        );
    }
    // A damaged state accuses nobody, and a name cannot write lines of its own.
    let kept = std::fs::read_to_string(folder.path().join("one")).unwrap();
    for damaged in [
        kept.replacen("\"roots\": [\n      \"", "\"roots\": [\n      \"00", 1),
        kept.replace("\"note\": \"plumbline", "\"note\": \"x"),
        "{}".to_owned(),
    ] {
        assert_ne!(damaged, kept);
        std::fs::write(folder.path().join("damaged"), damaged).unwrap();
        let output = witness("damaged", &services[0].url, &[]);
        assert_eq!(output.status.code(), Some(2), "could not be told");
        let told = refused(&output);
        assert!(!told.contains("BROKEN") && told.contains("--state"), "{told}");
    }
    for name in ["", "two words", "a\n— evil AAAA", "a+b"] {
        assert!(refused(&witness("three", &services[0].url, &["--log-key", &key, "--name", name])).contains("--name"));
    }
    // Each still follows its own.
    succeeded(&witness("one", &services[0].url, &[]));
    succeeded(&witness("two", &services[1].url, &[]));
}

#[tokio::test]
async fn cosignatures_of_witnesses_that_the_operator_knows_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let service = Service::start(&database, &[]);
    service.finished_run("first", 0).await;
    let log_key = service.get("/log/key").await.text;
    let witness = |name: &str, url: &str, more: &[&str]| {
        let mut command = std::process::Command::new(crate::support::PROGRAM);
        let state = folder.path().join(name);
        command.args(["witness", url, "--log-key", &log_key, "--name", &format!("w.example/{name}"), "--state"]);
        command.arg(state).args(more).output().unwrap()
    };
    let key_of = |name: &str| {
        let told = String::from_utf8(witness(name, &service.url, &[]).stderr).unwrap();
        told.lines().find_map(|line| line.strip_prefix("cosigned as ")).unwrap().to_owned()
    };
    let [one, two] = ["one", "two"].map(key_of);
    let told = refused(&witness("one", &service.url, &["--publish"]));
    assert!(told.contains("--witness KEY"), "{told}");
    assert_eq!(service.get("/log/cosigned").await.status.as_u16(), 404);
    drop(service);

    let service = Service::start(&database, &["--witness", &one, "--witness", &two]);
    let early = succeeded(&witness("one", &service.url, &["--publish"]));
    let witnesses = service.get("/log/witnesses").await.json();
    assert_eq!((&witnesses["witnesses"][0]["key"], &witnesses["witnesses"][1]["size"]), (&one.into(), &Value::Null));
    let size = witnesses["witnesses"][0]["size"].as_i64().unwrap();
    service.finished_run("second", 0).await;
    for name in ["one", "two"] {
        succeeded(&witness(name, &service.url, &["--publish"]));
    }
    let cosigned = service.get("/log/cosigned").await.text;
    let lines = ["— plumbline.log/", "— w.example/one ", "— w.example/two "];
    assert!(lines.iter().all(|line| cosigned.matches(line).count() == 1), "{cosigned}");

    // An old cosignature that is sent again changes nothing; what is none is refused with its reason.
    let send = |body: Vec<u8>| service.send(service.http.post(format!("{}/log/cosignatures", service.url)).body(body));
    assert_eq!(send(early.clone().into_bytes()).await.status.as_u16(), 204);
    let witnesses = service.get("/log/witnesses").await.json();
    assert!(witnesses["witnesses"][0]["size"].as_i64().unwrap() > size, "{witnesses}");
    let unsigned = early.rsplit_once("— w.example").unwrap().0.to_owned();
    for (body, status, told) in [
        (Vec::new(), 400, "not a checkpoint"),
        (b"\xff\xfe".to_vec(), 400, "no text"),
        (early.replacen(&format!("\n{size}\n"), "\n999\n", 1).into_bytes(), 400, "not a checkpoint"),
        (unsigned.into_bytes(), 400, "--witness KEY"),
        (early.replace("/one", "/six").into_bytes(), 400, "--witness KEY"),
        (vec![b'x'; 20_000], 413, "more than 16384 bytes"),
    ] {
        let answer = send(body).await;
        assert_eq!(answer.status.as_u16(), status, "{told}: {}", answer.text);
        assert!(
            answer.text.contains(told) && answer.text.contains("urn:plumbline:problem:"),
            "{told}: {}",
            answer.text
        );
    }
    let wrong = std::process::Command::new(crate::support::PROGRAM).args(["serve", "--witness", "x"]).output().unwrap();
    assert!(refused(&wrong).contains("name+id+key"));
}

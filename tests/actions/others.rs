//! What others compute: builds on a real server (`server/README.md`), vectors (`vec3/README.md`), and blocks and items
//! (`registry/README.md`) of npm packages.

use serde::Deserialize;
use serde_json::{Value, json};

use crate::support::{Service, repository};
use plumbline_engine::game::World;
use plumbline_engine::voxel::Cell;

#[derive(Debug, Deserialize)]
struct Build {
    name: String,
    #[serde(rename = "box")]
    bounds: [i32; 6],
    calls: Vec<Call>,
}

#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Call {
    Chat { text: String },
    Move { x: f64, y: f64, z: f64 },
}

#[derive(Debug, Deserialize)]
struct Standing {
    name: String,
    blocks: Vec<(i32, i32, i32, String)>,
}

fn read<T: for<'de> Deserialize<'de>>(path: &str) -> T {
    serde_json::from_slice(&std::fs::read(repository(path)).unwrap()).unwrap()
}

#[test]
fn builds_stand_as_on_a_real_server() {
    let builds: Vec<Build> = read("tests/actions/server/builds.json");
    let standing: Vec<Standing> = read("tests/actions/server/blocks.json");
    assert_eq!((builds.len(), standing.len()), (10, 10));
    for (Build { name, bounds, calls }, there) in builds.iter().zip(standing) {
        assert_eq!(*name, there.name);
        let mut world = World::default();
        for call in calls {
            match call {
                // The server sets the same block again without complaint.
                Call::Chat { text } => drop(world.command(text.trim_start_matches('/'))),
                Call::Move { x, y, z } => world.body.position = [*x, *y, *z],
            }
        }
        let [x1, y1, z1, x2, y2, z2] = *bounds;
        let mut ours = Vec::new();
        for y in y1..=y2 {
            for x in x1..=x2 {
                for z in z1..=z2 {
                    let look = world.look(Cell::new(x, y, z));
                    if !look.state.is_air() {
                        ours.push((x, y, z, look.state.block().name.to_owned()));
                    }
                }
            }
        }
        assert_eq!(ours, there.blocks, "{name}");
    }
}

#[tokio::test]
async fn vectors_are_those_of_the_package() {
    let table: Vec<(String, Option<String>)> = read("tests/actions/vec3/table.json");
    assert!(table.len() > 600);
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "2"]);
    // The log keeps 500 lines, so the values are one line.
    let expressions: Vec<&str> = table.iter().map(|(expression, _)| expression.as_str()).collect();
    for (part, rows) in expressions.chunks(100).zip(table.chunks(100)) {
        let code = format!(
            "const vec3 = require('vec3');\nconst values = [{}];\nfor (const value of values) console.log(JSON.stringify(value));",
            part.join(",\n")
        );
        let told =
            service.post_json("/v1/replay", &json!({ "profile": "mindcraft", "action_code": code })).await.json();
        assert_eq!(told["error"], Value::Null, "{told}");
        let log = told["turns"][0]["log"].as_array().unwrap();
        for ((expression, wanted), ours) in rows.iter().zip(log) {
            assert_eq!(ours.as_str().unwrap(), wanted.as_deref().unwrap_or("undefined"), "{expression}");
        }
        assert_eq!(log.len(), rows.len());
    }
}

/// What `minecraft-data` and `prismarine-block` say of blocks and items (`registry/README.md`).
#[derive(Debug, Deserialize)]
struct Registry {
    blocks: Vec<(Value, Vec<(u32, Value)>)>,
    items: Vec<Value>,
}

/// Runs code that prints one JSON value, and returns it.
async fn printed(service: &Service, code: &str) -> Value {
    let body = json!({ "profile": "mindcraft", "action_code": code });
    let told = service.post_json("/v1/replay", &body).await.json();
    assert_eq!(told["error"], Value::Null, "{told}");
    let log: Vec<&str> = told["turns"][0]["log"]
        .as_array()
        .unwrap_or_else(|| panic!("{told}"))
        .iter()
        .map(|line| line.as_str().unwrap())
        .collect();
    serde_json::from_str(&log.concat()).unwrap_or_else(|error| panic!("{error}: {told}"))
}

#[tokio::test]
async fn blocks_and_items_are_those_of_the_packages() {
    let registry: Registry = read("tests/actions/registry/table.json");
    assert_eq!((registry.blocks.len(), registry.items.len()), (1_095, 1_385));
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--workers", "2"]);
    // A log keeps some 60 kB, so lists come in parts.
    for (part, wanted) in registry.items.chunks(250).enumerate() {
        let code = format!(
            "const data = require('minecraft-data')('1.21.4');\n\
             console.log(JSON.stringify(data.itemsArray.slice({0}, {0} + 250).map((i) => [i.id, i.name, i.displayName, i.stackSize])));",
            250 * part
        );
        assert_eq!(printed(&service, &code).await.as_array().unwrap(), wanted);
    }
    for (part, wanted) in registry.blocks.chunks(100).enumerate() {
        let code = format!(
            "const data = require('minecraft-data')('1.21.4');\n\
             console.log(JSON.stringify(data.blocksArray.slice({0}, {0} + 100).map((b) => [b.id, b.name, b.displayName, b.hardness, \
             b.stackSize, b.diggable, b.transparent, b.boundingBox, b.minStateId, b.maxStateId, b.defaultState])));",
            100 * part
        );
        let found = printed(&service, &code).await;
        for (found, (wanted, _)) in found.as_array().unwrap().iter().zip(wanted) {
            let is_same = found.as_array().unwrap().iter().zip(wanted.as_array().unwrap()).all(|(a, b)| {
                // Hardness is 0.6 or 0.6000000000000001, as it was read.
                a == b || a.as_f64().zip(b.as_f64()).is_some_and(|(a, b)| (a - b).abs() < 1e-6)
            });
            assert!(is_same, "{found} instead of {wanted}");
        }
    }
    // States of blocks that stand, as `bot.blockAt` gives them.
    for part in registry.blocks.chunks(50) {
        let states: Vec<(&str, &(u32, Value))> = part
            .iter()
            .flat_map(|(block, states)| states.iter().map(|state| (block[1].as_str().unwrap(), state)))
            .collect();
        let names: Vec<String> = states
            .iter()
            .map(|(name, (_, properties))| {
                let of = |(name, value): (&String, &Value)| format!("{name}={}", value.to_string().trim_matches('"'));
                let properties: Vec<String> = properties.as_object().unwrap().iter().map(of).collect();
                format!("{name}[{}]", properties.join(","))
            })
            .collect();
        // In the air, where nothing beside it changes what was set.
        let code = format!(
            "const found = [];\nfor (const look of {}) {{\n  bot.chat(`/setblock 0 50 0 air`);\n  bot.chat(`/setblock 0 50 0 ${{look}}`);\n\
             const block = bot.blockAt(new Vec3(0, 50, 0));\n  found.push([block.stateId, block.getProperties()]);\n}}\n\
             console.log(JSON.stringify(found));",
            serde_json::to_string(&names).unwrap()
        );
        let found = printed(&service, &code).await;
        for ((found, (_, (state, wanted))), name) in found.as_array().unwrap().iter().zip(&states).zip(&names) {
            // The package gives numbers as texts.
            let number = |value: &Value| {
                value.as_str().and_then(|text| text.parse::<u32>().ok()).map_or(value.clone(), Value::from)
            };
            let wanted: serde_json::Map<String, Value> =
                wanted.as_object().unwrap().iter().map(|(property, value)| (property.clone(), number(value))).collect();
            assert_eq!(*found, json!([state, wanted]), "{name}");
        }
    }
}

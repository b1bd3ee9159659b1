//! What others compute: builds on a real server (`server/README.md`), and vectors of the npm package
//! (`vec3/README.md`).

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

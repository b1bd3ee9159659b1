//! Three demo agents of different skill, which post to the service over HTTP like any other client.

use anyhow::Context as _;
use serde_json::json;

use crate::client::{Answer, Service};
use plumbline_engine::builders::build;
use plumbline_engine::builders::saboteurs;
use plumbline_engine::builders::saboteurs::SABOTEURS;
use plumbline_engine::tasks::embedded;
use plumbline_engine::tasks::embedded::LITE_SEED;
use plumbline_engine::tasks::{Suite, Task};
use plumbline_engine::voxel::BlockLog;

/// Function that turns a good build into what an agent of this skill builds.
type Skill = fn(&Task, BlockLog) -> BlockLog;

/// Name on the board and skill of each demo agent.
const AGENTS: [(&str, Skill); 3] =
    [("demo: careful", careful), ("demo: hurried", hurried), ("demo: confused", confused)];

/// Posts the demo agents to the service at `base`, skipping agents that are already on the board.
pub async fn run(base: String, key: Option<String>) {
    match post_all(&base, key.as_deref()).await {
        Ok(()) => tracing::info!("the demo agents are on the board: {base}/"),
        Err(error) => tracing::error!(error = format!("{error:#}"), "the demo agents could not be posted"),
    }
}

async fn post_all(base: &str, key: Option<&str>) -> anyhow::Result<()> {
    let service = Service::at(base, key)?;
    let full = embedded::latest().map_err(|faults| anyhow::anyhow!("{faults:?}"))?;
    for suite in [embedded::lite(&full, LITE_SEED), full] {
        let board = service.get(&format!("/v1/leaderboards/{}", suite.id())).await?;
        let rows = board["rows"].as_array().context("the board has no rows")?;
        for (agent, make) in AGENTS {
            if !rows.iter().any(|row| row["agent"] == agent) {
                post(&service, &suite, agent, make).await.with_context(|| format!("{agent} in {}", suite.id()))?;
            }
        }
    }
    Ok(())
}

async fn post(service: &Service, suite: &Suite, agent: &str, make: Skill) -> anyhow::Result<()> {
    let answer = |task: &Task| build(task).ok().map(|log| Answer { number: task.number, log: make(task, log) });
    let answers: Vec<Answer> = suite.tasks.iter().filter_map(answer).collect();
    let run = service.create_run(agent, &suite.id(), json!({ "source": "plumbline serve --demo" })).await?;
    service.post_answers(&run, &answers, |_| {}).await?;
    service.finish_run(&run, false, |_| {}).await?;
    Ok(())
}

/// Builds as the reference builders do.
fn careful(_task: &Task, log: BlockLog) -> BlockLog {
    log
}

/// Walks to and fro on every second task, and forgets a corner on every fifth.
fn hurried(task: &Task, log: BlockLog) -> BlockLog {
    let log = if task.number.is_multiple_of(2) { spoiled("to-and-fro", log) } else { log };
    if task.number.is_multiple_of(5) { spoiled("drop-corner", log) } else { log }
}

/// Spoils two tasks out of three, using all saboteurs in turn.
fn confused(task: &Task, log: BlockLog) -> BlockLog {
    if task.number.is_multiple_of(3) {
        return log;
    }
    SABOTEURS[task.number as usize % SABOTEURS.len()].spoil(log)
}

fn spoiled(saboteur: &str, log: BlockLog) -> BlockLog {
    match saboteurs::find(saboteur) {
        Some(saboteur) => saboteur.spoil(log),
        None => log,
    }
}

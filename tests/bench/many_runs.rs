//! Fills a database that a service has made with finished runs, to see how boards bear them: `many_runs DATABASE SUITE
//! COUNT`.

use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::outcomes::Outcomes;
use plumbline_engine::grading::{ProblemScores, Summary};
use plumbline_engine::tasks::embedded;
use sqlx::ConnectOptions as _;
use sqlx::sqlite::SqliteConnectOptions;

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [database, suite_id, count] = arguments.as_slice() else {
        anyhow::bail!("expected a database, a suite (name@version) and a number of runs");
    };
    let suites = embedded::suites().map_err(|faults| anyhow::anyhow!("{faults:?}"))?;
    let suite = suites.iter().find(|suite| suite.id() == *suite_id);
    let Some(suite) = suite else { anyhow::bail!("there is no suite {suite_id:?}") };
    let mut random = rand_mt::Mt::new(1);
    let mut connection = SqliteConnectOptions::new().filename(database).connect().await?;
    sqlx::query("BEGIN IMMEDIATE").execute(&mut connection).await?;
    for number in 0..count.parse::<u32>()? {
        // A skill, and luck with each problem.
        let skill = random.next_u32();
        let problem = |task: &plumbline_engine::tasks::Task| {
            let score = f64::from(u8::from(random.next_u32() < skill));
            let rows = task.checks().map(|check| (check.criterion(), score)).collect::<Vec<(Criterion, f64)>>();
            ProblemScores { number: task.number, rows }
        };
        let problems: Vec<ProblemScores> = suite.tasks.iter().map(problem).collect();
        let (id, agent) = (format!("00000000-0000-7000-8000-{number:012}"), format!("agent {number}"));
        let summary = serde_json::to_string(&Summary::of(&problems))?;
        sqlx::query(
            "INSERT INTO runs (id, agent, suite_id, metadata, state, created_at_ms, finished_at_ms, summary, graded)
             VALUES ($1, $2, $3, '{}', 'finished', 0, $4, $5, 0)",
        )
        .bind(&id)
        .bind(agent)
        .bind(suite_id)
        .bind(i64::from(number))
        .bind(&summary)
        .execute(&mut connection)
        .await?;
        sqlx::query("INSERT INTO results (run_id, since_ms, summary, outcomes) VALUES ($1, $2, $3, $4)")
            .bind(&id)
            .bind(i64::from(number))
            .bind(&summary)
            .bind(Outcomes::of(&suite.tasks, &problems, &[]).to_bytes())
            .execute(&mut connection)
            .await?;
    }
    sqlx::query("COMMIT").execute(&mut connection).await?;
    Ok(())
}

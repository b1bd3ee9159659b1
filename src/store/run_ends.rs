//! Ends of runs: skipped tasks, summary and result, and the check whether anything is still pending.

use super::StoreResult;
use super::db::{Tx, query, query_as, query_scalar};
use super::events::{self, NewEvent};
use super::locks::Lock;
use super::results::enter_result;
use super::results::problems_of;
use super::run_rows::{RunRow, Skip, count, run_in};
use super::states::{RunState, SubmissionState};
use super::suites::tasks_of;
use plumbline_engine::grading::fingerprints::Fingerprint;
use plumbline_engine::grading::outcomes::Outcomes;
use plumbline_engine::grading::{ProblemScores, Summary};
use plumbline_engine::tasks::Task;

/// Records the tasks that a run skips. Returns the tasks that cannot be skipped because they were answered; if there
/// are any, nothing is recorded.
pub(super) async fn skip_tasks(tx: &mut Tx, run: &RunRow, skip: &Skip) -> StoreResult<Vec<u32>> {
    let given: Vec<(i64, SubmissionState)> = query_as(
        "SELECT task_number, state FROM submissions
         WHERE run_id = $1 AND superseded = FALSE AND state IN ('queued', 'grading', 'graded', 'grader_error')
         ORDER BY task_number",
    )
    .bind(&run.id)
    .fetch_all(&mut *tx)
    .await?;
    let state_of = |number: &u32| given.binary_search_by_key(&i64::from(*number), |(own, _)| *own).map(|i| given[i].1);
    let is_answered = |number: &u32| state_of(number).is_ok_and(|state| state != SubmissionState::GraderError);
    let numbers = match skip {
        Skip::Tasks(numbers) => numbers.clone(),
        Skip::Unanswered => {
            // A task whose grading failed was answered: only its owner can say, by naming it, that it is given up.
            let all = tasks_of(tx, &run.suite_id).await?;
            all.iter().map(|task| task.number).filter(|number| state_of(number).is_err()).collect()
        }
    };
    let conflicts: Vec<u32> = numbers.iter().copied().filter(is_answered).collect();
    if conflicts.is_empty() {
        for number in numbers {
            // A submission that failed because of us, and that the owner gives up, no longer keeps the run open.
            let failed = query(
                "UPDATE submissions SET superseded = TRUE
                 WHERE run_id = $1 AND task_number = $2 AND superseded = FALSE AND state = 'grader_error'",
            );
            let failed = failed.bind(&run.id).bind(number).execute(&mut *tx).await?;
            count(tx, &run.id, 0, 0, -(failed as i64)).await?;
            query("INSERT INTO skipped_tasks (run_id, task_number) VALUES ($1, $2) ON CONFLICT DO NOTHING")
                .bind(&run.id)
                .bind(number)
                .execute(&mut *tx)
                .await?;
        }
    }
    Ok(conflicts)
}

/// Returns whether the answer to each of these tasks of a run ended as a failure of ours.
pub(super) async fn all_have_failed(tx: &mut Tx, run: &str, tasks: &[u32]) -> StoreResult<bool> {
    let failed: Vec<i64> = query_scalar(
        "SELECT task_number FROM submissions WHERE run_id = $1 AND superseded = FALSE AND state = 'grader_error'",
    )
    .bind(run)
    .fetch_all(tx)
    .await?;
    Ok(tasks.iter().all(|task| failed.contains(&i64::from(*task))))
}

/// Returns the numbers of the tasks that a run skips.
async fn skipped_by(tx: &mut Tx, id: &str) -> StoreResult<Vec<u32>> {
    query_scalar("SELECT task_number FROM skipped_tasks WHERE run_id = $1").bind(id).fetch_all(tx).await
}

/// Ends the run if nothing is pending, with a summary over the tasks of its suite. Returns whether it ended.
pub(super) async fn end_if_complete(tx: &mut Tx, id: &str, suite_id: &str, now_ms: i64) -> StoreResult<bool> {
    let Some(run) = run_in(tx, id).await? else { return Ok(false) };
    let is_quiet = run.pending == 0 && run.grader_errors == 0;
    let is_complete = run.state == RunState::Finishing || run.graded >= run.tasks;
    if matches!(run.state, RunState::Finished | RunState::Deleted) || !is_quiet || !is_complete {
        return Ok(false);
    }
    let tasks = tasks_of(tx, suite_id).await?;
    set_result(tx, id, &tasks, now_ms).await?;
    let ended = NewEvent { run_id: Some(id), submission_id: None, state: RunState::Finished.name(), overall: None };
    events::enter(tx, &[ended], now_ms).await?;
    Ok(true)
}

/// Finishes a run with the result of its latest reports, or replaces the result of a finished run.
pub(super) async fn set_result(tx: &mut Tx, id: &str, tasks: &[Task], now_ms: i64) -> StoreResult<()> {
    // Before the reports are read, so that no regrade replaces them in between.
    tx.lock([Lock::Order]).await?;
    let problems = problems_of(tx, id).await?;
    let summary = serde_json::to_string(&summarise(&problems, tasks)).expect("a summary is JSON");
    query(
        "UPDATE runs SET state = 'finished', finished_at_ms = COALESCE(finished_at_ms, $2), summary = $3 WHERE id = $1",
    )
    .bind(id)
    .bind(now_ms)
    .bind(&summary)
    .execute(&mut *tx)
    .await?;
    let fingerprint = fingerprint_of(tx, id).await?;
    let outcomes = Outcomes::of(tasks, &problems, &skipped_by(tx, id).await?);
    enter_result(tx, id, &summary, &outcomes, &fingerprint, now_ms).await
}

/// Merges the fingerprints of a run's latest reports.
async fn fingerprint_of(tx: &mut Tx, id: &str) -> StoreResult<Fingerprint> {
    let parts: Vec<Vec<u8>> = query_scalar(
        "SELECT r.fingerprint FROM submissions s JOIN latest_reports r ON r.submission_id = s.id
         WHERE s.run_id = $1 AND s.state = 'graded' AND s.superseded = FALSE AND r.fingerprint IS NOT NULL",
    )
    .bind(id)
    .fetch_all(tx)
    .await?;
    let mut whole = Fingerprint::default();
    parts.iter().filter_map(|bytes| Fingerprint::from_bytes(bytes)).for_each(|part| whole.merge(&part));
    Ok(whole)
}

/// Summarizes the problems of a run; tasks without an answer count as failed.
pub(super) fn summarise(problems: &[ProblemScores], tasks: &[Task]) -> Summary {
    let answered: std::collections::HashSet<u32> = problems.iter().map(|problem| problem.number).collect();
    let unanswered: Vec<ProblemScores> = tasks
        .iter()
        .filter(|task| !answered.contains(&task.number))
        .map(|task| ProblemScores {
            number: task.number,
            rows: task.checks().map(|check| (check.criterion(), 0.0)).collect(),
        })
        .collect();
    Summary::with_unanswered(problems, &unanswered)
}

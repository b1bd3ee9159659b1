//! The page of a submission with its build, report and evidence; two submissions side by side; evidence as one file.

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use base64::Engine as _;
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::assets;
use super::claims;
use super::findings;
use super::html::{self, PageResult, Preview, json_in_markup};
use super::looks::{looks_of, palette};
use crate::actions::CodeError;
use crate::actions::turn_replay::TurnReplay;
use crate::app::error::AppError;
use crate::app::runs::read::answer;
use crate::app::submissions::read::{details, log, replays, status, stored};
use crate::app::submissions::stress::{StressedStructure, of_submission};
use crate::clock::rfc3339;
use crate::http::extract::caller::Reader;
use crate::http::extract::origin::Origin;
use crate::http::extract::params;
use crate::http::state::AppState;
use crate::http::submissions::stress::{StressFormat, write};
use crate::pictures::isometric;
use crate::store::reports::ReportRow;
use crate::store::states::SubmissionState;
use crate::store::submissions::SubmissionRow;
use plumbline_engine::builders::build;
use plumbline_engine::elasticity::field::Method;
use plumbline_engine::grading::Report;
use plumbline_engine::grading::report::{CheckReport, TurnReport};
use plumbline_engine::voxel::replay::Replay;
use plumbline_engine::voxel::{BlockLog, Structure};

/// A 3D view of a build.
pub struct View {
    /// Data of the 3D view, as JSON that is escaped for markup.
    pub scene: String,
    /// URL of a picture, for browsers without scripts or WebGL.
    pub picture: String,
    /// Description of the build.
    pub name: String,
    /// Name of the camera: views with the same name rotate together. Empty for a camera of its own.
    pub camera: &'static str,
    /// Whether the view offers to colour by stress.
    pub has_stress: bool,
    /// Whether failed checks have witness cells.
    pub has_witnesses: bool,
    /// Whether the scene names the log of a reference build.
    pub has_reference: bool,
}

/// A submission with everything that its page shows.
pub struct Shown {
    row: SubmissionRow,
    task: String,
    agent: Option<String>,
    report: Option<ReportRow>,
    replays: Vec<TurnReplay>,
    /// Prompts of the task, one for each turn.
    prompts: Vec<String>,
    created: String,
    graded: String,
    /// Number of submissions ahead of it while it is queued, and the estimated seconds until its grading begins.
    queued: Option<(i64, Option<f64>)>,
    view: View,
}

impl Shown {
    fn percent(score: f64) -> String {
        html::percent(Some(score))
    }

    /// Returns the checks of a turn that count and failed, or passed.
    fn failed(turn: &TurnReport) -> Vec<&CheckReport> {
        turn.checks.iter().filter(|check| !check.finding.holds()).collect()
    }

    fn passed(turn: &TurnReport) -> Vec<&CheckReport> {
        turn.checks.iter().filter(|check| check.finding.holds()).collect()
    }

    /// Returns the number of failed checks, and of all, among those that decide whether the build is a solution.
    fn counts(report: &Report) -> (usize, usize) {
        let deciding = || report.turns.iter().flat_map(|turn| &turn.checks).filter(|check| check.criterion.decides());
        (deciding().filter(|check| !check.finding.holds()).count(), deciding().count())
    }

    /// Returns the blocks that a check flags, as JSON.
    fn cells(check: &CheckReport) -> String {
        let cells: Vec<[i32; 3]> = check.finding.witnesses.iter().map(|w| w.cell.into()).collect();
        serde_json::to_string(&cells).expect("numbers are JSON")
    }

    /// Says what follows for a submission without a report.
    fn what_next(&self) -> String {
        if let Some((ahead, seconds)) = self.queued {
            let place = match ahead {
                0 => "It is next in the queue".to_owned(),
                ahead => format!("{} ahead of it in the queue", html::counted(ahead, "submission")),
            };
            let when = seconds.map(|s| format!("; grading begins in about {}", html::duration(s.ceil() as i64)));
            return format!("{place}{}. This page shows the verdict once it is graded.", when.unwrap_or_default());
        }
        self.meaning().to_owned()
    }

    /// Returns whether it is still to be graded.
    const fn is_under_way(&self) -> bool {
        matches!(self.row.state, SubmissionState::Queued | SubmissionState::Grading)
    }

    /// Says what the state means.
    const fn meaning(&self) -> &'static str {
        match self.row.state {
            SubmissionState::Queued => "It waits for its turn. This page shows the verdict once it is graded.",
            SubmissionState::Grading => "It is being graded. This page shows the verdict once it is.",
            SubmissionState::Graded => "Its report is being stored.",
            SubmissionState::Rejected => {
                "The log cannot be graded, for the reason below. Post a log without that fault."
            }
            SubmissionState::GraderError if self.row.superseded_by.is_some() => {
                "The service failed to grade it, which says nothing about the build."
            }
            SubmissionState::GraderError => {
                "The service failed to grade it, which says nothing about the build. Post the task again: its run stays open until then."
            }
            SubmissionState::Cancelled if self.row.superseded_by.is_some() => "It was cancelled before it was graded.",
            SubmissionState::Cancelled => {
                "It was cancelled before it was graded. The task may be posted again while its run is open."
            }
        }
    }

    /// Returns how long grading took.
    fn took(&self) -> String {
        let us = self.report.as_ref().map_or(0, |row| row.grading_us);
        if us < 10_000 { format!("{us} µs") } else { format!("{} ms", us / 1_000) }
    }

    /// Returns the errors of a turn's code, each with its place.
    fn errors(replay: &TurnReplay) -> Vec<String> {
        let told = |error: &CodeError| {
            let file = error.file.map(|file| format!("file {file}, ")).unwrap_or_default();
            let line = error.line.map(|line| format!("line {line}: ")).unwrap_or_default();
            format!("{file}{line}{}", error.message)
        };
        replay.error.iter().chain(&replay.more_errors).map(told).collect()
    }

    fn graded_report(&self) -> Option<&Report> {
        self.report.as_ref().map(|row| &row.report)
    }
}

#[derive(Template)]
#[template(path = "submission.html")]
struct SubmissionPage {
    one: Shown,
    preview: Preview,
}

#[derive(Template)]
#[template(path = "beside.html")]
struct BesidePage {
    two: [Shown; 2],
}

impl BesidePage {
    fn title(&self) -> String {
        let agent = |one: &Shown| one.agent.clone().unwrap_or_else(|| "no run".to_owned());
        let [one, other] = &self.two;
        if one.task == other.task {
            return format!("{}: {} and {}", one.task, agent(one), agent(other));
        }
        format!("{} by {} and {} by {}", one.task, agent(one), other.task, agent(other))
    }
}

#[derive(Template)]
#[template(path = "evidence.html")]
struct EvidencePage {
    one: Shown,
    style: &'static str,
    viewer: &'static str,
}

/// Collects the witness cells of the failed checks of a report, and tells whether a check has more than the report names.
fn witnesses(report: Option<&ReportRow>) -> (Vec<[i32; 3]>, bool) {
    let turns = report.into_iter().flat_map(|report| &report.report.turns);
    let failed = turns.flat_map(|turn| &turn.checks).map(|check| &check.finding).filter(|finding| !finding.holds());
    let is_cut = failed.clone().any(|finding| finding.witness_total > finding.witnesses.len() as u64);
    let cells = failed.flat_map(|finding| &finding.witnesses).map(|witness| witness.cell.into()).collect();
    (cells, is_cut)
}

/// Returns the 3D view of a submission; views with the same camera rotate together.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn view_of(state: &AppState, row: SubmissionRow, camera: &'static str) -> Result<View, AppError> {
    Ok(shown(state, row, camera).await?.view)
}

async fn shown(state: &AppState, row: SubmissionRow, camera: &'static str) -> Result<Shown, AppError> {
    let mut queued = None;
    if row.state == SubmissionState::Queued {
        let waits = status(state, &row.id).await?;
        queued = waits.queued_before.map(|ahead| (ahead, waits.estimated_seconds));
    }
    let details = details(state, row).await?;
    let id = &details.row.id;
    let (cells, is_cut) = witnesses(details.report.as_ref());
    let field = |method: &str| format!("/v1/submissions/{id}/stress?method={method}&format=arrays");
    let log = log(state, id).await?;
    let task = details.task().cloned();
    let read = tokio::task::spawn_blocking(move || {
        let has_reference = task.is_some_and(|task| build(&task).is_ok());
        palette(&log).map(|names| (names, has_reference))
    });
    let (names, has_reference) = read.await.map_err(|error| AppError::internal(&error))??;
    let scene = json!({
        "log": format!("/v1/submissions/{id}/log"),
        "looks": looks_of(names.iter().map(String::as_str)),
        "stress": { "sph": field("sph"), "fem": field("fem") },
        "witnesses": cells,
        "is_cut": is_cut,
        "reference": format!("/suites/{}/tasks/{}/reference.json", details.entry.id, details.row.task_number),
    });
    let task = details.task().map(|task| task.id.clone()).unwrap_or_default();
    let prompts = details.task().map(|task| task.turns.iter().map(|turn| turn.prompt.clone()).collect());
    Ok(Shown {
        view: View {
            scene: json_in_markup(&scene),
            picture: format!("/submissions/{id}/view.svg"),
            name: format!("Build for {task}"),
            camera,
            has_stress: details.has_stress(),
            has_witnesses: !cells.is_empty(),
            has_reference,
        },
        task,
        prompts: prompts.unwrap_or_default(),
        agent: details.agent,
        created: rfc3339(details.row.created_at_ms),
        graded: details.report.as_ref().map(|report| rfc3339(report.graded_at_ms)).unwrap_or_default(),
        report: details.report,
        replays: replays(details.row.replays.as_deref())?,
        queued,
        row: details.row,
    })
}

/// Serves the page of a submission.
///
/// # Errors
/// Returns a 404 error if the submission does not exist.
pub async fn submission(State(state): State<AppState>, origin: Origin, Path(id): Path<String>) -> PageResult {
    let row = stored(&state, &id).await?;
    let one = shown(&state, row, "").await?;
    let verdict = one.graded_report().map(|report| if report.overall { "solved" } else { "not solved" });
    let agent = one.agent.as_ref().map(|agent| format!(" by {agent}")).unwrap_or_default();
    let preview = Preview {
        origin,
        path: format!("/submissions/{id}"),
        title: format!("{}{agent}: {}", one.task, verdict.unwrap_or(one.row.state.name())),
        image: Some(format!("/submissions/{id}/preview.png")),
    };
    html::page(&SubmissionPage { one, preview })
}

/// The pair to show: two submissions, or the submissions of two runs for one task.
#[derive(Debug, Deserialize)]
pub struct Two {
    a: Option<String>,
    b: Option<String>,
    run_a: Option<String>,
    run_b: Option<String>,
    task: Option<u32>,
}

/// Serves the page of two submissions side by side.
///
/// # Errors
/// Returns a 400 error if the query does not name a pair and a 404 error if either submission does not exist.
pub async fn beside(State(state): State<AppState>, RawQuery(raw): RawQuery) -> PageResult {
    let two: Two = params::read(&html::set_fields(raw.as_deref()))?;
    let rows = match two {
        Two { a: Some(a), b: Some(b), .. } => [stored(&state, &a).await?, stored(&state, &b).await?],
        Two { run_a: Some(a), run_b: Some(b), task: Some(task), .. } => {
            [answer(&state, &a, task).await?, answer(&state, &b, task).await?]
        }
        _ => {
            let detail = "expected two submissions (a and b), or two runs and a task (run_a, run_b and task)";
            return Err(AppError::new(crate::app::error::Kind::BadRequest, detail).into());
        }
    };
    let [a, b] = rows;
    html::page(&BesidePage { two: [shown(&state, a, "both").await?, shown(&state, b, "both").await?] })
}

/// Serves a picture of the structure after the last turn.
///
/// # Errors
/// Returns a 404 error if the submission does not exist.
pub async fn picture(State(state): State<AppState>, Path(id): Path<String>) -> PageResult {
    let json = log(&state, &id).await?;
    let drawn = tokio::task::spawn_blocking(move || {
        BlockLog::from_canonical_json(&json).map(|log| Replay::new(&log).last().map(|end| picture_on_ground(&end)))
    });
    let drawn = drawn.await.map_err(|error| AppError::internal(&error))?;
    let svg = drawn.map_err(|error| AppError::internal(&error))?.unwrap_or_default();
    Ok(image(svg))
}

/// Builds the response for an SVG picture; its content security policy forbids loading anything.
pub fn image(svg: String) -> Response {
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("image/svg+xml")),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static("default-src 'none'")),
        (header::CACHE_CONTROL, HeaderValue::from_static("public, max-age=3600")),
    ];
    (headers, svg).into_response()
}

/// Draws a structure without its ground, as thumbnails show it.
#[must_use]
pub fn picture_of(structure: &Structure) -> String {
    drawn(structure, false)
}

/// Draws a structure on its ground, as the 3D view shows it.
#[must_use]
pub fn picture_on_ground(structure: &Structure) -> String {
    drawn(structure, true)
}

fn drawn(structure: &Structure, has_ground: bool) -> String {
    let blocks = (0..structure.len()).map(|i| (structure.cells()[i].into(), structure.material(i))).collect();
    let corner = isometric::Corner::default();
    isometric::svg(&isometric::Scene { blocks, dug: Vec::new(), most: isometric::MAX_BLOCKS, corner, has_ground })
}

/// Serves a submission's evidence as a download: one self-contained file.
///
/// # Errors
/// Returns a 404 error if the submission does not exist.
pub async fn evidence(State(state): State<AppState>, Reader(who): Reader, Path(id): Path<String>) -> PageResult {
    let row = stored(&state, &id).await?;
    let row_turns = row.turns;
    let mut one = shown(&state, row, "").await?;
    let log: Value = serde_json::from_slice(&log(&state, &id).await?).map_err(|error| AppError::internal(&error))?;
    let mut stress = json!({});
    if one.view.has_stress {
        let turn = usize::try_from(row_turns).expect("a log has at most 64 turns");
        // If the field cannot be computed, the file is still complete: it contains the report's figures.
        if let Ok(StressedStructure { structure, field }) =
            of_submission(&state, &who, &one.row, turn, Method::Fem).await
        {
            let submission = id.clone();
            let writing = tokio::task::spawn_blocking(move || {
                let written = write(&submission, &structure, &field, Method::Fem, turn, StressFormat::Arrays)?;
                serde_json::from_str::<Value>(&written)
            });
            let written = writing.await.map_err(|error| AppError::internal(&error))?;
            stress = json!({ "fem": written.map_err(|error| AppError::internal(&error))? });
        }
    }
    let (cells, is_cut) = witnesses(one.report.as_ref());
    let names = palette(log.to_string().as_bytes())?;
    let looks = looks_of(names.iter().map(String::as_str));
    let scene = json!({ "log": log, "looks": looks, "stress": stress, "witnesses": cells, "is_cut": is_cut });
    one.view.has_reference = false;
    one.view.scene = json_in_markup(&scene);
    "data:,".clone_into(&mut one.view.picture);
    let text = EvidencePage { one, style: assets::STYLE, viewer: assets::VIEWER }
        .render()
        .map_err(|error| AppError::internal(&error))?;
    let hash = |text: &str| base64::engine::general_purpose::STANDARD.encode(Sha256::digest(text));
    let policy = format!(
        "default-src 'none'; script-src 'sha256-{}'; style-src 'sha256-{}'; img-src data:; base-uri 'none'; form-action 'none'",
        hash(assets::VIEWER),
        hash(assets::STYLE)
    );
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8")),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_str(&policy).map_err(|error| AppError::internal(&error))?),
        (
            header::CONTENT_DISPOSITION,
            HeaderValue::from_str(&format!("attachment; filename=\"evidence-{id}.html\""))
                .map_err(|error| AppError::internal(&error))?,
        ),
    ];
    Ok((headers, text).into_response())
}

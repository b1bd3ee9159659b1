//! The API: one file per resource. Routes and the OpenAPI document come from one list.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod adapters;
pub mod answer_body;
pub mod board_actions;
pub mod board_formats;
pub mod comparisons;
pub mod documents;
pub mod draws;
pub mod entries;
pub mod epoch_boards;
pub mod epochs;
pub mod events;
pub mod grade;
pub mod grade_answer;
pub mod grade_batch;
pub mod grade_body;
pub mod grade_request;
pub mod health;
pub mod instances;
pub mod leaderboards;
pub mod limits;
pub mod log_member;
pub mod quota;
pub mod receipts;
pub mod replay;
pub mod reports;
pub mod run_body;
pub mod run_changes;
pub mod runs;
pub mod stress;
pub mod submission;
pub mod submission_body;
pub mod submission_schema;
pub mod submissions;
pub mod suites;
pub mod tasks;

use axum::Router;
use axum::http::{HeaderValue, header};
use tower_http::set_header::SetResponseHeaderLayer;
use utoipa::OpenApi;
use utoipa::openapi::path::Parameter;
use utoipa::openapi::schema::{SchemaType, Type};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Content, Ref, RefOr, ResponseBuilder, Schema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use utoipa_swagger_ui::{Config, SwaggerUi};

use super::caller::PROBES;
use super::problem::PROBLEM_JSON;
use super::state::AppState;

/// Head of the OpenAPI document.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "plumbline",
        description = "Grades what AI agents build as construction engineers in Minecraft (the MineCEraft benchmark).\n\n\
                       Post a run, post a block log for each of its tasks, read the reports and the leaderboard. Every \
                       error is an RFC 9457 problem. Every limit is at `/v1/limits`.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    servers((url = "/", description = "This service")),
    tags(
        (name = "runs", description = "One agent's attempt at a suite."),
        (name = "submissions", description = "What an agent did for one task, and its report."),
        (name = "rewards", description = "Grading within the request, for trainers. Nothing is stored."),
        (name = "tasks", description = "Suites and their tasks."),
        (name = "leaderboards", description = "Finished runs, compared."),
        (name = "hidden evaluation", description = "Epochs: committed to, drawn fresh, answered once, revealed."),
        (name = "receipts", description = "Signed grades in a public log."),
        (name = "service", description = "Limits, health, metrics, and this document."),
    )
)]
struct Head;

/// All routes of the API, with their part of the document.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::with_openapi(Head::openapi())
        .routes(routes!(runs::create_run))
        .routes(routes!(runs::list_runs))
        .routes(routes!(runs::get_run))
        .routes(routes!(run_changes::delete_run))
        .routes(routes!(run_changes::finish_run))
        .routes(routes!(runs::list_run_submissions))
        .routes(routes!(submissions::create_submission))
        .routes(routes!(submissions::validate_submission))
        .routes(routes!(replay::replay_action_code))
        .routes(routes!(submission::get_submission))
        .routes(routes!(submission::cancel_submission))
        .routes(routes!(reports::get_report))
        .routes(routes!(reports::get_log))
        .routes(routes!(stress::get_stress))
        .routes(routes!(grade::grade))
        .routes(routes!(grade_batch::grade_batch))
        .routes(routes!(adapters::nemo_gym::seed_session))
        .routes(routes!(adapters::nemo_gym::verify))
        .routes(routes!(adapters::nemo_gym::reverify_mode))
        .routes(routes!(adapters::nemo_gym::close_session))
        .routes(routes!(adapters::nemo_metrics::aggregate_metrics))
        .routes(routes!(adapters::openrlhf::get_reward))
        .routes(routes!(tasks::list_tasks))
        .routes(routes!(tasks::get_task))
        .routes(routes!(suites::list_suites))
        .routes(routes!(suites::get_suite))
        .routes(routes!(leaderboards::get_leaderboard))
        .routes(routes!(comparisons::get_breakdown))
        .routes(routes!(comparisons::get_comparison))
        .routes(routes!(board_actions::list_board_actions))
        .routes(routes!(board_actions::create_board_action))
        .routes(routes!(board_actions::get_board_feed))
        .routes(routes!(epochs::list_epochs))
        .routes(routes!(epochs::get_epoch))
        .routes(routes!(epochs::get_epoch_reveal))
        .routes(routes!(epochs::get_epoch_answers))
        .routes(routes!(epoch_boards::get_epoch_leaderboard))
        .routes(routes!(entries::create_entry))
        .routes(routes!(entries::get_entry))
        .routes(routes!(draws::create_instances))
        .routes(routes!(entries::finalize_entry))
        .routes(routes!(instances::get_instance))
        .routes(routes!(instances::answer_instance))
        .routes(routes!(instances::check_transcript))
        .routes(routes!(instances::get_instance_report))
        .routes(routes!(instances::get_instance_receipt))
        .routes(routes!(receipts::list_receipts))
        .routes(routes!(receipts::get_receipt))
        .routes(routes!(receipts::get_receipt_keys))
        .routes(routes!(events::get_events))
        .routes(routes!(quota::get_quota))
        .routes(routes!(limits::get_limits))
        .routes(routes!(health::get_health))
        .routes(routes!(health::get_readiness))
        .routes(routes!(documents::get_metrics))
        .routes(routes!(documents::get_openapi))
}

/// The routes of trainers where they look for them: below a path of the framework's own, and below a key for clients that can send
/// no header. What they answer is the same.
pub fn trainers_elsewhere() -> Router<AppState> {
    use axum::routing::{get, post};
    let gym = || {
        Router::new()
            .route("/verify", post(adapters::nemo_gym::verify))
            .route("/seed_session", post(adapters::nemo_gym::seed_session))
            .route("/close_session", post(adapters::nemo_gym::close_session))
            .route("/reverify_mode", get(adapters::nemo_gym::reverify_mode))
            .route("/aggregate_metrics", post(adapters::nemo_metrics::aggregate_metrics))
    };
    let all = gym()
        .route("/get_reward", post(adapters::openrlhf::get_reward))
        .route("/v1/grade", post(grade::grade))
        .route("/v1/grade:batch", post(grade_batch::grade_batch));
    Router::new().nest("/ng-rollout/{rollout}", gym()).nest("/with-key/{key}", all)
}

/// Adds what holds for every operation that writes: it needs a key, and is refused without one.
pub fn complete(document: &mut utoipa::openapi::OpenApi) {
    let bearer = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(
        "A key made by `plumbline keys create`. Reading needs none; a service started with `--open` asks for none.",
    ));
    let components = document.components.get_or_insert_default();
    components.add_security_scheme("key", SecurityScheme::Http(bearer.build()));
    let problem = |description: &str| {
        let content = Content::new(Some(Ref::from_schema_name("Problem")));
        ResponseBuilder::new().description(description).content(PROBLEM_JSON, content).build()
    };
    for (path, item) in &mut document.paths.paths {
        for operation in [&mut item.get, &mut item.post, &mut item.delete].into_iter().flatten() {
            // Probes are never refused for being asked too often.
            if !PROBES.contains(&path.as_str()) {
                let refused = problem("Too many requests from this key or address; come back").into();
                operation.responses.responses.entry("429".to_owned()).or_insert(refused);
            }
            operation.security.get_or_insert_default();
            for parameter in operation.parameters.iter_mut().flatten() {
                never_null(parameter);
            }
        }
    }
    let writing = document.paths.paths.values_mut().flat_map(|item| [&mut item.post, &mut item.delete]);
    for operation in writing.flatten() {
        operation.security = Some(vec![SecurityRequirement::new("key", [""; 0])]);
        for (status, what) in [("401", "No key, or none that is live"), ("403", "The key does not allow this")] {
            operation.responses.responses.insert(status.to_owned(), problem(what).into());
        }
    }
}

/// A header or a parameter is there or not; it cannot be null.
fn never_null(parameter: &mut RefOr<Parameter>) {
    let RefOr::T(parameter) = parameter else { return };
    let Some(RefOr::T(Schema::Object(schema))) = &mut parameter.schema else { return };
    if let SchemaType::Array(types) = &mut schema.schema_type {
        types.retain(|own| *own != Type::Null);
        if let [only] = types.as_slice() {
            schema.schema_type = SchemaType::Type(only.clone());
        }
    }
}

/// The OpenAPI document, as committed in `openapi/`.
#[must_use]
pub fn document() -> String {
    let mut document = routes().into_openapi();
    complete(&mut document);
    let mut text = document.to_pretty_json().unwrap_or_default();
    text.push('\n');
    text
}

/// The interactive reference at `/docs`; its files are in the binary.
pub fn reference() -> Router {
    // Its scripts are files of its own; styles it also sets by script.
    const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; font-src 'self'; \
                          connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'";
    let pages: Router = SwaggerUi::new("/docs").config(Config::new(["/openapi.json"]).try_it_out_enabled(true)).into();
    let policy = HeaderValue::from_static(POLICY);
    pages.layer(SetResponseHeaderLayer::if_not_present(header::CONTENT_SECURITY_POLICY, policy))
}

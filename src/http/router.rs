//! Routes: a single list defines both the router and the OpenAPI document.

use axum::Router;
use utoipa::OpenApi;
use utoipa::openapi::path::{Operation, Parameter, ParameterIn};
use utoipa::openapi::schema::{SchemaType, Type};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Content, Ref, RefOr, ResponseBuilder, Schema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::caller::PROBES;
use super::problem::{PROBLEM_JSON, Problem};
use super::state::AppState;
use super::{accounts, boards, bounds, catalogue, episodes, hidden, rewards, runs, service, submissions};

/// Metadata of the OpenAPI document: title, license, servers and tags.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "plumbline",
        description = "Grades what AI agents build as construction engineers in Minecraft (the MineCEraft benchmark).\n\n\
                       Create a run, post a block log for each of its tasks, and read the reports and the leaderboard. \
                       Every error is an RFC 9457 problem. `/v1/limits` lists every limit.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    servers((url = "/", description = "This service")),
    components(schemas(Problem, rewards::batch::BatchItem, crate::app::accounts::events::EventBody)),
    tags(
        (name = "runs", description = "One agent's attempt at a suite."),
        (name = "submissions", description = "An agent's work on one task, and its report."),
        (name = "episodes", description = "An attempt at a task, turn by turn, in a world that the service keeps."),
        (name = "rewards", description = "Synchronous grading for trainers. Nothing is stored."),
        (name = "tasks", description = "Suites and their tasks."),
        (name = "leaderboards", description = "Comparison of finished runs."),
        (name = "hidden evaluation", description = "Epochs: committed to, freshly drawn, answered once, revealed."),
        (name = "receipts", description = "Signed grades in a public log."),
        (name = "webhooks", description = "Events of an owner, posted to its own addresses and signed."),
        (name = "service", description = "Limits, health, metrics, and this document."),
    )
)]
struct Head;

/// Returns all routes of the API, each with its part of the OpenAPI document.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::with_openapi(Head::openapi())
        .routes(routes!(runs::resource::create_run))
        .routes(routes!(runs::resource::list_runs))
        .routes(routes!(runs::cards::put_run_card, runs::cards::get_run_card))
        .routes(routes!(runs::resource::get_run))
        .routes(routes!(runs::changes::delete_run))
        .routes(routes!(runs::changes::finish_run))
        .routes(routes!(runs::publicity::withdraw_run))
        .routes(routes!(runs::publicity::lift_embargo))
        .routes(routes!(runs::resource::list_run_submissions))
        .routes(routes!(submissions::create::create_submission))
        .routes(routes!(submissions::create::validate_submission))
        .routes(routes!(submissions::replay::replay_action_code))
        .routes(routes!(submissions::resource::get_submission))
        .routes(routes!(submissions::resource::cancel_submission))
        .routes(routes!(submissions::reports::get_report))
        .routes(routes!(submissions::reports::get_log))
        .routes(routes!(submissions::structure::get_structure))
        .routes(routes!(submissions::stress::get_stress))
        .routes(routes!(episodes::resource::open_episode))
        .routes(routes!(episodes::resource::get_episode))
        .routes(routes!(episodes::steps::step_episode))
        .routes(routes!(episodes::steps::next_turn))
        .routes(routes!(episodes::views::view_episode))
        .routes(routes!(episodes::views::picture_episode))
        .routes(routes!(episodes::resource::submit_episode))
        .routes(routes!(rewards::single::grade))
        .routes(routes!(rewards::structure::grade_structure))
        .routes(routes!(rewards::batch::grade_batch))
        .routes(routes!(rewards::adapters::nemo_gym::seed_session))
        .routes(routes!(rewards::adapters::nemo_gym::verify))
        .routes(routes!(rewards::adapters::nemo_gym::reverify_mode))
        .routes(routes!(rewards::adapters::nemo_gym::close_session))
        .routes(routes!(rewards::adapters::nemo_metrics::aggregate_metrics))
        .routes(routes!(rewards::adapters::openrlhf::get_reward))
        .routes(routes!(catalogue::tasks::list_tasks))
        .routes(routes!(catalogue::tasks::get_task))
        .routes(routes!(catalogue::suites::list_suites))
        .routes(routes!(catalogue::suites::get_suite))
        .routes(routes!(boards::leaderboard::get_leaderboard))
        .routes(routes!(boards::repeats::get_repeats))
        .routes(routes!(boards::comparisons::get_breakdown))
        .routes(routes!(boards::comparisons::get_comparison))
        .routes(routes!(boards::actions::list_board_actions))
        .routes(routes!(boards::actions::create_board_action))
        .routes(routes!(boards::actions::get_board_feed))
        .routes(routes!(hidden::epochs::list_epochs))
        .routes(routes!(hidden::epochs::get_epoch))
        .routes(routes!(hidden::epochs::create_epoch_pool))
        .routes(routes!(hidden::epochs::get_epoch_reveal))
        .routes(routes!(hidden::epochs::get_epoch_answers))
        .routes(routes!(hidden::boards::get_epoch_leaderboard))
        .routes(routes!(hidden::siblings::list_siblings))
        .routes(routes!(hidden::entries::create_entry))
        .routes(routes!(hidden::entries::get_entry))
        .routes(routes!(hidden::draws::create_instances))
        .routes(routes!(hidden::entries::finalize_entry))
        .routes(routes!(runs::cards::put_entry_card, runs::cards::get_entry_card))
        .routes(routes!(hidden::instances::get_instance))
        .routes(routes!(hidden::instances::answer_instance))
        .routes(routes!(hidden::instances::check_transcript))
        .routes(routes!(hidden::instances::get_instance_report))
        .routes(routes!(hidden::instances::get_instance_receipt))
        .routes(routes!(hidden::receipts::list_receipts))
        .routes(routes!(hidden::receipts::get_receipt))
        .routes(routes!(hidden::receipts::get_receipt_keys))
        .routes(routes!(accounts::events::get_events))
        .routes(routes!(accounts::quota::get_quota))
        .routes(routes!(accounts::webhooks::create_webhook, accounts::webhooks::list_webhooks))
        .routes(routes!(
            accounts::webhooks::get_webhook,
            accounts::webhooks::put_webhook,
            accounts::webhooks::delete_webhook
        ))
        .routes(routes!(accounts::webhooks::change_webhook_secret))
        .routes(routes!(accounts::deliveries::list_deliveries))
        .routes(routes!(accounts::deliveries::test_webhook))
        .routes(routes!(accounts::deliveries::retry_delivery))
        .routes(routes!(accounts::team::get_team))
        .routes(routes!(accounts::team::put_member))
        .routes(routes!(accounts::team::remove_member))
        .routes(routes!(accounts::team::create_member_key))
        .routes(routes!(accounts::team::revoke_team_key))
        .routes(routes!(service::limits::get_limits))
        .routes(routes!(service::profiles::list_profiles))
        .routes(routes!(service::blocks::list_blocks))
        .routes(routes!(service::agent_guide::get_agent_guide))
        .routes(routes!(service::health::get_health))
        .routes(routes!(service::health::get_readiness))
        .routes(routes!(service::documents::get_metrics))
        .routes(routes!(service::documents::get_openapi))
}

/// Returns the trainers' routes under further prefixes: `/ng-rollout/{rollout}`, where NeMo Gym requests them, and
/// `/with-key/{key}`, for clients that cannot send headers. Their responses are the same.
pub fn trainers_elsewhere() -> Router<AppState> {
    use axum::routing::{get, post};
    let gym = || {
        Router::new()
            .route("/verify", post(rewards::adapters::nemo_gym::verify))
            .route("/seed_session", post(rewards::adapters::nemo_gym::seed_session))
            .route("/close_session", post(rewards::adapters::nemo_gym::close_session))
            .route("/reverify_mode", get(rewards::adapters::nemo_gym::reverify_mode))
            .route("/aggregate_metrics", post(rewards::adapters::nemo_metrics::aggregate_metrics))
    };
    let all = gym()
        .route("/get_reward", post(rewards::adapters::openrlhf::get_reward))
        .route("/v1/grade", post(rewards::single::grade))
        .route("/v1/grade:structure", post(rewards::structure::grade_structure))
        .route("/v1/grade:batch", post(rewards::batch::grade_batch));
    Router::new().nest("/ng-rollout/{rollout}", gym()).nest("/with-key/{key}", all)
}

/// Completes the document with everything that holds for operations of a kind: the errors that they may answer with,
/// and the key that writing needs. Sets the bounds that are limits of the service.
///
/// An operation declares only the errors that are its own, without a body: every error is a problem.
pub fn complete(document: &mut utoipa::openapi::OpenApi) {
    let bearer = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(
        "A key made by `plumbline keys create`. Reading needs none; a service started with `--open` asks for none.",
    ));
    let components = document.components.get_or_insert_default();
    bounds::set_in_bodies(components);
    components.add_security_scheme("key", SecurityScheme::Http(bearer.build()));
    for (path, item) in &mut document.paths.paths {
        for (operation, writes) in
            [(&mut item.get, false), (&mut item.post, true), (&mut item.put, true), (&mut item.delete, true)]
        {
            let Some(operation) = operation else { continue };
            // A round of a beacon proves itself.
            let needs_key = writes && operation.operation_id.as_deref() != Some("create_epoch_pool");
            for parameter in operation.parameters.iter_mut().flatten() {
                never_null(parameter);
                bounds::set_in_parameter(parameter);
            }
            if needs_key {
                operation.security = Some(vec![SecurityRequirement::new("key", [""; 0])]);
            } else {
                operation.security.get_or_insert_default();
            }
            add_errors(path, operation, needs_key);
        }
    }
}

/// Adds the errors that follow from what an operation takes, and the form that all errors have.
fn add_errors(path: &str, operation: &mut Operation, needs_key: bool) {
    const BODY: &[(&str, &str)] = &[
        ("400", "The body is not JSON"),
        ("408", "The body came too slowly"),
        ("413", "The body is too large"),
        ("415", "The media type or the encoding of the body is not supported"),
        ("422", "The body has faults; all of them are listed"),
        ("503", "Busy; send the request again"),
    ];
    const INFALLIBLE: [&str; 3] = ["/healthz", "/v1/limits", "/openapi.json"];
    const KEY: &[(&str, &str)] = &[("401", "No key, or none that is live"), ("403", "The key does not allow this")];
    let has = |place: ParameterIn| {
        let mut all = operation.parameters.iter().flatten();
        all.any(|parameter| matches!(parameter, RefOr::T(parameter) if parameter.parameter_in == place))
    };
    let mut errors: Vec<(&str, &str)> = Vec::new();
    errors.extend(operation.request_body.iter().flat_map(|_| BODY));
    errors.extend(needs_key.then_some(KEY).into_iter().flatten());
    let is_checked = has(ParameterIn::Query) || path.starts_with("/v1/");
    errors.extend(is_checked.then_some(("400", "A parameter is wrong")));
    errors.extend(has(ParameterIn::Path).then_some(("404", "There is nothing of this name")));
    // Probes are never refused for being asked too often.
    errors.extend((!PROBES.contains(&path)).then_some(("429", "Too many requests; send it again later")));
    errors.extend((!INFALLIBLE.contains(&path)).then_some(("500", "A failure of the service; send the request again")));
    for (status, description) in errors {
        let response = ResponseBuilder::new().description(description).build();
        operation.responses.responses.entry(status.to_owned()).or_insert(response.into());
    }
    for (status, response) in &mut operation.responses.responses {
        if let (true, RefOr::T(response)) = (status.starts_with(['4', '5']), response) {
            let problem = Content::new(Some(Ref::from_schema_name("Problem")));
            response.content.entry(PROBLEM_JSON.to_owned()).or_insert(problem.into());
        }
    }
}

/// Removes null from the types of a parameter: a header or parameter is present or absent, but never null.
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

/// Returns the OpenAPI document as formatted JSON, as committed in `openapi/`.
#[must_use]
pub fn document() -> String {
    let mut document = routes().into_openapi();
    complete(&mut document);
    let mut text = document.to_pretty_json().expect("the document is JSON");
    text.push('\n');
    text
}

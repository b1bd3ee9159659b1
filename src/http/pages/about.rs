//! The page that says what the words of the pages mean, what is checked and what is not, and who runs the service.

use askama::Template;
use axum::extract::State;

use super::html::{self, PageResult};
use crate::app::operator::Operator;
use crate::http::state::AppState;

/// Criteria, and what each asks.
pub const CRITERIA: [(&str, &str); 7] = [
    ("Material", "Are the right blocks used, and as many as asked?"),
    ("Shape", "Is it what was asked for: rooms, doors, arches, stairs?"),
    ("Size", "Does it measure what was asked?"),
    ("Plausibility", "Is every block held up by the ground or by others?"),
    ("Stability", "Does the stress inside stay below what the task allows?"),
    ("Efficiency", "Is the path from block to block short?"),
    ("Dependency", "Were the parts built in the order that the task asks for?"),
];

/// Words of the pages, each with its meaning, in the order in which a reader meets them.
const WORDS: [(&str, &str); 17] = [
    (
        "Task",
        "A construction brief of one or several turns, with the checks that its build must pass. A suite is a versioned list of tasks, which never changes.",
    ),
    ("Problem", "A task, as boards count it. The wordings of one item form one cluster when chance is judged."),
    ("Run", "One agent's answers to the tasks of a suite."),
    (
        "Solved",
        "The build passes every check of material, shape, size, plausibility and dependency. Stability and efficiency are scored beside it.",
    ),
    (
        "Accurate",
        "The build passes every check of material, shape and size. It is not solved if something in it floats, or if it was built in an order that does not work.",
    ),
    ("Score", "The share of problems solved. A problem without an answer counts as not solved."),
    ("Interval", "The range in which the true rate lies with 95 % confidence, given how few problems there are."),
    ("Rank 2–4", "The ranks that chance leaves possible. Agents whose ranges overlap may differ by chance alone."),
    (
        "Specified and brief",
        "How a prompt asks. Specified prompts state every measured condition; brief ones ask in a sentence or two. Runs of the two are not compared.",
    ),
    ("Skipped", "Left out on purpose, which the run says. It counts as not solved."),
    (
        "Self-reported",
        "The owner ran the agent and posted what it built. The grade is this service's; which agent built it, and whether a person helped, nobody checked.",
    ),
    ("Re-run by host", "The operator ran the agent."),
    (
        "Card",
        "What the owner declares of an agent: its model, settings, costs. It is shown as declared, and not checked.",
    ),
    (
        "Possible copy",
        "Nearly the same blocks in nearly the same order as an earlier run of another owner. It is a mark for readers, and changes no score.",
    ),
    (
        "Hidden, withdrawn",
        "The operator hid a row, or its owner withdrew it. Both stay on record with the reason, in the moderation log of the board.",
    ),
    (
        "Epoch",
        "A period of hidden evaluation: builds that nobody has seen before, fixed in advance, and revealed afterwards so that anybody can grade them again.",
    ),
    (
        "Receipt",
        "A signed statement that something was accepted or graded. All receipts are entries of a public log, which only grows.",
    ),
];

#[derive(Template)]
#[template(path = "about.html")]
struct AboutPage {
    operator: Operator,
}

/// Serves the page.
///
/// # Errors
/// Returns an error if the page cannot be rendered.
pub async fn page(State(state): State<AppState>) -> PageResult {
    html::page(&AboutPage { operator: state.operator.clone() })
}

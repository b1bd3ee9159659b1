//! Tasks as the data sets of trainers: a row for each task of one turn, in the shape that a framework reads.

use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::actions::Profile;
use crate::app::guide::Guide;
use plumbline_engine::tasks::{Suite, Task, Track};

/// Format of a list of tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TaskFormat {
    /// A page of tasks.
    #[default]
    Json,
    /// Rows of TRL: `prompt` as messages, and a column for each member of a label.
    Trl,
    /// Rows of verl, with the label as ground truth.
    Verl,
    /// Rows of OpenRLHF: `input` as messages, and `label`.
    Openrlhf,
    /// Rows of NeMo Gym, with the label in `verifier_metadata`.
    NemoGym,
    /// Rows for lm-eval's harness: `prompt` as one text.
    LmEval,
}

/// Scheme of the rewards that a data set asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RowScheme {
    /// 1 if the problem passes, else 0.
    Strict,
    /// Gain over a log that does nothing.
    #[default]
    Shaped,
    /// Mean of the criteria that apply.
    Mean,
}

impl RowScheme {
    const fn name(self) -> &'static str {
        match self {
            Self::Strict => "strict",
            Self::Shaped => "shaped",
            Self::Mean => "mean",
        }
    }
}

/// Data set of a suite's tasks.
#[derive(Debug, Clone, Copy)]
pub struct DataSet {
    /// Format of its rows.
    pub format: TaskFormat,
    /// Track of its prompts.
    pub track: Track,
    /// Rules under which answers become builds.
    pub profile: Profile,
    /// Scheme of the rewards.
    pub scheme: RowScheme,
}

impl DataSet {
    /// Returns whether its rewards are shaped. Then it has only tasks for which a log can earn more than by doing nothing.
    pub fn is_shaped(self) -> bool {
        self.scheme == RowScheme::Shaped
    }

    /// Returns the rows of tasks, a line each. Tasks of several turns are left out: these frameworks ask once.
    pub fn rows<'t>(self, suite: &Suite, tasks: impl Iterator<Item = &'t Task>) -> Response {
        let mut system = Guide::of(self.profile).markdown();
        if self.track == Track::Brief
            && let Some(preamble) = &suite.preamble
        {
            system.push('\n');
            system.push_str(preamble);
        }
        let mut lines = String::new();
        for task in tasks {
            let [turn] = task.turns.as_slice() else { continue };
            let Some(prompt) = turn.prompt_on(self.track) else { continue };
            lines.push_str(&self.row(suite, task, &system, prompt).to_string());
            lines.push('\n');
        }
        ([(header::CONTENT_TYPE, "application/x-ndjson")], lines).into_response()
    }

    fn row(self, suite: &Suite, task: &Task, system: &str, prompt: &str) -> Value {
        let messages = json!([{ "role": "system", "content": system }, { "role": "user", "content": prompt }]);
        let (suite, profile, scheme) = (suite.id(), self.profile, self.scheme.name());
        let label = json!({ "task": task.id, "suite": suite, "profile": profile, "reward": scheme });
        match self.format {
            TaskFormat::Json | TaskFormat::Trl => {
                json!({ "prompt": messages, "task": task.id, "suite": suite, "profile": profile, "scheme": scheme })
            }
            TaskFormat::Verl => json!({
                "data_source": format!("plumbline/{suite}"), "prompt": messages, "ability": "building",
                "reward_model": { "style": "rule", "ground_truth": label.to_string() },
                "extra_info": { "split": "train", "index": task.number, "task": task.id },
            }),
            TaskFormat::Openrlhf => json!({ "input": messages, "label": label.to_string() }),
            TaskFormat::NemoGym => json!({
                "responses_create_params": { "input": messages },
                "verifier_metadata": { "task": task.id, "suite": suite, "profile": profile, "reward_scheme": scheme },
            }),
            TaskFormat::LmEval => json!({
                "prompt": format!("{system}\n{prompt}"), "task": task.id, "suite": suite, "profile": profile,
                "reward": scheme, "family": task.family(),
            }),
        }
    }
}

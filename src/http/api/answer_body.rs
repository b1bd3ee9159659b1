//! Reading the answer to a hidden instance, with all faults at once.

use serde::de::{IgnoredAny, MapAccess};

use super::super::limits::LIMITS;
use super::submission_body::{PostedSubmission, TaskRef};
use super::submission_schema::NewTurn;
use crate::epochs::canonical::unhex;
use crate::voxel::Faults;
use crate::voxel::log_reader::Turns;
use crate::voxel::tolerant::{OrNull, Read, Shape, Text};

/// The answer to a hidden instance.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[schema(example = json!({ "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }],
                           "transcript_sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08" }))]
#[expect(dead_code, reason = "describes the body that AnswerShape reads")]
pub struct NewAnswerBody {
    /// What was done in each turn, in any of the forms of a submission's.
    turns: Vec<NewTurn>,
    /// SHA-256 of the agent's transcript, to be shown on request.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    transcript_sha256: Option<String>,
}

/// An answer as posted.
#[derive(Debug)]
pub struct PostedAnswer {
    /// The log, as a submission to no suite.
    pub submission: PostedSubmission,
    /// What is promised of the transcript.
    pub transcript_sha256: Option<String>,
}

/// Wants an answer.
#[derive(Debug)]
pub struct AnswerShape<'f> {
    /// Where faults go.
    pub faults: &'f mut Faults,
}

impl<'de> Shape<'de> for AnswerShape<'_> {
    type Out = PostedAnswer;

    fn wanted(&self) -> &'static str {
        "an object with \"turns\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn object<A: MapAccess<'de>>(self, mut members: A) -> Result<Option<PostedAnswer>, A::Error> {
        let faults = self.faults;
        let (mut log, mut transcript) = (None, None);
        let mut codes = Vec::new();
        while let Some(key) = members.next_key::<String>()? {
            faults.enter_key(&key);
            match key.as_str() {
                "turns" if log.is_none() => {
                    let turns = Turns { faults, limits: LIMITS.log(), codes: Some(&mut codes) };
                    log = Some(members.next_value_seed(Read(turns))?);
                }
                "transcript_sha256" if transcript.is_none() => {
                    let text = Text { faults, min_chars: 64, max_chars: 64 };
                    let hash: Option<String> = members.next_value_seed(Read(OrNull(text)))?.flatten().flatten();
                    if hash.as_deref().is_some_and(|hash| unhex::<32>(hash).is_none()) {
                        faults.add("expected 64 hexadecimal digits");
                    }
                    transcript = Some(hash.map(|hash| hash.to_lowercase()));
                }
                "turns" | "transcript_sha256" => {
                    faults.add("given twice");
                    members.next_value::<IgnoredAny>()?;
                }
                _ => {
                    faults.add("unknown field; an answer has turns and transcript_sha256");
                    members.next_value::<IgnoredAny>()?;
                }
            }
            faults.leave();
        }
        if log.is_none() {
            faults.add_at("turns", "missing");
        }
        let Some(Some(log)) = log else { return Ok(None) };
        let submission = PostedSubmission {
            line: None,
            run: None,
            suite: None,
            task: TaskRef::Number(0),
            log,
            codes,
            replays: Vec::new(),
        };
        Ok(Some(PostedAnswer { submission, transcript_sha256: transcript.flatten() }))
    }
}

//! Parser of answers to hidden instances, which reports all faults at once.

use serde::de::{IgnoredAny, MapAccess};

use crate::app::submissions::log_member::LogMember;
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::tolerant::{OrNull, Read, Shape, Text};

/// An answer as posted.
#[derive(Debug)]
pub struct PostedAnswer {
    /// Log, with action code that is yet to be run.
    pub sent: SentLog,
    /// SHA-256 of the transcript that the entrant promises to show, in hex.
    pub transcript_sha256: Option<String>,
}

/// Shape of an answer to a hidden instance.
#[derive(Debug)]
pub struct AnswerShape<'f> {
    /// Collector of faults.
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
        let (mut log, mut transcript) = (LogMember::default(), None);
        while let Some(key) = members.next_key::<String>()? {
            faults.enter_key(&key);
            match key.as_str() {
                "turns" | "log" if !log.is_given() => log.read(&key, &mut members, faults)?,
                "turns" | "log" => log.refuse_second(&mut members, faults)?,
                "transcript_sha256" if transcript.is_none() => {
                    let text = Text { faults, min_chars: 64, max_chars: 64 };
                    let hash: Option<String> = members.next_value_seed(Read(OrNull(text)))?.flatten().flatten();
                    if hash.as_deref().is_some_and(|hash| unhex::<32>(hash).is_none()) {
                        faults.add("expected 64 hexadecimal digits");
                    }
                    transcript = Some(hash.map(|hash| hash.to_lowercase()));
                }
                "transcript_sha256" => {
                    faults.add("given twice");
                    members.next_value::<IgnoredAny>()?;
                }
                _ => {
                    faults.add("unknown field; an answer has turns or log, and transcript_sha256");
                    members.next_value::<IgnoredAny>()?;
                }
            }
            faults.leave();
        }
        if !log.is_given() {
            faults.add_at("turns", "missing");
        }
        let Some(sent) = log.sent() else { return Ok(None) };
        Ok(Some(PostedAnswer { sent, transcript_sha256: transcript.flatten() }))
    }
}

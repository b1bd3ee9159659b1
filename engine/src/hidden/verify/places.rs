//! Checks where grades stand in the log of an epoch whose log grows by what is public.

use super::Verified;
use super::stated::Stated;
use crate::hidden::reveal::RevealedInstance;

/// Checks that grades were in the log when their entry was completed, and not made up later, behind receipts that fill
/// places.
pub(super) fn check(instances: &[RevealedInstance], stated: &Stated<'_>, found: &mut Verified) {
    for instance in instances {
        let (graded, completed) = (stated.graded_at.get(&instance.id), stated.completed_at.get(&instance.entry));
        if let (Some(graded), Some(completed)) = (graded, completed)
            && graded.iter().any(|graded| graded > completed)
        {
            found
                .breach(format!("instance {}", instance.id), "its grade entered the log after its entry was completed");
        }
        // Who could fail answers after seeing all grades could choose whom.
        if stated.failed.contains(&instance.id) && instance.overall.is_none() {
            found.unchecked.push(format!(
                "instance {}: the service failed to grade its answer, so it counts as failed",
                instance.id
            ));
        }
    }
    // An answer brings a place for its grade, and the completion of its entry another one.
    let most = 2 * stated.answers.len();
    if stated.padding > most {
        found.breach("receipts", format!("{} fill places; {most} are possible", stated.padding));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::evidence::AnswerFact;

    fn instance(overall: Option<bool>) -> RevealedInstance {
        let text = |text: &str| text.to_owned();
        RevealedInstance {
            ordinal: 1,
            id: text("instance"),
            entry: text("entry"),
            nonce: text("nonce"),
            run: 1,
            family: text("slabs"),
            index: 0,
            leaf: 0,
            log_sha256: Some(text("log")),
            overall,
            scores: None,
            transcript_sha256: None,
            transcript_checked: false,
        }
    }

    fn answer() -> AnswerFact {
        AnswerFact {
            instance: "instance".to_owned(),
            entry: "entry".to_owned(),
            log_sha256: "log".to_owned(),
            transcript_sha256: None,
            answered_at_ms: 1,
        }
    }

    fn found(overall: Option<bool>, stated: &Stated<'_>) -> Verified {
        let mut found = Verified::default();
        check(&[instance(overall)], stated, &mut found);
        found
    }

    fn stated(graded_at: i64, padding: usize) -> Stated<'static> {
        let own = || "instance".to_owned();
        Stated {
            answers: [(own(), answer())].into(),
            graded_at: [(own(), vec![graded_at])].into(),
            completed_at: [("entry".to_owned(), 10)].into(),
            padding,
            ..Stated::default()
        }
    }

    #[test]
    fn a_grade_stands_before_the_completion_of_its_entry() {
        assert_eq!(found(Some(true), &stated(9, 0)).breaches, []);
        let late = found(Some(true), &stated(11, 0)).breaches;
        assert!(late.len() == 1 && late[0].detail.contains("after its entry was completed"), "{late:?}");
    }

    #[test]
    fn no_more_than_two_receipts_fill_places_for_an_answer() {
        assert_eq!(found(Some(true), &stated(9, 2)).breaches, []);
        let many = found(Some(true), &stated(9, 3)).breaches;
        assert!(many.len() == 1 && many[0].detail.contains("3 fill places; 2 are possible"), "{many:?}");
    }

    #[test]
    fn an_answer_that_was_not_graded_is_told() {
        let stated = Stated { failed: ["instance".to_owned()].into(), ..stated(9, 0) };
        assert_eq!(found(None, &stated).unchecked.len(), 1);
        // A later attempt may have graded it.
        assert_eq!(found(Some(false), &stated).unchecked.len(), 0);
    }
}

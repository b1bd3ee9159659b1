//! Reports of gradings, written once by the attempt that holds the job.

use std::collections::{BTreeMap, HashMap};

use super::compression::compress;
use super::db::{Builder, Dialect, Row, RowValues, query};
use super::events::{self, NewEvent};
use super::evidence;
use super::jobs::{Claim, locks_of};
use super::postgres::notices::Notice;
use super::quota;
use super::receipts::{self, NewReceipt};
use super::run_ends::end_if_complete;
use super::run_rows::count;
use super::states::SubmissionState;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::grading::Report;
use plumbline_engine::grading::fingerprints::Fingerprint;
use plumbline_engine::hidden::receipts::Signed;

/// Row of a report, with its origin.
#[derive(Debug, Clone)]
pub struct ReportRow {
    /// The report.
    pub report: Report,
    /// Number of the attempt that created it.
    pub attempt: i64,
    /// Name and version of the program that created it.
    pub grader: String,
    /// Time of grading, in milliseconds since 1970.
    pub graded_at_ms: i64,
    /// Duration of the grading, in microseconds.
    pub grading_us: i64,
}

/// Report as it is stored. Packing takes time, so it is done outside the write transaction.
#[derive(Debug, Clone)]
pub struct PackedReport {
    checks_version: i64,
    overall: bool,
    accuracy: Option<bool>,
    scores: String,
    /// The report as packed JSON, or the reference to an object that holds it.
    pub(super) body: Vec<u8>,
    grading_us: i64,
    receipt: Option<Signed>,
    fingerprint: Option<Vec<u8>>,
}

impl PackedReport {
    /// Packs a report; `grading_us` is the duration of the grading in microseconds.
    ///
    /// # Errors
    /// Returns an error if the report cannot be compressed.
    pub fn of(report: &Report, grading_us: i64) -> StoreResult<Self> {
        Ok(Self {
            checks_version: i64::from(report.checks_version),
            overall: report.overall,
            accuracy: report.accuracy,
            scores: serde_json::to_string(&report.scores()).expect("scores are JSON"),
            body: compress(&serde_json::to_vec(report).expect("a report is JSON"))?,
            grading_us,
            receipt: None,
            fingerprint: None,
        })
    }

    /// Adds the fingerprint of the log.
    #[must_use]
    pub fn with_fingerprint(mut self, fingerprint: &Fingerprint) -> Self {
        self.fingerprint = Some(fingerprint.to_bytes());
        self
    }

    /// Adds its receipt, which is stored together with it.
    #[must_use]
    pub fn with_receipt(mut self, receipt: Signed) -> Self {
        self.receipt = Some(receipt);
        self
    }
}

impl PackedReport {
    /// Appends verdicts, scores, body and duration to a row of values, in this order.
    pub(super) fn push_to(&self, row: &mut RowValues<'_>) {
        row.push_bind(self.overall)
            .push_bind(self.accuracy)
            .push_bind(self.scores.clone())
            .push_bind(self.body.clone())
            .push_bind(self.grading_us);
    }
}

impl Store {
    async fn read_report(&self, row: &Row) -> StoreResult<ReportRow> {
        let body = self.blobs.unpack(&self.readers, "reports", row.get("body")?).await?;
        Ok(ReportRow {
            report: serde_json::from_slice(&body).map_err(|error| StoreError::corrupt("reports", error))?,
            attempt: row.get("attempt")?,
            grader: row.get("grader")?,
            graded_at_ms: row.get("graded_at_ms")?,
            grading_us: row.get("grading_us")?,
        })
    }

    /// Stores reports and ends their submissions, in one transaction. A report is stored only if its claim's attempt
    /// still holds the job; otherwise it is dropped, because another attempt counts. Returns the number of stored
    /// reports. The same may be recorded again after an error: what has been stored is not stored again.
    ///
    /// # Errors
    /// Returns an error if the database fails; then nothing is stored.
    pub async fn record(&self, graded: &mut [(Claim, PackedReport)], now_ms: i64) -> StoreResult<usize> {
        self.keep_reports(graded.iter_mut().map(|(_, report)| report)).await?;
        let mut tx = self.begin().await?;
        let locks = graded.iter().flat_map(|(claim, _)| {
            let epoch_id = claim.hidden.as_ref().map(|hidden| hidden.epoch_id.as_str());
            locks_of(claim.run_id.as_deref(), claim.owner.as_deref(), epoch_id)
        });
        tx.lock(locks).await?;
        let mut select = Builder::new("SELECT submission_id, attempt FROM jobs WHERE submission_id IN ");
        select.push_list(graded.iter().map(|(claim, _)| claim.submission_id.as_str()));
        if tx.dialect() == Dialect::Postgres {
            select.push(" ORDER BY submission_id FOR UPDATE");
        }
        let held: Vec<(String, i64)> = select.build_as().fetch_all(&mut tx).await?;
        let held: HashMap<String, i64> = held.into_iter().collect();
        let ours: Vec<&(Claim, PackedReport)> =
            graded.iter().filter(|(claim, _)| held.get(&claim.submission_id) == Some(&claim.attempt)).collect();
        if ours.is_empty() {
            return Ok(0);
        }
        let mut query = Builder::new(
            "INSERT INTO reports (submission_id, attempt, checks_version, grader, overall, accuracy, scores, body,
                                  graded_at_ms, grading_us, fingerprint) ",
        );
        query.push_values(&ours, |row, (claim, report)| {
            row.push_bind(claim.submission_id.clone())
                .push_bind(claim.attempt)
                .push_bind(report.checks_version)
                .push_bind(GRADER)
                .push_bind(report.overall)
                .push_bind(report.accuracy)
                .push_bind(report.scores.clone())
                .push_bind(report.body.clone())
                .push_bind(now_ms)
                .push_bind(report.grading_us)
                .push_bind(report.fingerprint.clone());
        });
        query.build().execute(&mut tx).await?;
        let ids = || ours.iter().map(|(claim, _)| claim.submission_id.as_str());
        let mut query = Builder::new("UPDATE submissions SET state = ");
        query
            .push_bind(SubmissionState::Graded.name())
            .push(", ended_at_ms = ")
            .push_bind(now_ms)
            .push(" WHERE id IN ");
        query.push_list(ids());
        query.build().execute(&mut tx).await?;
        let mut query = Builder::new("DELETE FROM jobs WHERE submission_id IN ");
        query.push_list(ids());
        query.build().execute(&mut tx).await?;
        let charged: Vec<(&str, &str)> = ours
            .iter()
            .filter(|(claim, _)| claim.hidden.is_none())
            .filter_map(|(claim, _)| Some((claim.owner.as_deref()?, claim.submission_id.as_str())))
            .collect();
        quota::charge(&mut tx, &charged, now_ms).await?;
        let mut receipts: Vec<NewReceipt<'_>> = Vec::new();
        for (claim, report) in &ours {
            let Some(signed) = &report.receipt else { continue };
            let of = Some((claim.submission_id.as_str(), claim.attempt));
            match &claim.hidden {
                None => receipts.push(NewReceipt { of, epoch_id: None, signed }),
                Some(hidden) => evidence::keep(&mut tx, &hidden.epoch_id, of, signed).await?,
            }
        }
        receipts::enter(&mut tx, &receipts).await?;
        // Grades of hidden instances are not announced.
        let ended: Vec<NewEvent<'_>> = ours
            .iter()
            .filter(|(claim, _)| claim.hidden.is_none())
            .map(|(claim, report)| NewEvent {
                run_id: claim.run_id.as_deref(),
                submission_id: Some(&claim.submission_id),
                state: SubmissionState::Graded.name(),
                overall: Some(report.overall),
            })
            .collect();
        if !ended.is_empty() {
            events::enter(&mut tx, &ended, now_ms).await?;
        }
        let mut runs: BTreeMap<(&str, &str), i64> = BTreeMap::new();
        for (claim, _) in &ours {
            if let Some(run_id) = &claim.run_id {
                *runs.entry((run_id, &claim.suite_id)).or_default() += 1;
            }
        }
        let mut has_ended = false;
        for ((run_id, suite_id), reports) in runs {
            count(&mut tx, run_id, -reports, reports, 0).await?;
            has_ended |= end_if_complete(&mut tx, run_id, suite_id, now_ms).await?;
        }
        tx.notify(Notice::Ended { changes_board: has_ended }).await?;
        commit(tx, "record").await?;
        self.note_ends(has_ended);
        Ok(ours.len())
    }

    /// Returns the latest report on a submission, or that of an attempt; none for answers to hidden instances.
    ///
    /// # Errors
    /// Returns an error if the database fails or the report cannot be read.
    pub async fn report(&self, submission_id: &str, attempt: Option<i64>) -> StoreResult<Option<ReportRow>> {
        let row = query(
            "SELECT r.attempt, r.grader, r.graded_at_ms, r.grading_us, r.body
             FROM reports r JOIN submissions s ON s.id = r.submission_id
             WHERE r.submission_id = $1 AND ($2 IS NULL OR r.attempt = $2) AND s.instance_id IS NULL
             ORDER BY r.attempt DESC LIMIT 1",
        )
        .bind(submission_id)
        .bind(attempt)
        .fetch_optional(&self.readers)
        .await?;
        let Some(row) = row else { return Ok(None) };
        self.read_report(&row).await.map(Some)
    }

    /// Returns the report on the answer to a hidden instance. Callers must have checked that its epoch is over.
    ///
    /// # Errors
    /// Returns an error if the database fails or the report cannot be read.
    pub async fn report_of_instance(&self, instance_id: &str) -> StoreResult<Option<ReportRow>> {
        let row = query(
            "SELECT r.attempt, r.grader, r.graded_at_ms, r.grading_us, r.body
             FROM reports r JOIN submissions s ON s.id = r.submission_id AND s.superseded = FALSE
             WHERE s.instance_id = $1 ORDER BY r.attempt DESC LIMIT 1",
        )
        .bind(instance_id)
        .fetch_optional(&self.readers)
        .await?;
        let Some(row) = row else { return Ok(None) };
        self.read_report(&row).await.map(Some)
    }
}

/// Name and version of this program, stored with each report.
pub const GRADER: &str = concat!("plumbline ", env!("CARGO_PKG_VERSION"));

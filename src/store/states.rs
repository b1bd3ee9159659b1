//! States as the database holds them: text columns that read as enums, and fail to read as anything else.

use serde::{Deserialize, Serialize};

use plumbline_engine::tasks::Track;
use plumbline_engine::voxel::Profile;

/// Lets an enum with `ALL` and `name` stand for the text of its names in queries.
macro_rules! text_column {
    ($state:ident) => {
        impl From<$state> for $crate::store::db::Value {
            fn from(state: $state) -> Self {
                Self::from(state.name())
            }
        }

        impl<'r> $crate::store::db::Column<'r> for $state {
            type Raw = &'r str;

            fn from_raw(raw: Option<&'r str>) -> Result<Self, sqlx::error::BoxDynError> {
                let name = <&str as $crate::store::db::Column>::from_raw(raw)?;
                let state = Self::ALL.into_iter().find(|state| state.name() == name);
                state.ok_or_else(|| format!("{name:?} is not a {}", stringify!($state)).into())
            }
        }
    };
}

pub(super) use text_column;

/// State of a submission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SubmissionState {
    /// Waits for a worker.
    Queued,
    /// Is being graded by a worker.
    Grading,
    /// Ended with a report.
    Graded,
    /// Ended because it cannot be graded as posted.
    Rejected,
    /// Ended because of a failure of ours.
    GraderError,
    /// Ended because its owner cancelled it.
    Cancelled,
}

impl SubmissionState {
    /// All states.
    pub const ALL: [Self; 6] =
        [Self::Queued, Self::Grading, Self::Graded, Self::Rejected, Self::GraderError, Self::Cancelled];

    /// Returns the name of the state in the API and the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Grading => "grading",
            Self::Graded => "graded",
            Self::Rejected => "rejected",
            Self::GraderError => "grader_error",
            Self::Cancelled => "cancelled",
        }
    }
}

text_column!(SubmissionState);

text_column!(Profile);

text_column!(Track);

/// State of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunState {
    /// Accepts submissions.
    Open,
    /// Accepts no more submissions; some are still being graded.
    Finishing,
    /// Ended, with a summary.
    Finished,
    /// Deleted by its owner while it was open.
    Deleted,
}

impl RunState {
    /// All states.
    pub const ALL: [Self; 4] = [Self::Open, Self::Finishing, Self::Finished, Self::Deleted];

    /// Returns the name of the state in the API and the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Finishing => "finishing",
            Self::Finished => "finished",
            Self::Deleted => "deleted",
        }
    }
}

text_column!(RunState);

/// State of a delivery.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DeliveryState {
    /// Another attempt follows.
    Pending,
    /// The endpoint accepted the message.
    Delivered,
    /// All attempts failed, or the endpoint wants no more messages.
    Dead,
}

impl DeliveryState {
    const ALL: [Self; 3] = [Self::Pending, Self::Delivered, Self::Dead];

    /// Returns the name of the state in the API and the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pending => "pending",
            Self::Delivered => "delivered",
            Self::Dead => "dead",
        }
    }
}

text_column!(DeliveryState);

/// State of a regrade.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RegradeState {
    /// Submissions are being graded again.
    Computing,
    /// All are graded again; somebody reviews what changes.
    Ready,
    /// Its reports are in force.
    Applied,
    /// Its reports are not used.
    Discarded,
}

impl RegradeState {
    const ALL: [Self; 4] = [Self::Computing, Self::Ready, Self::Applied, Self::Discarded];

    /// Returns the name of the state in the database and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Computing => "computing",
            Self::Ready => "ready",
            Self::Applied => "applied",
            Self::Discarded => "discarded",
        }
    }
}

text_column!(RegradeState);

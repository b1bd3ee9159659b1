//! Origin of the logs of a run.

/// Origin of the logs of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Provenance {
    /// The owner of the run reports them.
    SelfReported,
    /// The operator of the service re-ran the agent.
    ReRunByHost,
}

impl Provenance {
    /// Returns the name that is stored and shown.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SelfReported => "self-reported",
            Self::ReRunByHost => "re-run-by-host",
        }
    }
}

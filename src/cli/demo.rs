//! The demo agents.

/// Posts the demo agents to the service at `base`.
pub async fn run(base: String) {
    let _ = base;
}

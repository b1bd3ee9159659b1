//! Keeps background tasks running, and waits for them at the end.

use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

/// Pause before a task that panicked starts again; doubled each time, up to [`LONGEST_PAUSE`], until it runs for longer
/// than that.
const PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_mins(5);

/// Longest wait for the tasks when the service stops, for example for the answer to a webhook.
const GRACE: Duration = Duration::from_secs(5);

/// Background tasks of a service, which share something. Each ends by itself once the service stops.
#[derive(Debug)]
pub(super) struct Supervisor<S> {
    shared: S,
    tasks: TaskTracker,
    stop: CancellationToken,
}

impl<S: Clone + Send + 'static> Supervisor<S> {
    pub fn new(shared: S, stop: CancellationToken) -> Self {
        Self { shared, tasks: TaskTracker::new(), stop }
    }

    /// Runs a task until it ends by itself. One that panics starts again after a pause.
    pub fn run<F: Future<Output = ()> + Send + 'static>(
        &self,
        name: &'static str,
        task: impl Fn(S) -> F + Send + 'static,
    ) {
        let (shared, stop) = (self.shared.clone(), self.stop.clone());
        self.tasks.spawn(async move {
            let (mut pause, mut begun) = (PAUSE, Instant::now());
            while let Err(error) = tokio::spawn(task(shared.clone())).await {
                pause = if begun.elapsed() > LONGEST_PAUSE { PAUSE } else { pause };
                tracing::error!(name, %error, "a background task failed and starts again");
                if stop.run_until_cancelled(tokio::time::sleep(pause)).await.is_none() {
                    return;
                }
                pause = (pause * 2).min(LONGEST_PAUSE);
                begun = Instant::now();
            }
        });
    }

    /// Waits until all tasks have ended, after the service was told to stop.
    pub async fn ended(&self) {
        self.tasks.close();
        if tokio::time::timeout(GRACE, self.tasks.wait()).await.is_err() {
            tracing::warn!(tasks = self.tasks.len(), "background tasks did not end in time");
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[tokio::test]
    async fn a_task_that_panics_starts_again() {
        let stop = CancellationToken::new();
        let starts = Arc::new(AtomicUsize::new(0));
        let supervisor = Supervisor::new(Arc::clone(&starts), stop.clone());
        supervisor.run("test", async |starts: Arc<AtomicUsize>| {
            assert_ne!(starts.fetch_add(1, Ordering::SeqCst), 0, "the first start fails");
        });
        supervisor.ended().await;
        assert_eq!(starts.load(Ordering::SeqCst), 2);
        // A task that fails while the service stops does not hold it up.
        supervisor.run("test", async |_| panic!("always"));
        stop.cancel();
        supervisor.ended().await;
        assert!(supervisor.tasks.is_empty(), "it does not wait for the pause");
    }
}

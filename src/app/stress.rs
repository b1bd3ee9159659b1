//! Stress fields of structures: computed with fair turns between senders, and cached by content.

use std::sync::Arc;
use std::time::{Duration, Instant};

use quick_cache::Weighter;
use quick_cache::sync::Cache;
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;
use crate::app::rewards::grader::note_panic;
use crate::fair::{FairSlots, Permit, PermitPool};
use crate::threads::yield_to_others;
use plumbline_engine::elasticity::Control;
use plumbline_engine::elasticity::field::{Field, Method};
use plumbline_engine::voxel::Structure;

/// Cache key: the log's hash, the turn, and the method.
pub type Key = (Box<str>, usize, Method);
/// Field, or the time at which its computation timed out; the limit is in wall-clock time, so a later attempt may
/// succeed.
type Kept = Result<Arc<Field>, Instant>;

/// Time for which a field whose computation timed out is not tried again.
const TOO_LONG_FOR: Duration = Duration::from_mins(1);

#[derive(Debug, Clone)]
struct ByMemory;

impl Weighter<Key, Kept> for ByMemory {
    fn weight(&self, key: &Key, field: &Kept) -> u64 {
        let bytes = field.as_ref().map_or(0, |field| {
            field.von_mises_pa.capacity() * size_of::<Option<f64>>()
                + field.displacement_m.capacity() * size_of::<Option<[f64; 3]>>()
                + field.cautions.iter().map(String::capacity).sum::<usize>()
        });
        (bytes + key.0.len() + OWN_BYTES) as u64
    }
}

/// Memory of a field apart from its numbers, in bytes.
const OWN_BYTES: usize = 256;
/// Niceness of the threads that compute fields.
const NICENESS: i32 = 10;

/// Computes stress fields, a few at once and one for each sender, and caches them by content.
#[derive(Debug)]
pub struct StressFields {
    admitted: Arc<PermitPool>,
    slots: Arc<FairSlots>,
    threads: rayon::ThreadPool,
    kept: Cache<Key, Kept, ByMemory>,
}

impl StressFields {
    /// Creates an empty cache and starts the threads.
    ///
    /// # Errors
    /// Returns an error if a thread cannot be started.
    pub fn new() -> anyhow::Result<Self> {
        const TYPICAL_BYTES: usize = 64 << 10;
        let at_once = LIMITS.stress_fields_at_once;
        let threads = rayon::ThreadPoolBuilder::new().num_threads(at_once).thread_name(|i| format!("stress-{i}"));
        let bytes = LIMITS.stress_cache_bytes;
        Ok(Self {
            admitted: PermitPool::new(at_once + LIMITS.stress_fields_waiting, LIMITS.stress_fields_waiting_per_sender),
            slots: FairSlots::new(at_once, LIMITS.stress_fields_per_sender),
            threads: threads.start_handler(|_| yield_to_others(NICENESS)).panic_handler(note_panic).build()?,
            kept: Cache::with_weighter(bytes / TYPICAL_BYTES, bytes as u64, ByMemory),
        })
    }

    /// Takes a slot among the requests that compute or wait; a field that is kept needs none.
    ///
    /// # Errors
    /// Refuses the request if too many wait.
    pub fn admit(&self, key: &Key, who: &Arc<str>) -> AppResult<Option<Permit>> {
        if self.kept(key).is_some() {
            return Ok(None);
        }
        self.admitted.take(who).map(Some).map_err(|_| busy())
    }

    fn kept(&self, key: &Key) -> Option<Kept> {
        self.kept.get(key).filter(|kept| !kept.as_ref().is_err_and(|since| since.elapsed() > TOO_LONG_FOR))
    }

    /// Returns the stress field of a structure, computed or from the cache.
    ///
    /// # Errors
    /// Returns 503 if too many requests wait, if it cannot begin in time, or if the service stops; 422 if computing
    /// takes too long.
    pub async fn field(
        &self,
        key: Key,
        structure: &Arc<Structure>,
        permit: Option<Permit>,
        who: &Arc<str>,
        stop: &CancellationToken,
    ) -> AppResult<Arc<Field>> {
        let blocks = structure.len();
        if let Some(kept) = self.kept(&key) {
            return kept.map_err(|_| too_long(blocks));
        }
        // A field that was kept when the request was admitted may have been evicted since.
        let _permit = match permit {
            Some(permit) => permit,
            None => self.admitted.take(who).map_err(|_| busy())?,
        };
        let patience = Duration::from_secs(LIMITS.stress_wait_seconds);
        let slot = tokio::time::timeout(patience, self.slots.take(who)).await.map_err(|_late| busy())?;
        // Another request may have computed it meanwhile.
        if let Some(kept) = self.kept(&key) {
            return kept.map_err(|_| too_long(blocks));
        }
        // The computation ends if the client leaves or the service stops.
        let left = stop.child_token();
        let _guard = left.clone().drop_guard();
        let (answer, answered) = oneshot::channel();
        let (structure, method) = (Arc::clone(structure), key.2);
        self.threads.spawn_fifo(move || {
            let _slot = slot;
            let deadline = Instant::now() + Duration::from_secs(LIMITS.stress_seconds);
            let stop = || left.is_cancelled() || Instant::now() >= deadline;
            let field = Field::of(structure.cells(), method, &Control::until(&stop));
            // The receiver may be gone.
            let _ = answer.send(field.map_err(|_stopped| left.is_cancelled()));
        });
        match answered.await.map_err(|error| AppError::internal(&error))? {
            Ok(field) => {
                metrics::counter!("plumbline_stress_fields_computed_total").increment(1);
                let field = Arc::new(field);
                self.kept.insert(key, Ok(Arc::clone(&field)));
                Ok(field)
            }
            Err(true) => {
                let detail = "The service is shutting down. The request may be sent again.";
                Err(AppError::new(Kind::Stopping, detail).retry_after(5))
            }
            Err(false) => {
                self.kept.insert(key, Err(Instant::now()));
                Err(too_long(blocks))
            }
        }
    }
}

fn busy() -> AppError {
    let detail = "Many stress fields are being computed. The request may be sent again.";
    AppError::new(Kind::Busy, detail).retry_after(2)
}

fn too_long(blocks: usize) -> AppError {
    let detail = format!("the stress of these {blocks} blocks takes longer than {} s", LIMITS.stress_seconds);
    AppError::new(Kind::TooLong, detail)
}

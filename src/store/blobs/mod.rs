//! Large logs and reports outside the database: objects in a folder or a bucket, named by their SHA-256.
//!
//! An object is durable before the row that refers to it is written. Rows refer to objects by a short text in place of
//! the bytes. What no row refers to, because its transaction failed, is swept later. The database notes the place, so
//! commands find it without being told, and an identifier that stands in the place too, so that nobody takes another
//! place for it.

mod place;
mod reference;
mod sweep;

use std::sync::{Arc, OnceLock, PoisonError, RwLock};
use std::time::Duration;

use object_store::{ObjectStore, ObjectStoreExt as _, PutPayload, path::Path};
use sqlx::AssertSqlSafe;
use tokio::sync::Mutex;

use super::compression::decompress;
use super::db::{Pool, query, query_as, query_scalar};
use super::location::Location;
use super::locks::Lock;
use super::reports::PackedReport;
use super::snapshot::open_reading;
use super::submissions::NewSubmission;
use super::{Store, StoreError, StoreResult, commit};
use crate::clock::now_ms;
pub use place::BlobPlace;
use reference::Reference;
pub use sweep::Swept;

/// Bytes, as packed, from which a log or a report becomes an object. Smaller ones are cheaper as rows:
/// `docs/operations.md` has the figures.
pub const OBJECT_BYTES: usize = 32 << 10;

/// Object that holds the identifier of a place.
const IDENTIFIER: &str = "plumbline.id";
/// What the database notes once the place has its identifier: from then on, a place without it is another.
const NAMED: &str = "blobs named";
/// Time to look whether a folder is there.
const LOOK: Duration = Duration::from_secs(2);
/// Reads the place that the database notes, and its identifier.
const NOTED: &str =
    "SELECT place.value, id.value FROM agreed place JOIN agreed id ON id.name = 'blobs id' WHERE place.name = 'blobs'";

/// Blobs of a database; clones share what they know.
#[derive(Debug, Clone, Default)]
pub(super) struct Blobs(Arc<RwLock<Option<Opened>>>);

/// Place that is opened.
#[derive(Debug, Clone)]
struct Opened {
    place: Arc<BlobPlace>,
    /// Its objects, once the place could be opened.
    objects: Arc<OnceLock<Arc<dyn ObjectStore>>>,
    /// Identifier that the place has, once it is agreed on.
    id: Option<Arc<str>>,
    /// Held while somebody looks whether the place is there: a share that hangs is asked by one at a time.
    looking: Arc<Mutex<()>>,
}

impl Opened {
    fn at(place: BlobPlace, id: Option<&str>) -> Self {
        let (objects, looking) = (Arc::default(), Arc::default());
        Self { place: Arc::new(place), objects, id: id.map(Into::into), looking }
    }

    /// Returns the objects of the place. A folder that was not there is looked for again.
    fn objects(&self) -> StoreResult<&Arc<dyn ObjectStore>> {
        match self.objects.get() {
            Some(objects) => Ok(objects),
            None => self.open(false),
        }
    }

    fn open(&self, creates: bool) -> StoreResult<&Arc<dyn ObjectStore>> {
        let objects = self.place.open(creates)?;
        Ok(self.objects.get_or_init(|| objects))
    }

    /// Describes a request that failed. What is not there, or is not what it should be, stays so.
    fn failed(&self, path: &Path, error: &object_store::Error) -> StoreError {
        match error {
            object_store::Error::NotFound { .. } => {
                StoreError::BlobLost(format!("there is no {path} in {}", self.place))
            }
            _ => self.unreached(error),
        }
    }

    /// Describes a place that does not answer, or not as it should, which may pass.
    fn unreached(&self, detail: &dyn std::fmt::Display) -> StoreError {
        let detail = format!("{detail}{}", self.place.credentials_hint());
        StoreError::Blobs { place: self.place.to_string(), detail }
    }

    /// Makes sure that the folder is the one that was agreed on. Where a share is not mounted, its empty mount point is
    /// a folder too: what is written there is lost to everybody who has the share, and what is read seems lost.
    async fn is_agreed(&self) -> StoreResult<()> {
        let (BlobPlace::Folder(_), Some(id)) = (&*self.place, &self.id) else { return Ok(()) };
        let objects = self.objects()?;
        let read = async || objects.get(&Path::from(IDENTIFIER)).await?.bytes().await;
        match read().await {
            Ok(found) if String::from_utf8_lossy(&found).trim() == &**id => Ok(()),
            Ok(_) => Err(self.unreached(&format!("{IDENTIFIER} there is of another place"))),
            Err(object_store::Error::NotFound { .. }) => Err(self.unreached(&is_not_there(id))),
            Err(error) => Err(self.unreached(&error)),
        }
    }

    async fn get(&self, path: &Path) -> StoreResult<Vec<u8>> {
        let failed = |error| self.failed(path, &error);
        let objects = self.objects()?;
        let read = async || -> StoreResult<Vec<u8>> {
            let found = objects.get(path).await.map_err(failed)?;
            Ok(found.bytes().await.map_err(failed)?.to_vec())
        };
        match read().await {
            Err(error @ StoreError::BlobLost(_)) => {
                self.is_agreed().await?;
                Err(error)
            }
            read => read,
        }
    }

    /// Writes an object durably.
    async fn put(&self, path: &Path, bytes: Vec<u8>) -> StoreResult<()> {
        self.is_agreed().await?;
        self.objects()?.put(path, PutPayload::from(bytes)).await.map_err(|error| self.unreached(&error))?;
        // The folder may have gone away meanwhile.
        self.is_agreed().await
    }
}

impl Blobs {
    fn opened(&self) -> Option<Opened> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, opened: Opened) {
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = Some(opened);
    }

    /// Returns the place that the database notes. Another node may have noted it meanwhile.
    async fn noted(&self, readers: &Pool) -> StoreResult<Option<Opened>> {
        if let Some(opened) = self.opened() {
            return Ok(Some(opened));
        }
        let noted: Option<(String, String)> = query_as(NOTED).fetch_optional(readers).await?;
        let Some((noted, id)) = noted else { return Ok(None) };
        let opened = Opened::at(noted.parse().map_err(StoreError::BlobPlace)?, Some(&id));
        self.set(opened.clone());
        Ok(Some(opened))
    }

    /// Opens the place that the database notes, if it notes one.
    pub async fn open(readers: &Pool) -> StoreResult<Self> {
        let blobs = Self::default();
        blobs.noted(readers).await?;
        Ok(blobs)
    }

    /// Returns whether a column refers to an object.
    pub fn is_reference(column: &[u8]) -> bool {
        Reference::read(column).is_some()
    }

    /// Makes large bytes an object, and returns what the column holds: a reference, or the bytes themselves.
    async fn keep(&self, bytes: Vec<u8>) -> StoreResult<Vec<u8>> {
        let Some(opened) = self.opened().filter(|_| bytes.len() >= OBJECT_BYTES) else { return Ok(bytes) };
        let reference = Reference::of(&bytes, now_ms());
        opened.put(&reference.path(), bytes).await?;
        Ok(reference.to_column())
    }

    /// Returns the packed bytes of a column, which may refer to an object.
    pub async fn fetch(&self, readers: &Pool, column: Vec<u8>) -> StoreResult<Vec<u8>> {
        let Some(reference) = Reference::read(&column) else { return Ok(column) };
        let path = reference.path();
        let opened = self.noted(readers).await?;
        let opened = opened.ok_or_else(|| StoreError::BlobLost(format!("no place is noted where {path} could be")))?;
        let bytes = opened.get(&path).await?;
        if !reference.is_of(&bytes) {
            return Err(StoreError::BlobLost(format!("{path} in {} has other bytes than were written", opened.place)));
        }
        Ok(bytes)
    }

    /// Returns the unpacked bytes of a column, which may refer to an object.
    pub async fn unpack(&self, readers: &Pool, table: &'static str, column: Vec<u8>) -> StoreResult<Vec<u8>> {
        decompress(table, &self.fetch(readers, column).await?)
    }
}

/// Says that a place lacks this identifier.
fn is_not_there(id: &str) -> String {
    format!(
        "{IDENTIFIER} is not there: is the folder mounted? If its objects are there and that file alone is lost, write {id} into it"
    )
}

/// Returns where a database keeps its large logs and reports, if not in itself, and why the place cannot be reached now, if
/// that is so and a row refers to an object. A bucket is not asked.
///
/// # Errors
/// Returns an error if the database fails, or notes a place that cannot be read.
pub async fn place_of(database: &Location) -> StoreResult<Option<(BlobPlace, Option<StoreError>)>> {
    let pool = open_reading(database).await?;
    let (opened, has_objects) = (Blobs::open(&pool).await?.opened(), has_objects(&pool).await?);
    pool.close().await;
    let Some(opened) = opened else { return Ok(None) };
    let unreached = if has_objects { opened.is_agreed().await.err() } else { None };
    Ok(Some((BlobPlace::clone(&opened.place), unreached)))
}

/// Returns whether a row refers to an object.
async fn has_objects(pool: &Pool) -> StoreResult<bool> {
    for (table, column) in reference::COLUMNS {
        // The index of references has their length as a condition, which a bound value would not meet.
        let (length, beginning) = (reference::LENGTH, reference::BEGINNING);
        let exists = format!(
            "SELECT EXISTS (SELECT 1 FROM {table} WHERE length({column}) = {length} AND substr({column}, 1, {}) = $1)",
            beginning.len()
        );
        if query_scalar(AssertSqlSafe(exists)).bind(beginning.as_bytes()).fetch_one(pool).await? {
            return Ok(true);
        }
    }
    Ok(false)
}

impl Store {
    /// Decides where large logs and reports are, and returns a notice if the place cannot be reached now. The place that
    /// the database notes holds; `wanted` is noted if there is none yet, or if it is the same place under another URL.
    ///
    /// # Errors
    /// Returns an error if the place is another than the one noted, or cannot be opened, or the database fails.
    pub async fn settle_blobs(&self, wanted: Option<&BlobPlace>) -> StoreResult<Option<String>> {
        let noted: Option<(String, String)> = query_as(NOTED).fetch_optional(&self.readers).await?;
        let place = match (&noted, wanted) {
            (None, None) => return Ok(None),
            (_, Some(wanted)) => wanted.clone(),
            (Some((noted, _)), None) => noted.parse().map_err(StoreError::BlobPlace)?,
        };
        let mut opened = Opened::at(place, None);
        let own = noted.as_ref().filter(|(noted, _)| *noted == opened.place.to_string());
        if own.is_none() {
            opened.open(true)?;
        }
        let later = |mut opened: Opened, error: &StoreError, id: &str| {
            opened.id = Some(id.into());
            self.blobs.set(opened);
            Ok(Some(format!("{error}; large logs are refused until it answers")))
        };
        let found = match opened.get(&Path::from(IDENTIFIER)).await {
            Ok(id) => Some(String::from_utf8_lossy(&id).trim().to_owned()),
            Err(StoreError::BlobLost(_)) => None,
            Err(error) => match own {
                Some((_, id)) => return later(opened, &error, id),
                None => return Err(StoreError::BlobPlace(error.to_string())),
            },
        };
        let is_named = self.noted_as(NAMED).await?.is_some() || has_objects(&self.readers).await?;
        if let (None, Some((_, id)), true) = (&found, own, is_named) {
            // A bucket is not asked for its identifier at each request, so none is begun without it.
            if let BlobPlace::Bucket { .. } = &*opened.place {
                let place = &opened.place;
                let why = format!(
                    "{place} lacks {IDENTIFIER}: is AWS_ENDPOINT the server that has the blobs of this database?"
                );
                return Err(StoreError::BlobPlace(why));
            }
            let error = opened.unreached(&is_not_there(id));
            return later(opened, &error, id);
        }
        let id = self.agree_on_place(&opened.place, noted, found.as_deref()).await?;
        if found.is_none() {
            opened.put(&Path::from(IDENTIFIER), id.clone().into_bytes()).await?;
        }
        if !is_named {
            self.note(NAMED, "yes").await?;
        }
        opened.id = Some(id.into());
        self.blobs.set(opened);
        Ok(None)
    }

    /// Notes a place and the identifier that it has, or gets. Returns the identifier.
    async fn agree_on_place(
        &self,
        place: &BlobPlace,
        noted: Option<(String, String)>,
        found: Option<&str>,
    ) -> StoreResult<String> {
        let refused = |why: String| Err(StoreError::BlobPlace(format!("{place} {why}")));
        let Some((place_before, id)) = noted else {
            if found.is_some() {
                return refused("holds blobs of another database: give a folder, bucket or prefix of its own".into());
            }
            return self.note_place(place).await;
        };
        match found {
            Some(found) if found != id => {
                refused(format!("holds blobs of another database; those of this one are in {place_before}"))
            }
            // A place that got no identifier, because the process died, holds nothing yet.
            None if has_objects(&self.readers).await? => refused(format!(
                "lacks the blobs of this database, which are in {place_before}: copy all of them first"
            )),
            _ => {
                let mut tx = self.begin().await?;
                query("UPDATE agreed SET value = $1 WHERE name = 'blobs'")
                    .bind(place.to_string())
                    .execute(&mut tx)
                    .await?;
                commit(tx, "agree_on_place").await?;
                Ok(id)
            }
        }
    }

    /// Notes the first place of a database. If another node does so at the same time, one of both holds.
    async fn note_place(&self, place: &BlobPlace) -> StoreResult<String> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Order]).await?;
        for (name, value) in [("blobs", place.to_string()), ("blobs id", uuid::Uuid::new_v4().to_string())] {
            query("INSERT INTO agreed (name, value) VALUES ($1, $2) ON CONFLICT (name) DO NOTHING")
                .bind(name)
                .bind(value)
                .execute(&mut tx)
                .await?;
        }
        let (held, id): (String, String) = query_as(NOTED).fetch_one(&mut tx).await?;
        if held != place.to_string() {
            return Err(StoreError::BlobPlace(format!("{place}: another node has just begun to keep blobs in {held}")));
        }
        commit(tx, "note_place").await?;
        Ok(id)
    }

    /// Returns the folder of large logs and reports if it is not there now. A bucket is not asked.
    pub async fn missing_folder(&self) -> Option<String> {
        let opened = self.blobs.opened()?;
        let place = opened.place.to_string();
        let Ok(alone) = Arc::clone(&opened.looking).try_lock_owned() else { return Some(place) };
        let look = tokio::spawn(async move {
            let _alone = alone;
            opened.is_agreed().await.is_ok()
        });
        let is_there = matches!(tokio::time::timeout(LOOK, look).await, Ok(Ok(true)));
        (!is_there).then_some(place)
    }

    /// Makes the large logs among submissions objects. Call it before the transaction that stores them.
    pub(super) async fn keep_logs(&self, submissions: Arc<[NewSubmission]>) -> StoreResult<Arc<[NewSubmission]>> {
        if self.blobs.opened().is_none() || submissions.iter().all(|new| new.log.zstd().len() < OBJECT_BYTES) {
            return Ok(submissions);
        }
        let mut kept = submissions.to_vec();
        for new in &mut kept {
            let bytes = self.blobs.keep(new.log.take()).await?;
            new.log.set(bytes);
        }
        Ok(kept.into())
    }

    /// Makes the large ones of reports objects. Call it before the transaction that stores them.
    pub(super) async fn keep_reports<'a>(
        &self,
        reports: impl Iterator<Item = &'a mut PackedReport>,
    ) -> StoreResult<()> {
        for report in reports {
            report.body = self.blobs.keep(std::mem::take(&mut report.body)).await?;
        }
        Ok(())
    }
}

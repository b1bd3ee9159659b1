//! Secrets beside the database: keys of epochs with their pools, and the key that signs receipts. They are in a folder
//! that only the user of the service may read, and copies of the database do not contain them.

use std::io::{ErrorKind, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::location::Location;
use super::{StoreError, StoreResult};
use plumbline_engine::hidden::beacon::BoundPool;
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::commitment::{Commitment, root_of};
use plumbline_engine::hidden::pool::{Generator, PoolError, Specification, Stratum};
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::hidden::secret::EpochKey;
use plumbline_engine::tasks::hex;

/// Secret that an epoch draws from.
#[derive(Debug)]
pub struct EpochSecret {
    /// Key of the epoch.
    pub key: EpochKey,
    /// Key that the pool derives from: that of the epoch, or one that a beacon has its part in.
    pub pool_key: EpochKey,
    /// The pool; empty until the round of the epoch's beacon.
    pub pool: PoolFile,
}

/// Strata and specifications of a pool.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct PoolFile {
    /// Strata of the pool.
    pub strata: Vec<Stratum>,
    /// Specifications of the pool, by leaf.
    pub specifications: Vec<Specification>,
}

impl PoolFile {
    /// Draws a pool on all cores, and calls `drawn` after each specification.
    ///
    /// # Errors
    /// Returns an error if this program lacks the version of the generator, or its families are faulty.
    pub fn draw(version: u32, key: &EpochKey, per_instance: u32, drawn: &(dyn Fn() + Sync)) -> Result<Self, PoolError> {
        let generator = Generator::of(version)?;
        let strata = generator.strata(key, per_instance);
        let made: Result<Vec<Vec<Specification>>, PoolError> =
            strata.par_iter().map(|stratum| generator.specifications(key, stratum, drawn)).collect();
        Ok(Self { specifications: made?.concat(), strata })
    }
}

#[derive(Serialize, Deserialize)]
struct SecretFile {
    key: String,
    #[serde(flatten)]
    pool: PoolFile,
}

/// File of the key that signs receipts.
const SIGNER: &str = "receipts.key";

/// Returns the name of the file with a pool that is bound to a beacon.
fn pool_file(epoch: &str) -> String {
    format!("epoch-{epoch}.pool.json")
}

/// Folder that holds the secrets of a database.
#[derive(Debug, Clone)]
pub struct Secrets {
    folder: PathBuf,
}

fn failed(path: &Path, error: &std::io::Error) -> StoreError {
    let detail = if error.kind() == ErrorKind::PermissionDenied {
        format!("{error}: it must belong to the user of the service (chown)")
    } else {
        error.to_string()
    };
    StoreError::Secret { path: path.to_owned(), detail }
}

impl Secrets {
    /// Returns the secrets in this folder.
    #[must_use]
    pub const fn in_folder(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Returns the folder beside this database file.
    #[must_use]
    pub fn beside(database: &Path) -> Self {
        Self::in_folder(Location::File(database.to_owned()).default_secrets())
    }

    /// Returns the path of the folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a new file atomically and durably. Returns false if the file exists, and leaves it unchanged.
    fn put(&self, name: &str, content: &[u8]) -> StoreResult<bool> {
        let path = self.file(name);
        let write = || -> std::io::Result<bool> {
            std::fs::DirBuilder::new().recursive(true).mode(0o700).create(&self.folder)?;
            let draft = self.file(&format!(".{name}.{}", uuid::Uuid::new_v4()));
            let mut file = std::fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(&draft)?;
            // A command that root runs should not make files that the service cannot read. Where root may not give files
            // away, as on some network file systems, they stay root's.
            if rustix::process::geteuid().is_root() {
                let folder = std::fs::metadata(&self.folder)?;
                let _ = fchown(&file, Some(folder.uid()), Some(folder.gid()));
            }
            // A link, unlike a rename, never replaces an existing file.
            let linked =
                file.write_all(content).and_then(|()| file.sync_all()).and_then(|()| std::fs::hard_link(&draft, &path));
            std::fs::remove_file(&draft)?;
            std::fs::File::open(&self.folder)?.sync_all()?;
            match linked {
                Ok(()) => Ok(true),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
                Err(error) => Err(error),
            }
        };
        write().map_err(|error| failed(&path, &error))
    }

    /// Returns a secret that was there a moment ago.
    fn must_get(&self, name: &str) -> StoreResult<Vec<u8>> {
        let gone = || StoreError::Secret { path: self.file(name), detail: "is gone".to_owned() };
        self.get(name)?.ok_or_else(gone)
    }

    fn get(&self, name: &str) -> StoreResult<Option<Vec<u8>>> {
        let path = self.file(name);
        match std::fs::read(&path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(failed(&path, &error)),
        }
    }

    /// Stores the secret of an epoch. Returns false if there is a secret for an epoch of this name.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn put_epoch(&self, id: &str, secret: &EpochSecret) -> StoreResult<bool> {
        let file = SecretFile { key: secret.key.expose(), pool: secret.pool.clone() };
        let content = serde_json::to_vec(&file).map_err(|error| StoreError::failed("making a secret", error))?;
        self.put(&format!("epoch-{id}.json"), &content)
    }

    /// Returns whether there is a file with the secret of an epoch that can be read.
    #[must_use]
    pub fn has_epoch(&self, id: &str) -> bool {
        std::fs::File::open(self.file(&format!("epoch-{id}.json"))).is_ok()
    }

    /// Returns the secret of an epoch; none if it is lost, or does not match the commitment. A pool that is bound to a
    /// beacon is drawn again if its file is missing.
    ///
    /// # Errors
    /// Returns an error if a file exists but cannot be read, or a pool cannot be drawn.
    pub fn epoch(&self, commitment: &Commitment, made: Option<&BoundPool>) -> StoreResult<Option<EpochSecret>> {
        let id = &commitment.epoch;
        let Some(content) = self.get(&format!("epoch-{id}.json"))? else { return Ok(None) };
        let Ok(SecretFile { key, pool }) = serde_json::from_slice::<SecretFile>(&content) else { return Ok(None) };
        let Some(key) = EpochKey::from_hex(&key).filter(|key| hex(&key.hash()) == commitment.key_hash) else {
            return Ok(None);
        };
        let Some(beacon) = &commitment.beacon else {
            let holds = commitment.root.as_ref() == Some(&root_of(&key, &pool.specifications));
            return Ok(holds.then(|| EpochSecret { pool_key: key.clone(), key, pool }));
        };
        let Some(made) = made else {
            return Ok(Some(EpochSecret { pool_key: key.clone(), key, pool: PoolFile::default() }));
        };
        let Ok(randomness) = beacon.randomness(&made.round()) else { return Ok(None) };
        let pool_key = beacon.pool_key(&key, &randomness);
        let pool = self.bound_pool(commitment, &pool_key, &made.root)?;
        Ok(pool.map(|pool| EpochSecret { key, pool_key, pool }))
    }

    /// Returns the pool with this root that derives from a key; `None` if the key gives another.
    fn bound_pool(&self, commitment: &Commitment, key: &EpochKey, root: &str) -> StoreResult<Option<PoolFile>> {
        let name = pool_file(&commitment.epoch);
        if let Some(content) = self.get(&name)? {
            let kept = serde_json::from_slice::<PoolFile>(&content).ok();
            if let Some(pool) = kept.filter(|pool| root_of(key, &pool.specifications) == root) {
                return Ok(Some(pool));
            }
            // Without this, a damaged file would make each start draw the pool again. Key and round reproduce the pool.
            let path = self.file(&name);
            std::fs::remove_file(&path).map_err(|error| failed(&path, &error))?;
        }
        let pool = self.put_pool(commitment, key)?;
        Ok(Some(pool).filter(|pool| root_of(key, &pool.specifications) == root))
    }

    /// Draws the pool of an epoch that is bound to a beacon, and stores it.
    ///
    /// # Errors
    /// Returns an error if the pool cannot be drawn, or the file cannot be written.
    pub fn put_pool(&self, commitment: &Commitment, key: &EpochKey) -> StoreResult<PoolFile> {
        let pool = PoolFile::draw(commitment.generator_version, key, commitment.per_instance, &|| ())
            .map_err(|error| StoreError::failed("making a secret", error))?;
        let content = serde_json::to_vec(&pool).map_err(|error| StoreError::failed("making a secret", error))?;
        self.put(&pool_file(&commitment.epoch), &content)?;
        Ok(pool)
    }

    /// Returns a file that other users may read or change, or the folder if they may change what is in it, with its mode.
    /// What cannot be looked at is left out.
    #[must_use]
    pub fn exposed(&self) -> Option<(PathBuf, u32)> {
        const OTHERS: u32 = 0o077;
        const OTHERS_WRITE: u32 = 0o022;
        let mode = |path: &Path| Some(std::fs::metadata(path).ok()?.permissions().mode() & 0o777);
        let folder = mode(&self.folder)?;
        if folder & OTHERS_WRITE != 0 {
            return Some((self.folder.clone(), folder));
        }
        // Files in a folder that only its owner enters are out of reach, whatever their own mode.
        if folder & OTHERS == 0 {
            return None;
        }
        let files = std::fs::read_dir(&self.folder).ok()?.flatten().map(|entry| entry.path());
        files.filter_map(|path| mode(&path).map(|own| (path, own))).find(|(_, own)| own & OTHERS != 0)
    }

    /// Makes sure that [`Self::copy_to`] can copy: that no other secret has the name of one of these.
    ///
    /// # Errors
    /// Returns an error that names the file, if there is one, or if a file cannot be read.
    pub fn must_fit(&self, other: &Self) -> StoreResult<()> {
        for name in self.names()? {
            let (own, there) = (self.get(&name)?, other.get(&name)?);
            if there.is_some() && there != own {
                let detail = format!(
                    "is another than the one in {}; move it away and keep it, or restore without --with-secrets",
                    self.folder.display()
                );
                return Err(StoreError::Secret { path: other.file(&name), detail });
            }
        }
        Ok(())
    }

    /// Returns the names of the files.
    fn names(&self) -> StoreResult<Vec<String>> {
        let entries = std::fs::read_dir(&self.folder).map_err(|error| failed(&self.folder, &error))?;
        let mut names = Vec::new();
        for entry in entries {
            let name = entry.map_err(|error| failed(&self.folder, &error))?.file_name();
            names.extend(name.to_str().filter(|name| !name.starts_with('.')).map(str::to_owned));
        }
        Ok(names)
    }

    /// Copies every secret to another folder; existing files stay unchanged.
    ///
    /// # Errors
    /// Returns an error if a file cannot be read or written, or if a different secret of the same name exists.
    pub fn copy_to(&self, other: &Self) -> StoreResult<()> {
        for name in self.names()? {
            let content = self.must_get(&name)?;
            if !other.put(&name, &content)? && other.get(&name)?.as_ref() != Some(&content) {
                let detail = "a different secret of this name exists".to_owned();
                return Err(StoreError::Secret { path: other.file(&name), detail });
            }
        }
        Ok(())
    }

    /// Returns whether the folder holds a key of a database: the one that signs receipts, or one of an epoch.
    ///
    /// # Errors
    /// Returns an error if the folder is there and cannot be read.
    pub fn holds_keys(&self) -> StoreResult<bool> {
        let is_key = |name: &String| name == SIGNER || name.starts_with("epoch-");
        Ok(self.folder.exists() && self.names()?.iter().any(is_key))
    }

    /// Returns whether there is a key that signs receipts.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be read.
    pub fn has_signer(&self) -> StoreResult<bool> {
        Ok(self.get(SIGNER)?.is_some())
    }

    /// Returns the key that signs receipts, and creates it if there is none.
    ///
    /// # Errors
    /// Returns an error if the key cannot be read, written or created.
    pub fn signer(&self) -> StoreResult<Signer> {
        self.signer_named(SIGNER)
    }

    /// Returns the signing key in the file of this name, and creates it if there is none.
    ///
    /// # Errors
    /// Returns an error if the key cannot be read, written or created.
    pub fn signer_named(&self, name: &str) -> StoreResult<Signer> {
        if self.get(name)?.is_none() {
            self.put(name, hex(&random_key()?).as_bytes())?;
        }
        let kept = self.must_get(name)?;
        let secret = std::str::from_utf8(&kept).ok().and_then(|text| unhex(text.trim()));
        let remedy = if name == SIGNER { LOST_RECEIPT_KEY } else { "" };
        let unreadable = || StoreError::Secret { path: self.file(name), detail: format!("{UNREADABLE_KEY}{remedy}") };
        Ok(Signer::new(&secret.ok_or_else(unreadable)?))
    }
}

/// What is said of a key that cannot be read.
const UNREADABLE_KEY: &str = "is not 32 bytes of hexadecimal: put the right file back";
/// What is said besides of the key of receipts.
const LOST_RECEIPT_KEY: &str = ", or move it away if the key is lost, and start with serve --new-receipt-key";

/// Returns 32 random bytes from the operating system.
///
/// # Errors
/// Returns an error if the operating system cannot provide them.
pub fn random_key() -> StoreResult<[u8; 32]> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(StoreError::NoRandom)?;
    Ok(bytes)
}

//! Where blobs are: a folder, or a bucket of a server that speaks the protocol of Amazon S3.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use object_store::aws::AmazonS3Builder;
use object_store::local::LocalFileSystem;
use object_store::prefix::PrefixStore;
use object_store::{BackoffConfig, ClientOptions, ObjectStore, RetryConfig};

use crate::store::{StoreError, StoreResult};
use crate::tls::use_tls;

/// Time for one request to a bucket.
const REQUEST: Duration = Duration::from_secs(10);
/// Time to connect to a bucket.
const CONNECT: Duration = Duration::from_secs(3);
/// Time after which a failed request to a bucket is not tried again.
const RETRIES: Duration = Duration::from_secs(6);
/// Number of times that a request to a bucket is tried again.
const MAX_RETRIES: usize = 3;

/// Place of blobs. Its text is a URL without secrets: credentials of a bucket come from the environment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BlobPlace {
    /// Folder, which all nodes reach under this path.
    Folder(PathBuf),
    /// Bucket, and the prefix of its objects, which may be empty.
    Bucket {
        /// Name of the bucket.
        name: String,
        /// Prefix of the names of objects, without a slash at the end.
        prefix: String,
    },
}

/// Variables that give the credentials of a bucket, or say where they come from.
const CREDENTIALS: [&str; 5] = [
    "AWS_ACCESS_KEY_ID",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_SKIP_SIGNATURE",
];

impl BlobPlace {
    /// Says where credentials were looked for, if none are given: the error of a request then tells of a server that
    /// nobody named.
    pub(super) fn credentials_hint(&self) -> &'static str {
        let is_given = |name: &&str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        match self {
            Self::Bucket { .. } if !CREDENTIALS.iter().any(is_given) => {
                " (AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY are not set, so the machine's own credentials were asked for)"
            }
            Self::Folder(_) | Self::Bucket { .. } => "",
        }
    }

    /// Opens the place. A folder that does not exist is created if `creates` says so; a bucket is not asked yet.
    ///
    /// # Errors
    /// Returns an error that may pass if a folder is not there.
    pub(super) fn open(&self, creates: bool) -> StoreResult<Arc<dyn ObjectStore>> {
        let failed = |error: &dyn fmt::Display| StoreError::BlobPlace(format!("{self}: {error}"));
        match self {
            Self::Folder(folder) => {
                if creates {
                    std::fs::create_dir_all(folder).map_err(|error| failed(&error))?;
                } else if !folder.is_dir() {
                    let detail = "there is no such folder: is it mounted?".to_owned();
                    return Err(StoreError::Blobs { place: self.to_string(), detail });
                }
                let files = LocalFileSystem::new_with_prefix(folder).map_err(|error| failed(&error))?;
                Ok(Arc::new(files.with_fsync(true)))
            }
            Self::Bucket { name, prefix } => {
                let retries =
                    RetryConfig { backoff: BackoffConfig::default(), max_retries: MAX_RETRIES, retry_timeout: RETRIES };
                use_tls();
                let bucket = AmazonS3Builder::from_env()
                    .with_bucket_name(name)
                    .with_retry(retries)
                    .with_client_options(client_options())
                    .build()
                    .map_err(|error| failed(&error))?;
                Ok(Arc::new(PrefixStore::new(bucket, prefix.as_str())))
            }
        }
    }
}

/// Returns the options of the HTTP client. They replace those that the builder took from the environment, so the one of
/// these that operators need is read again.
fn client_options() -> ClientOptions {
    let allows_http = std::env::var("AWS_ALLOW_HTTP").is_ok_and(|value| value.eq_ignore_ascii_case("true"));
    ClientOptions::new().with_timeout(REQUEST).with_connect_timeout(CONNECT).with_allow_http(allows_http)
}

impl FromStr for BlobPlace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let remedy = "give the URL of a folder (file:///srv/blobs) or of a bucket (s3://NAME or s3://NAME/PREFIX)";
        let (scheme, rest) = text.split_once("://").ok_or_else(|| remedy.to_owned())?;
        match scheme.to_ascii_lowercase().as_str() {
            "file" if rest.starts_with('/') => Ok(Self::Folder(rest.into())),
            "file" => Err("a folder needs its whole path, with three slashes: file:///srv/blobs".to_owned()),
            "s3" => {
                let (name, prefix) = rest.split_once('/').unwrap_or((rest, ""));
                if name.is_empty() || name.contains(['@', ':', '?']) || prefix.contains(['?', '#']) {
                    return Err(format!(
                        "{remedy}; credentials and the server's address are read from AWS_ACCESS_KEY_ID, \
                                        AWS_SECRET_ACCESS_KEY, AWS_REGION and AWS_ENDPOINT"
                    ));
                }
                Ok(Self::Bucket { name: name.to_owned(), prefix: prefix.trim_matches('/').to_owned() })
            }
            _ => Err(remedy.to_owned()),
        }
    }
}

impl fmt::Display for BlobPlace {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => write!(formatter, "file://{}", folder.display()),
            Self::Bucket { name, prefix } if prefix.is_empty() => write!(formatter, "s3://{name}"),
            Self::Bucket { name, prefix } => write!(formatter, "s3://{name}/{prefix}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_prints_as_it_is_read_and_others_are_refused_with_a_remedy() {
        for text in ["file:///srv/blobs", "s3://grades", "s3://grades/of/lab"] {
            assert_eq!(text.parse::<BlobPlace>().unwrap().to_string(), text);
        }
        assert_eq!("S3://grades/lab/".parse::<BlobPlace>().unwrap().to_string(), "s3://grades/lab");
        for text in ["", "/srv/blobs", "file://blobs", "s3://", "s3://key:secret@grades", "gs://grades", "s3://a?x=1"] {
            let why = text.parse::<BlobPlace>().unwrap_err();
            assert!(why.contains("://") && !why.contains("secret@"), "{text}: {why}");
        }
    }
}

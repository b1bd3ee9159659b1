//! An endpoint for webhooks.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::IntoResponse as _;
use serde_json::Value;

/// An endpoint that keeps what it receives, and answers each message with the next status; the last one stays.
#[derive(Clone)]
pub struct Endpoint {
    pub url: String,
    pub received: Arc<Mutex<Vec<(String, Value)>>>,
    statuses: Arc<Mutex<Vec<u16>>>,
}

impl Endpoint {
    pub async fn start(statuses: &[u16]) -> Self {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}/events?token=in-the-url", listener.local_addr().unwrap());
        let endpoint = Self { url, received: Arc::default(), statuses: Arc::new(Mutex::new(statuses.to_vec())) };
        let router = Router::new().fallback(Self::receive).with_state(endpoint.clone());
        tokio::spawn(async move { axum::serve(listener, router).await.unwrap() });
        endpoint
    }

    #[expect(clippy::unused_async, reason = "a handler is asynchronous")]
    async fn receive(State(own): State<Self>, headers: HeaderMap, body: Bytes) -> axum::response::Response {
        let id = headers["webhook-id"].to_str().unwrap().to_owned();
        assert!(headers["webhook-signature"].to_str().unwrap().starts_with("v1,"));
        own.received.lock().unwrap().push((id, serde_json::from_slice(&body).unwrap()));
        let mut statuses = own.statuses.lock().unwrap();
        let status = if statuses.len() > 1 { statuses.remove(0) } else { statuses[0] };
        let status = StatusCode::from_u16(status).unwrap();
        if status.is_redirection() {
            return (status, [(header::LOCATION, "/elsewhere")]).into_response();
        }
        status.into_response()
    }

    pub fn answer_with(&self, status: u16) {
        *self.statuses.lock().unwrap() = vec![status];
    }

    /// Waits until so many messages came.
    pub async fn wait_for(&self, count: usize) -> Vec<(String, Value)> {
        for _ in 0..3_000 {
            let received = self.received.lock().unwrap().clone();
            if received.len() >= count {
                return received;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        panic!("{count} messages did not come: {:?}", self.received.lock().unwrap());
    }
}

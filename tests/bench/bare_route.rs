//! Bare axum routes to compare the service's own with: `bare_route ADDRESS URL`.
//!
//! `GET /` answers with the bytes of the document at the URL. `POST /grade` reads a body of `/v1/grade` into typed turns
//! with `serde_json`, and answers a constant of the size of a short grade.

use axum::Router;
use axum::body::Bytes;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use axum::routing::{get, post};
use serde::Deserialize;

/// A body as the builders' logs have it.
#[derive(Debug, Deserialize)]
struct Grade {
    task: String,
    turns: Vec<Turn>,
}

#[derive(Debug, Deserialize)]
struct Turn {
    palette: Vec<String>,
    rows: Vec<Vec<i32>>,
}

/// What every body is answered.
const ANSWER: &str = r#"{"task":"walls/10x2x7-raise","suite":"mineceraft@2","reward":1.0,"overall":true}"#;

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(address), Some(url)) = (arguments.next(), arguments.next()) else {
        anyhow::bail!("expected an address to listen on and the URL of a document");
    };
    let document = plumbline::client::without_tls().build()?.get(&url).send().await?.bytes().await?;
    let read = get(async move || ([(header::CONTENT_TYPE, "application/json")], document));
    let router = Router::new().route("/", read).route("/grade", post(grade));
    axum::serve(tokio::net::TcpListener::bind(address).await?, router).await?;
    Ok(())
}

async fn grade(body: Bytes) -> impl IntoResponse {
    let Ok(Grade { task, turns }) = serde_json::from_slice(&body) else {
        return (StatusCode::BAD_REQUEST, "").into_response();
    };
    let entries: usize = turns.iter().map(|turn| turn.rows.len() + turn.palette.len()).sum();
    std::hint::black_box((task, entries));
    ([(header::CONTENT_TYPE, "application/json")], ANSWER).into_response()
}

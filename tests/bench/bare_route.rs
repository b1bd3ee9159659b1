//! A bare axum route that answers with the bytes of a document, to compare the service's own with:
//! `bare_route ADDRESS URL`.

use axum::Router;
use axum::http::header;
use axum::routing::get;

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(address), Some(url)) = (arguments.next(), arguments.next()) else {
        anyhow::bail!("expected an address to listen on and the URL of a document");
    };
    let document = plumbline::client::without_tls().build()?.get(&url).send().await?.bytes().await?;
    let route = get(async move || ([(header::CONTENT_TYPE, "application/json")], document));
    let router = Router::new().route("/", route);
    axum::serve(tokio::net::TcpListener::bind(address).await?, router).await?;
    Ok(())
}

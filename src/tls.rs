//! TLS of HTTP clients.

/// Makes TLS available to HTTP clients of this process. To be called before the first of them is created; later calls
/// do nothing.
pub fn use_tls() {
    // An error says that a provider is installed already.
    let _installed = rustls::crypto::ring::default_provider().install_default();
}

//! Rate limits: how many requests a second an owner of keys may send, and an address without one. What is left is told in headers.

use std::net::{IpAddr, SocketAddr};
use std::num::NonZeroU32;

use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::{IntoResponse, Response};
use governor::clock::{Clock as _, DefaultClock};
use governor::middleware::StateInformationMiddleware;
use governor::state::keyed::DefaultKeyedStateStore;
use governor::{Quota, RateLimiter};

use crate::app::error::{AppError, Kind};

/// Bits of an IPv6 address that name a network: a household or a host has all addresses of one.
const IPV6_NETWORK_BITS: u32 = 64;

/// What limits are set to; 0 for none.
#[derive(Debug, Clone, Copy, Default)]
pub struct RateSettings {
    /// Requests a second with a key.
    pub per_key: u32,
    /// Requests a second from an address without one.
    pub per_address: u32,
    /// Connections open at once from one address, where none is in front.
    pub connections_per_address: usize,
    /// Whether a proxy in front of the service says in `X-Forwarded-For` who asks.
    pub is_behind_proxy: bool,
}

/// The other end of the connection that a request came over.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub SocketAddr);

type Limiter<K> = RateLimiter<K, DefaultKeyedStateStore<K>, DefaultClock, StateInformationMiddleware>;

/// Counts requests by key and by address.
#[derive(Debug)]
pub struct Rates {
    keys: Option<Limiter<String>>,
    addresses: Option<Limiter<IpAddr>>,
    lookups: Option<Limiter<IpAddr>>,
    clock: DefaultClock,
    is_behind_proxy: bool,
}

/// What a client may still send.
#[derive(Debug, Clone, Copy)]
pub struct RateLimitStatus {
    a_second: u32,
    left: u32,
}

/// A request that was refused before it reached its handler.
#[derive(Debug)]
pub struct RateLimited {
    error: AppError,
    status: Option<RateLimitStatus>,
}

impl From<AppError> for RateLimited {
    fn from(error: AppError) -> Self {
        Self { error, status: None }
    }
}

impl IntoResponse for RateLimited {
    fn into_response(self) -> Response {
        let mut response = self.error.into_response();
        if let Some(status) = self.status {
            status.write_to(response.headers_mut());
        }
        response
    }
}

impl Rates {
    /// Nothing counted yet.
    #[must_use]
    pub fn new(settings: RateSettings) -> Self {
        let quota = |a_second| NonZeroU32::new(a_second).map(Quota::per_second);
        Self {
            keys: quota(settings.per_key).map(|quota| RateLimiter::keyed(quota).with_middleware()),
            addresses: quota(settings.per_address).map(|quota| RateLimiter::keyed(quota).with_middleware()),
            lookups: quota(settings.per_address).map(|quota| RateLimiter::keyed(quota).with_middleware()),
            clock: DefaultClock::default(),
            is_behind_proxy: settings.is_behind_proxy,
        }
    }

    /// Counts a request with a live key among those of its owner. None where keys have no limit.
    ///
    /// # Errors
    /// 429 where there were too many.
    pub fn with_key(&self, owner: &str) -> Result<Option<RateLimitStatus>, RateLimited> {
        // The limiter wants a key of its own type, and most are known: what is made is small.
        self.keys.as_ref().map(|limiter| self.count(limiter, &owner.to_owned(), "key")).transpose()
    }

    /// Counts a request without a live key.
    ///
    /// # Errors
    /// 429 where there were too many.
    pub fn without_key(&self, peer: Option<Peer>, headers: &HeaderMap) -> Result<Option<RateLimitStatus>, RateLimited> {
        self.by_address(self.addresses.as_ref(), peer, headers)
    }

    /// Counts a look for a key that is not known, apart from other requests of its address: others there may have keys.
    ///
    /// # Errors
    /// 429 where there were too many.
    pub fn looking_up(&self, peer: Option<Peer>, headers: &HeaderMap) -> Result<(), RateLimited> {
        self.by_address(self.lookups.as_ref(), peer, headers).map(|_| ())
    }

    fn by_address(
        &self,
        limiter: Option<&Limiter<IpAddr>>,
        peer: Option<Peer>,
        headers: &HeaderMap,
    ) -> Result<Option<RateLimitStatus>, RateLimited> {
        let Some(limiter) = limiter else { return Ok(None) };
        let Some(address) = self.address(peer, headers) else { return Ok(None) };
        self.count(limiter, &address, "address").map(Some)
    }

    /// The address that a request is counted under: the client's where a proxy names it, an IPv6 network as one.
    #[must_use]
    pub fn address(&self, peer: Option<Peer>, headers: &HeaderMap) -> Option<IpAddr> {
        let forwarded = || {
            let last = headers.get_all("x-forwarded-for").iter().next_back()?.to_str().ok()?;
            forwarded_address(last.rsplit(',').next()?.trim())
        };
        let named: Option<IpAddr> = self.is_behind_proxy.then(forwarded).flatten();
        named.or(peer.map(|peer| peer.0.ip())).map(network)
    }

    fn count<K: std::hash::Hash + Eq + Clone>(
        &self,
        limiter: &Limiter<K>,
        of: &K,
        what: &str,
    ) -> Result<RateLimitStatus, RateLimited> {
        match limiter.check_key(of) {
            Ok(state) => Ok(RateLimitStatus {
                a_second: state.quota().burst_size().get(),
                left: state.remaining_burst_capacity(),
            }),
            Err(refused) => {
                metrics::counter!("plumbline_rate_limited_total", "by" => what.to_owned()).increment(1);
                let a_second = refused.quota().burst_size().get();
                let wait = refused.wait_time_from(self.clock.now()).as_secs_f64().ceil().max(1.0);
                let detail =
                    format!("more than {a_second} requests a second from this {what}; what was sent may be sent again");
                let error = AppError::new(Kind::RateLimited, detail);
                Err(RateLimited {
                    error: error.retry_after(wait as u32),
                    status: Some(RateLimitStatus { a_second, left: 0 }),
                })
            }
        }
    }

    /// Forgets who has been quiet.
    pub fn evict_idle(&self) {
        if let Some(limiter) = &self.keys {
            limiter.retain_recent();
        }
        for limiter in [&self.addresses, &self.lookups].into_iter().flatten() {
            limiter.retain_recent();
        }
    }
}

impl RateLimitStatus {
    /// Writes it into the headers of an answer.
    pub fn write_to(self, headers: &mut HeaderMap) {
        // Everything is there again a second after the last request, whatever was used.
        let values = [
            (HeaderName::from_static("ratelimit-limit"), self.a_second),
            (HeaderName::from_static("ratelimit-remaining"), self.left),
            (HeaderName::from_static("ratelimit-reset"), 1),
        ];
        for (name, value) in values {
            headers.insert(name, HeaderValue::from(value));
        }
    }
}

/// The address in an entry of X-Forwarded-For, with which some proxies write the port too.
fn forwarded_address(entry: &str) -> Option<IpAddr> {
    let bare = entry.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(entry);
    bare.parse().ok().or_else(|| entry.parse::<SocketAddr>().ok().map(|address| address.ip()))
}

/// Addresses that are likely one client's: an IPv4 address, an IPv6 network.
#[must_use]
pub fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6((v6.to_bits() & !(u128::MAX >> IPV6_NETWORK_BITS)).into()),
        v4 @ IpAddr::V4(_) => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forwarded_addresses_may_have_ports() {
        for entry in ["192.0.2.7", "192.0.2.7:4711"] {
            assert_eq!(forwarded_address(entry), "192.0.2.7".parse().ok(), "{entry}");
        }
        for entry in ["2001:db8::7", "[2001:db8::7]", "[2001:db8::7]:4711"] {
            assert_eq!(forwarded_address(entry), "2001:db8::7".parse().ok(), "{entry}");
        }
        assert_eq!(forwarded_address("unknown"), None);
    }
}

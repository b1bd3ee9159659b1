//! Rate limits: requests per second for each owner of keys, and for each address without a key. Response headers report
//! the remaining requests.

use std::net::{IpAddr, SocketAddr};
use std::num::NonZeroU32;

use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::{IntoResponse, Response};
use governor::clock::{Clock as _, DefaultClock};
use governor::middleware::StateInformationMiddleware;
use governor::state::keyed::DefaultKeyedStateStore;
use governor::{Quota, RateLimiter};

use crate::app::error::{AppError, Kind};

/// Length of an IPv6 network prefix in bits; a household or a host usually has all addresses of one network.
const IPV6_NETWORK_BITS: u32 = 64;

/// Settings of the limits; 0 means no limit.
#[derive(Debug, Clone, Copy, Default)]
pub struct RateSettings {
    /// Requests per second for an owner of keys.
    pub per_key: u32,
    /// Requests per second from an address without a key.
    pub per_address: u32,
    /// Maximum number of open connections from one address; ignored behind a proxy.
    pub connections_per_address: usize,
    /// Whether a proxy in front of the service sets the client's address in `X-Forwarded-For`.
    pub is_behind_proxy: bool,
}

impl RateSettings {
    /// Returns how many connections one address may have open, if all of them together may have `all`.
    #[must_use]
    pub const fn connections_from_one(&self, all: usize) -> usize {
        // All clients behind a proxy share its address.
        if self.is_behind_proxy || self.connections_per_address == 0 { all } else { self.connections_per_address }
    }
}

/// Remote address of the connection of a request.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub SocketAddr);

type Limiter<K> = RateLimiter<K, DefaultKeyedStateStore<K>, DefaultClock, StateInformationMiddleware>;

/// Rate limiters for keys and addresses.
#[derive(Debug)]
pub struct Rates {
    keys: Option<Limiter<String>>,
    addresses: Option<Limiter<IpAddr>>,
    lookups: Option<Limiter<IpAddr>>,
    clock: DefaultClock,
    is_behind_proxy: bool,
}

/// State of a client's rate limit.
#[derive(Debug, Clone, Copy)]
pub struct RateLimitStatus {
    per_second: u32,
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
    /// Returns whether requests come through a proxy, whose headers are believed.
    #[must_use]
    pub const fn is_behind_proxy(&self) -> bool {
        self.is_behind_proxy
    }

    /// Creates the limiters.
    #[must_use]
    pub fn new(settings: RateSettings) -> Self {
        let quota = |per_second| NonZeroU32::new(per_second).map(Quota::per_second);
        Self {
            keys: quota(settings.per_key).map(|quota| RateLimiter::keyed(quota).with_middleware()),
            addresses: quota(settings.per_address).map(|quota| RateLimiter::keyed(quota).with_middleware()),
            lookups: quota(settings.per_address).map(|quota| RateLimiter::keyed(quota).with_middleware()),
            clock: DefaultClock::default(),
            is_behind_proxy: settings.is_behind_proxy,
        }
    }

    /// Counts a request with a live key towards the limit of its owner. Returns `None` if keys have no limit.
    ///
    /// # Errors
    /// Returns an error (429) if the owner exceeds the limit.
    pub fn with_key(&self, owner: &str) -> Result<Option<RateLimitStatus>, RateLimited> {
        // The limiter requires an owned key; the copy is small.
        self.keys.as_ref().map(|limiter| self.count(limiter, &owner.to_owned(), "key")).transpose()
    }

    /// Counts a request without a live key towards the limit of its address. Returns `None` if addresses have no limit
    /// or the address is unknown.
    ///
    /// # Errors
    /// Returns an error (429) if the address exceeds the limit.
    pub fn without_key(&self, peer: Option<Peer>, headers: &HeaderMap) -> Result<Option<RateLimitStatus>, RateLimited> {
        self.by_address(self.addresses.as_ref(), peer, headers)
    }

    /// Counts the lookup of a key that is not known, separately from other requests of the address: other clients there
    /// may have valid keys.
    ///
    /// # Errors
    /// Returns an error (429) if the address exceeds the limit.
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

    /// Returns the address that a request counts towards: the client's address from the proxy if there is one,
    /// otherwise the peer's. An IPv6 address is reduced to its network.
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
                per_second: state.quota().burst_size().get(),
                left: state.remaining_burst_capacity(),
            }),
            Err(refused) => {
                metrics::counter!("plumbline_rate_limited_total", "by" => what.to_owned()).increment(1);
                let per_second = refused.quota().burst_size().get();
                let wait = refused.wait_time_from(self.clock.now()).as_secs_f64().ceil().max(1.0);
                let detail = format!("more than {per_second} requests per second from this {what}; see Retry-After");
                let error = AppError::new(Kind::RateLimited, detail);
                Err(RateLimited {
                    error: error.retry_after(wait as u32),
                    status: Some(RateLimitStatus { per_second, left: 0 }),
                })
            }
        }
    }

    /// Evicts the state of idle clients.
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
    /// Writes the state into the headers of a response.
    pub fn write_to(self, headers: &mut HeaderMap) {
        const LIMIT: HeaderName = HeaderName::from_static("ratelimit-limit");
        const REMAINING: HeaderName = HeaderName::from_static("ratelimit-remaining");
        const RESET: HeaderName = HeaderName::from_static("ratelimit-reset");
        headers.insert(LIMIT, HeaderValue::from(self.per_second));
        headers.insert(REMAINING, HeaderValue::from(self.left));
        // The limit is fully replenished one second after the last request.
        headers.insert(RESET, HeaderValue::from_static("1"));
    }
}

/// Parses the address in an entry of X-Forwarded-For; some proxies append the port.
fn forwarded_address(entry: &str) -> Option<IpAddr> {
    let bare = entry.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(entry);
    bare.parse().ok().or_else(|| entry.parse::<SocketAddr>().ok().map(|address| address.ip()))
}

/// Reduces an address to the part that likely identifies one client: an IPv4 address, or an IPv6 network.
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
    fn without_a_limit_one_address_may_have_all_connections() {
        let limited = |connections_per_address, is_behind_proxy| {
            RateSettings { connections_per_address, is_behind_proxy, ..RateSettings::default() }.connections_from_one(9)
        };
        assert_eq!([limited(3, false), limited(0, false), limited(3, true)], [3, 9, 9]);
    }

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

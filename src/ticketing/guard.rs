//! Where a webhook may go. A URL is somebody's input: without a guard it reaches whatever the server reaches.
//!
//! The host is resolved here, every address is judged, and the attempt connects to the addresses that were judged and no others,
//! so a name that changes its mind between the look and the connection gains nothing.

use futures::future::BoxFuture;
use reqwest::Url;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;

/// Turns a host name and port into addresses.
pub type Resolver = Arc<dyn Fn(String, u16) -> BoxFuture<'static, std::io::Result<Vec<SocketAddr>>> + Send + Sync>;

/// Why a URL is not posted to.
#[derive(Debug, thiserror::Error)]
pub enum GuardError {
    /// Not a URL.
    #[error("{url:?} is not a URL: {reason}")]
    NotAUrl {
        /// What was given.
        url: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Another scheme.
    #[error("the scheme of {url} is {scheme}, but webhooks go to http or https only")]
    Scheme {
        /// The URL.
        url: String,
        /// Its scheme.
        scheme: String,
    },
    /// User name or password in the URL.
    #[error("the URL contains a user name or password: remove it, receivers check the signature instead")]
    Credentials,
    /// No host.
    #[error("{url} has no host")]
    NoHost {
        /// The URL.
        url: String,
    },
    /// The name has no address.
    #[error("cannot resolve {host}: {source}")]
    Resolve {
        /// The name.
        host: String,
        /// The cause.
        source: std::io::Error,
    },
    /// The name has no address.
    #[error("{host} has no address")]
    NoAddress {
        /// The name.
        host: String,
    },
    /// A private address, and the endpoint may not have one.
    #[error("{host} is {address}, which is not a public address: an admin may set allow_private on the endpoint")]
    Private {
        /// The name.
        host: String,
        /// The address.
        address: IpAddr,
    },
    /// An address that no endpoint may have.
    #[error("{host} is {address}, which no receiver can have (link-local, multicast or reserved)")]
    Forbidden {
        /// The name.
        host: String,
        /// The address.
        address: IpAddr,
    },
}

/// What kind of place an address is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// The internet.
    Public,
    /// This machine or a network of the operator.
    Private,
    /// Link-local (cloud metadata lives there), multicast, reserved.
    Forbidden,
}

/// The resolver of the operating system.
pub fn system_resolver() -> Resolver {
    Arc::new(|host, port| Box::pin(async move { Ok(tokio::net::lookup_host((host.as_str(), port)).await?.collect()) }))
}

/// Judges the form of a URL: scheme, host, no credentials. Also what is checked when an endpoint is made.
pub fn parse(url: &str) -> Result<Url, GuardError> {
    let parsed = Url::parse(url).map_err(|e| GuardError::NotAUrl { url: url.into(), reason: e.to_string() })?;
    if !matches!(parsed.scheme(), "http" | "https") {
        return Err(GuardError::Scheme { url: url.into(), scheme: parsed.scheme().into() });
    }
    if !parsed.username().is_empty() || parsed.password().is_some() {
        return Err(GuardError::Credentials);
    }
    if parsed.host_str().is_none_or(str::is_empty) {
        return Err(GuardError::NoHost { url: url.into() });
    }
    Ok(parsed)
}

/// The addresses that may be connected to. One bad address among good ones refuses them all.
pub async fn checked_addresses(
    url: &Url,
    allow_private: bool,
    resolver: &Resolver,
) -> Result<Vec<SocketAddr>, GuardError> {
    let host = url.host_str().unwrap_or_default().to_owned();
    let port = url.port_or_known_default().unwrap_or(443);
    let literal = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    let addresses = match literal {
        Ok(address) => vec![SocketAddr::new(address, port)],
        Err(_) => {
            resolver(host.clone(), port).await.map_err(|source| GuardError::Resolve { host: host.clone(), source })?
        }
    };
    if addresses.is_empty() {
        return Err(GuardError::NoAddress { host });
    }
    for address in &addresses {
        let address = address.ip();
        match reach(address) {
            Reach::Public => {}
            Reach::Private if allow_private => {}
            Reach::Private => return Err(GuardError::Private { host, address }),
            Reach::Forbidden => return Err(GuardError::Forbidden { host, address }),
        }
    }
    Ok(addresses)
}

/// What kind of place `address` is (IANA special-purpose registries).
pub fn reach(address: IpAddr) -> Reach {
    match address {
        IpAddr::V4(v4) => reach_v4(v4),
        IpAddr::V6(v6) => reach_v6(v6),
    }
}

fn reach_v4(address: Ipv4Addr) -> Reach {
    match address.octets() {
        [127, ..] | [10, ..] | [192, 168, ..] => Reach::Private,
        [172, b, ..] if (16..32).contains(&b) => Reach::Private,
        [100, b, ..] if (64..128).contains(&b) => Reach::Private, // carrier-grade NAT
        [198, 18 | 19, ..] => Reach::Private,                     // benchmarking
        [0, ..] | [169, 254, ..] | [224..=255, ..] => Reach::Forbidden,
        [192, 0, 0 | 2, _] | [192, 88, 99, _] | [198, 51, 100, _] | [203, 0, 113, _] => Reach::Forbidden,
        _ => Reach::Public,
    }
}

fn reach_v6(address: Ipv6Addr) -> Reach {
    let s = address.segments();
    let v4 = |high: u16, low: u16| {
        let [[a, b], [c, d]] = [high.to_be_bytes(), low.to_be_bytes()];
        Ipv4Addr::new(a, b, c, d)
    };
    match s {
        [0, 0, 0, 0, 0, 0, 0, 1] => Reach::Private,             // loopback
        [0, 0, 0, 0, 0, 0xffff, h, l] => reach_v4(v4(h, l)),    // IPv4-mapped
        [0x64, 0xff9b, 0, 0, 0, 0, h, l] => reach_v4(v4(h, l)), // NAT64
        [0x2002, h, l, ..] => reach_v4(v4(h, l)),               // 6to4
        [0xfc00..=0xfdff, ..] => Reach::Private,                // unique local
        [0x2001, 0..=0x01ff, ..] | [0x2001, 0xdb8, ..] => Reach::Forbidden, // Teredo and other protocols, documentation
        [0x2000..=0x3fff, ..] => Reach::Public,                 // global unicast
        _ => Reach::Forbidden,                                  // unspecified, link-local, multicast, the unassigned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_place_is_told_apart() {
        let cases = [
            ("8.8.8.8", Reach::Public),
            ("2606:4700::1111", Reach::Public),
            ("127.0.0.1", Reach::Private),
            ("10.1.2.3", Reach::Private),
            ("172.31.255.255", Reach::Private),
            ("172.32.0.1", Reach::Public),
            ("192.168.0.1", Reach::Private),
            ("100.64.0.1", Reach::Private),
            ("100.128.0.1", Reach::Public),
            ("169.254.169.254", Reach::Forbidden),
            ("0.0.0.0", Reach::Forbidden),
            ("224.0.0.1", Reach::Forbidden),
            ("255.255.255.255", Reach::Forbidden),
            ("::1", Reach::Private),
            ("::", Reach::Forbidden),
            ("::ffff:10.0.0.1", Reach::Private),
            ("::ffff:169.254.169.254", Reach::Forbidden),
            ("::ffff:8.8.8.8", Reach::Public),
            ("64:ff9b::7f00:1", Reach::Private),
            ("2002:7f00:1::", Reach::Private),
            ("2001:0:1::", Reach::Forbidden),
            ("fd00::1", Reach::Private),
            ("fe80::1", Reach::Forbidden),
            ("ff02::1", Reach::Forbidden),
        ];
        for (address, expected) in cases {
            assert_eq!(reach(address.parse().unwrap()), expected, "{address}");
        }
    }

    #[tokio::test]
    async fn numbers_in_disguise_are_seen_through() {
        let resolver = system_resolver();
        for url in ["http://0x7f.1/", "http://2130706433/", "http://[::ffff:127.0.0.1]/", "http://017700000001/"] {
            let error = checked_addresses(&parse(url).unwrap(), false, &resolver).await.unwrap_err();
            assert!(matches!(error, GuardError::Private { .. }), "{url}: {error}");
        }
    }

    #[tokio::test]
    async fn one_private_address_among_public_ones_refuses_the_name() {
        let resolver: Resolver = Arc::new(|_, port| {
            Box::pin(async move { Ok(vec![([8, 8, 8, 8], port).into(), ([127, 0, 0, 1], port).into()]) })
        });
        let url = parse("https://two-faced.example/hook").unwrap();
        assert!(checked_addresses(&url, false, &resolver).await.is_err());
        assert_eq!(checked_addresses(&url, true, &resolver).await.unwrap().len(), 2);
    }

    #[test]
    fn other_schemes_and_credentials_are_refused() {
        assert!(matches!(parse("file:///etc/passwd"), Err(GuardError::Scheme { .. })));
        assert!(matches!(parse("https://me:pw@host/"), Err(GuardError::Credentials)));
        assert!(matches!(parse("nonsense"), Err(GuardError::NotAUrl { .. })));
    }
}

//! Public randomness of a drand beacon, which a pool derives from together with the epoch's key: before the committed
//! round is emitted, nobody knows a specification, the operator included.
//!
//! A beacon is a group of servers of different operators that sign the numbers of rounds at fixed times. The signature
//! of a round (BLS over BLS12-381, scheme `bls-unchained-g1-rfc9380`) can neither be known before nor chosen, and
//! anybody can verify it with the public key of the chain.

use drand_verify::{G2PubkeyRfc, Pubkey as _, derive_randomness};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::canonical::{Hash, unhex};
use super::secret::EpochKey;
use crate::tasks::hex;

/// Scheme of the chains that this program verifies.
pub const SCHEME: &str = "bls-unchained-g1-rfc9380";
/// Length of a public key, a point of the second group.
const KEY_BYTES: usize = 96;
/// Length of a signature, a point of the first group.
const SIGNATURE_BYTES: usize = 48;
/// Chain hash of quicknet, the chain of the League of Entropy with a round every three seconds.
const QUICKNET: &str = "52db9ba70e0cc0f6eaf7803dd07447a1f5477735fd3f661792ba94600c84e971";
/// Public key of quicknet.
const QUICKNET_KEY: &str = "83cf0f2896adee7eb8b5f01fcad3912212c437e0073e911fb90022d3e760183c\
                            8c4b450b6a0a6c3ac6a5776a2d1064510d1fec758c921cc22b0e17e63aaf4bcb\
                            5ed66304de9cf809bd274ca73bab4af5a6e9c76a4bc09e76eae8991ef5ece45a";
/// Hash of the group of servers that began quicknet.
const QUICKNET_SEED: &str = "f477d5c89f21a17c863a7f937c6a6d15859414d2be09cd448d4279af331c5d3e";
/// Time of the first round of quicknet, in seconds since 1970.
const QUICKNET_GENESIS: i64 = 1_692_803_367;
/// Seconds between two rounds of quicknet.
const QUICKNET_PERIOD: u32 = 3;

/// A chain of rounds, as its servers describe it (`/CHAIN-HASH/info`).
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Chain {
    /// Public key, in hexadecimal.
    pub public_key: String,
    /// Seconds between two rounds.
    pub period: u32,
    /// Time of the first round, in seconds since 1970.
    pub genesis_time: i64,
    /// Hash that identifies the chain.
    pub hash: String,
    /// Hash of the group of servers that began the chain.
    #[serde(rename = "groupHash")]
    pub genesis_seed: String,
    /// Name of the scheme.
    #[serde(rename = "schemeID")]
    pub scheme: String,
    /// Facts that do not change its rounds.
    #[serde(default)]
    pub metadata: Metadata,
}

/// Facts about a chain that do not change its rounds.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
pub struct Metadata {
    /// Name of the chain among those of the same servers.
    #[serde(rename = "beaconID", default)]
    pub beacon_id: String,
}

/// The round of a chain that an epoch is bound to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Beacon {
    /// Hash that identifies the chain.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub chain_hash: String,
    /// Public key of the chain, in hex: scheme `bls-unchained-g1-rfc9380`.
    #[schema(pattern = "^[0-9a-f]{192}$")]
    pub public_key: String,
    /// Hash of the group of servers that began the chain.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub genesis_seed: String,
    /// Name of the chain among those of the same servers; the chain hash covers it with the other facts.
    pub beacon_id: String,
    /// Time of the chain's first round, seconds since 1970.
    pub genesis_time: i64,
    /// Seconds between two rounds.
    #[schema(minimum = 1)]
    pub period_seconds: u32,
    /// Number of the round, from 1.
    #[schema(minimum = 1)]
    pub round: u64,
}

/// A round as servers publish it (`/CHAIN-HASH/public/ROUND`). Its other members follow from these.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Round {
    /// Number of the round.
    pub round: u64,
    /// Signature of the chain, in hexadecimal.
    pub signature: String,
}

/// Why a round does not do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BeaconFault {
    /// Another round than the committed one.
    #[error("is round {found}, but the epoch is bound to round {committed}")]
    OtherRound {
        /// The given round.
        found: u64,
        /// The committed round.
        committed: u64,
    },
    /// The hash of the chain is not that of its facts.
    #[error("the chain hash {0} is not that of its key, times, group and name")]
    OtherChain(String),
    /// The signature is no signature of the chain for the round.
    #[error("the signature is not that of round {round} of the chain {chain}")]
    BadSignature {
        /// The round.
        round: u64,
        /// Hash of the chain.
        chain: String,
    },
}

impl Chain {
    /// Returns quicknet, the public chain of the League of Entropy.
    #[must_use]
    pub fn quicknet() -> Self {
        Self {
            public_key: QUICKNET_KEY.to_owned(),
            period: QUICKNET_PERIOD,
            genesis_time: QUICKNET_GENESIS,
            hash: QUICKNET.to_owned(),
            genesis_seed: QUICKNET_SEED.to_owned(),
            scheme: SCHEME.to_owned(),
            metadata: Metadata { beacon_id: "quicknet".to_owned() },
        }
    }

    /// Returns the first round that is emitted at a time or later, in milliseconds since 1970.
    ///
    /// # Errors
    /// Returns the reason if this program cannot verify rounds of the chain.
    pub fn first_round_from(&self, at_ms: i64) -> Result<Beacon, String> {
        if self.scheme != SCHEME {
            return Err(format!("the chain has the scheme {:?}: expected {SCHEME:?}", self.scheme));
        }
        let is_key = unhex::<KEY_BYTES>(&self.public_key).is_some_and(|key| G2PubkeyRfc::from_variable(&key).is_ok());
        if !is_key || self.period == 0 {
            return Err("the chain has no valid public key or period".to_owned());
        }
        let since = (at_ms - self.genesis_time.saturating_mul(1_000)).max(0);
        let round = since.cast_unsigned().div_ceil(u64::from(self.period) * 1_000) + 1;
        let beacon = Beacon {
            chain_hash: self.hash.to_ascii_lowercase(),
            public_key: self.public_key.to_ascii_lowercase(),
            genesis_seed: self.genesis_seed.to_ascii_lowercase(),
            beacon_id: self.metadata.beacon_id.clone(),
            genesis_time: self.genesis_time,
            period_seconds: self.period,
            round,
        };
        if !beacon.has_own_hash() {
            return Err(BeaconFault::OtherChain(beacon.chain_hash).to_string());
        }
        if beacon.public_key == QUICKNET_KEY && !beacon.is_public() {
            return Err("the chain has the key of quicknet, but other facts".to_owned());
        }
        Ok(beacon)
    }
}

impl Beacon {
    /// Returns whether the chain is the public one of the League of Entropy.
    #[must_use]
    pub fn is_public(&self) -> bool {
        self.chain_hash == QUICKNET && self.has_own_hash()
    }

    /// Returns whether the chain hash is that of the other facts, as drand computes it.
    #[must_use]
    pub fn has_own_hash(&self) -> bool {
        let (Some(key), Some(seed)) = (unhex::<KEY_BYTES>(&self.public_key), unhex::<32>(&self.genesis_seed)) else {
            return false;
        };
        let facts = Sha256::new()
            .chain_update(self.period_seconds.to_be_bytes())
            .chain_update(self.genesis_time.to_be_bytes())
            .chain_update(key)
            .chain_update(seed);
        // The first chain had no name.
        let name = if self.beacon_id == "default" { "" } else { &self.beacon_id };
        hex(&facts.chain_update(name).finalize()) == self.chain_hash
    }

    /// Returns the time at which the round is emitted, in milliseconds since 1970.
    #[must_use]
    pub fn emitted_at_ms(&self) -> i64 {
        let rounds = i64::try_from(self.round.saturating_sub(1)).unwrap_or(i64::MAX);
        let seconds = rounds.saturating_mul(self.period_seconds.into()).saturating_add(self.genesis_time);
        seconds.saturating_mul(1_000)
    }

    /// Returns whether the round is the first at a time or later, in milliseconds since 1970.
    #[must_use]
    pub fn is_first_from(&self, at_ms: i64) -> bool {
        let emitted_at_ms = self.emitted_at_ms();
        let before_ms = emitted_at_ms.saturating_sub(i64::from(self.period_seconds) * 1_000);
        emitted_at_ms >= at_ms && (before_ms < at_ms || self.round <= 1)
    }

    /// Verifies a round, and returns its randomness: SHA-256 over the signature.
    ///
    /// # Errors
    /// Returns the reason if it is not the committed round, or the chain has not signed it.
    pub fn randomness(&self, round: &Round) -> Result<Hash, BeaconFault> {
        if round.round != self.round {
            return Err(BeaconFault::OtherRound { found: round.round, committed: self.round });
        }
        if !self.has_own_hash() {
            return Err(BeaconFault::OtherChain(self.chain_hash.clone()));
        }
        let bad = || BeaconFault::BadSignature { round: self.round, chain: self.chain_hash.clone() };
        let (Some(key), Some(signature)) =
            (unhex::<KEY_BYTES>(&self.public_key), unhex::<SIGNATURE_BYTES>(&round.signature))
        else {
            return Err(bad());
        };
        let key = G2PubkeyRfc::from_variable(&key).map_err(|_invalid| bad())?;
        match key.verify(self.round, &[], &signature) {
            Ok(true) => Ok(derive_randomness(&signature)),
            _ => Err(bad()),
        }
    }

    /// Returns the key that the pool derives from: of the epoch's key and the randomness, neither alone suffices.
    #[must_use]
    pub fn pool_key(&self, key: &EpochKey, randomness: &Hash) -> EpochKey {
        let parts = [self.chain_hash.as_bytes(), &self.round.to_be_bytes(), randomness];
        EpochKey::new(key.derive("beacon", &parts))
    }
}

/// The pool of an epoch that is bound to a beacon, as it is published right after the round.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct BoundPool {
    /// Name of the epoch.
    pub epoch: String,
    /// Number of the round.
    pub round: u64,
    /// Signature of the round, in hex. Its SHA-256 is the randomness that the pool derives from, with the epoch's key.
    #[schema(pattern = "^[0-9a-f]{96}$")]
    pub signature: String,
    /// Root of the Merkle tree over the salted hashes of all specifications.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub root: String,
    /// Time at which the pool was made, milliseconds since 1970.
    pub made_at_ms: i64,
}

impl BoundPool {
    /// Returns whether this is the round that the pool derives from.
    #[must_use]
    pub fn is_from(&self, round: &Round) -> bool {
        self.round == round.round && self.signature.eq_ignore_ascii_case(&round.signature)
    }

    /// Returns the round that the pool derives from.
    #[must_use]
    pub fn round(&self) -> Round {
        Round { round: self.round, signature: self.signature.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round 123 of the public chain, from the documentation of `drand-verify`.
    const ROUND_123: &str = "b75c69d0b72a5d906e854e808ba7e2accb1542ac355ae486d591aa9d43765482\
                             e26cd02df835d3546d23c4b13e0dfc92";

    fn quicknet(round: u64) -> Beacon {
        Beacon { round, ..Chain::quicknet().first_round_from(0).unwrap() }
    }

    #[test]
    fn a_chain_hash_covers_all_facts() {
        assert!(quicknet(1).is_public());
        for changed in [
            Beacon { genesis_time: 0, ..quicknet(1) },
            Beacon { period_seconds: 30, ..quicknet(1) },
            Beacon { beacon_id: "default".to_owned(), ..quicknet(1) },
            Beacon { genesis_seed: QUICKNET.to_owned(), ..quicknet(1) },
            Beacon { public_key: QUICKNET_KEY.replace('8', "9"), ..quicknet(1) },
        ] {
            assert!(!changed.is_public() && !changed.has_own_hash(), "{changed:?}");
            assert!(matches!(
                changed.randomness(&Round { round: 1, signature: ROUND_123.to_owned() }),
                Err(BeaconFault::OtherChain(_))
            ));
        }
        // The same servers at other times, with a hash that fits.
        let mut moved = Chain { genesis_time: 0, ..Chain::quicknet() };
        assert!(moved.first_round_from(0).unwrap_err().contains("chain hash"));
        let beacon = Beacon { genesis_time: 0, ..quicknet(1) };
        let facts = Sha256::new().chain_update(3_u32.to_be_bytes()).chain_update(0_i64.to_be_bytes());
        let facts =
            facts.chain_update(unhex::<96>(QUICKNET_KEY).unwrap()).chain_update(unhex::<32>(QUICKNET_SEED).unwrap());
        moved.hash = hex(&facts.chain_update(beacon.beacon_id).finalize());
        assert!(moved.first_round_from(0).unwrap_err().contains("the key of quicknet"));
    }

    #[test]
    fn a_round_of_the_public_chain_verifies_and_no_other() {
        let given = Round { round: 123, signature: ROUND_123.to_owned() };
        let randomness = quicknet(123).randomness(&given).unwrap();
        assert_eq!(hex(&randomness), hex(&Sha256::digest(unhex::<48>(ROUND_123).unwrap())));
        let other = BeaconFault::OtherRound { found: 123, committed: 124 };
        assert_eq!(quicknet(124).randomness(&given), Err(other));
        let moved = Round { round: 124, ..given.clone() };
        assert!(matches!(quicknet(124).randomness(&moved), Err(BeaconFault::BadSignature { round: 124, .. })));
        for signature in ["", "zz", &ROUND_123[2..], &ROUND_123.replace('b', "c"), &"00".repeat(48)] {
            let forged = Round { signature: signature.to_owned(), ..given.clone() };
            assert!(quicknet(123).randomness(&forged).is_err(), "{signature}");
        }
    }

    #[test]
    fn rounds_come_at_fixed_times() {
        let genesis = QUICKNET_GENESIS * 1_000;
        let round = |at_ms| Chain::quicknet().first_round_from(at_ms).unwrap();
        for (at_ms, number) in [
            (0, 1),
            (genesis, 1),
            (genesis + 1, 2),
            (genesis + 3_000, 2),
            (genesis + 3_001, 3),
            (genesis + 366_000, 123),
        ] {
            assert_eq!(round(at_ms).round, number, "{at_ms}");
            assert!(round(at_ms).emitted_at_ms() >= at_ms && round(at_ms).is_first_from(at_ms));
            let next = Beacon { round: number + 1, ..round(at_ms) };
            assert!(!next.is_first_from(at_ms), "{at_ms}");
            assert!(number == 1 || !round(at_ms).is_first_from(at_ms + 3_000), "{at_ms}");
        }
        assert_eq!(quicknet(123).emitted_at_ms(), genesis + 366_000);
        assert_eq!(quicknet(u64::MAX).emitted_at_ms(), i64::MAX);
        let chained = Chain { scheme: "pedersen-bls-chained".to_owned(), ..Chain::quicknet() };
        assert!(chained.first_round_from(0).unwrap_err().contains("bls-unchained-g1-rfc9380"));
        assert!(Chain { public_key: "00".to_owned(), ..Chain::quicknet() }.first_round_from(0).is_err());
    }

    #[test]
    fn the_pool_needs_key_and_randomness() {
        let (one, other) = (EpochKey::new([1; 32]), EpochKey::new([2; 32]));
        let keys = [
            quicknet(1).pool_key(&one, &[1; 32]),
            quicknet(1).pool_key(&other, &[1; 32]),
            quicknet(1).pool_key(&one, &[2; 32]),
            quicknet(2).pool_key(&one, &[1; 32]),
        ];
        let distinct: std::collections::BTreeSet<String> = keys.iter().map(EpochKey::expose).collect();
        assert_eq!(distinct.len(), keys.len());
    }
}

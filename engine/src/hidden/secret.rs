//! The key of an epoch: 32 random bytes, from which all draws are derived with HMAC-SHA256.

use std::fmt;

use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::{Digest as _, Sha256};

use super::canonical::{Hash, unhex};
use crate::tasks::hex;

/// The key of an epoch. Its `Debug` output omits the bytes, so that no log line reveals them by accident.
#[derive(Clone, PartialEq, Eq)]
pub struct EpochKey([u8; 32]);

impl fmt::Debug for EpochKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("EpochKey(…)")
    }
}

impl EpochKey {
    /// Creates a key from random bytes.
    #[must_use]
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Reads a key from hexadecimal, or returns `None` if the text is not 32 bytes.
    #[must_use]
    pub fn from_hex(text: &str) -> Option<Self> {
        unhex(text.trim()).map(Self)
    }

    /// Returns the secret key in hexadecimal, to be stored or revealed.
    #[must_use]
    pub fn expose(&self) -> String {
        hex(&self.0)
    }

    /// Returns the hash that is published in advance: SHA-256 over a label and the key.
    #[must_use]
    pub fn hash(&self) -> Hash {
        Sha256::new().chain_update(b"plumbline epoch key\0").chain_update(self.0).finalize().into()
    }

    /// Computes the HMAC-SHA256 over a purpose and its parts, each prefixed with its length, so that different lists of
    /// parts never give the same input.
    #[must_use]
    pub fn derive(&self, purpose: &str, parts: &[&[u8]]) -> Hash {
        // HMAC accepts keys of any length, so this never fails.
        let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(&self.0) else { return [0; 32] };
        for part in [purpose.as_bytes()].iter().chain(parts) {
            mac.update(&(part.len() as u64).to_be_bytes());
            mac.update(part);
        }
        mac.finalize().into_bytes().into()
    }
}

/// A deterministic stream of choices derived from a key.
#[derive(Debug)]
pub struct Choices<'k> {
    key: &'k EpochKey,
    purpose: &'static str,
    parts: Vec<Vec<u8>>,
    drawn: u64,
}

impl<'k> Choices<'k> {
    /// Creates the stream for a purpose and its parts.
    #[must_use]
    pub fn new(key: &'k EpochKey, purpose: &'static str, parts: &[&[u8]]) -> Self {
        Self { key, purpose, parts: parts.iter().map(|part| part.to_vec()).collect(), drawn: 0 }
    }

    /// Returns the next choice among `n`, from 0. It reduces 64 bits, so that no choice is favoured by more than 2^-50
    /// for any `n` in use.
    pub fn choose(&mut self, n: u64) -> u64 {
        let counter = self.drawn.to_be_bytes();
        self.drawn += 1;
        let mut parts: Vec<&[u8]> = self.parts.iter().map(Vec::as_slice).collect();
        parts.push(&counter);
        first_number(&self.key.derive(self.purpose, &parts)) % n.max(1)
    }
}

/// Returns the first eight bytes of a hash as a big-endian number.
#[must_use]
pub const fn first_number(hash: &Hash) -> u64 {
    u64::from_be_bytes([hash[0], hash[1], hash[2], hash[3], hash[4], hash[5], hash[6], hash[7]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_kept_apart_and_purposes_too() {
        let key = EpochKey::new([7; 32]);
        let all = [
            key.derive("salt", &[b"ab", b"c"]),
            key.derive("salt", &[b"a", b"bc"]),
            key.derive("salt", &[b"abc"]),
            key.derive("draw", &[b"abc"]),
            EpochKey::new([8; 32]).derive("draw", &[b"abc"]),
        ];
        assert!(all.iter().enumerate().all(|(i, a)| all[..i].iter().all(|b| a != b)));
    }

    #[test]
    fn a_key_is_read_back_and_never_printed() {
        let key = EpochKey::new([171; 32]);
        assert_eq!(EpochKey::from_hex(&key.expose()).as_ref(), Some(&key));
        assert!(!format!("{key:?}").contains("ab") && EpochKey::from_hex("ab").is_none());
    }

    #[test]
    fn choices_are_even() {
        let key = EpochKey::new([1; 32]);
        let mut choices = Choices::new(&key, "test", &[]);
        let mut counts = [0_u32; 6];
        for _ in 0..6_000 {
            counts[choices.choose(6) as usize] += 1;
        }
        // Six standard deviations.
        assert!(counts.iter().all(|count| count.abs_diff(1_000) < 180), "{counts:?}");
    }
}

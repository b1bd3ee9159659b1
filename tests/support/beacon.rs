//! A chain of a randomness beacon of our own, whose rounds are signed as drand signs them.

use bls12_381::hash_to_curve::{ExpandMsgXmd, HashToCurve};
use bls12_381::{G1Affine, G1Projective, G2Affine, Scalar};
use plumbline_engine::tasks::hex;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

/// Domain of signatures on the first group (RFC 9380).
const DOMAIN: &[u8] = b"BLS_SIG_BLS12381G1_XMD:SHA-256_SSWU_RO_NUL_";
/// Secret key of the chain; a real one is shared by servers that do not trust each other.
const SECRET: u64 = 0x706c_756d_626c_696e;
/// Seed of the group, which no test needs to be real.
const SEED: [u8; 32] = [7; 32];
const PERIOD: u32 = 3;
const GENESIS: i64 = 1_600_000_000;

fn key() -> [u8; 96] {
    G2Affine::from(G2Affine::generator() * Scalar::from(SECRET)).to_compressed()
}

/// Returns the hash that names the chain.
pub fn chain_hash() -> String {
    let facts = Sha256::new().chain_update(PERIOD.to_be_bytes()).chain_update(GENESIS.to_be_bytes());
    hex(&facts.chain_update(key()).chain_update(SEED).chain_update("test").finalize())
}

/// Returns what servers say of the chain.
pub fn info() -> Value {
    json!({
        "public_key": hex(&key()),
        "period": PERIOD,
        "genesis_time": GENESIS,
        "hash": chain_hash(),
        "groupHash": hex(&SEED),
        "schemeID": "bls-unchained-g1-rfc9380",
        "metadata": { "beaconID": "test" },
    })
}

/// Returns a round as servers publish it.
pub fn round(number: u64) -> Value {
    let message = Sha256::digest(number.to_be_bytes());
    let point: G1Projective = HashToCurve::<ExpandMsgXmd<sha2_for_bls::Sha256>>::hash_to_curve(&message[..], DOMAIN);
    let signature = G1Affine::from(point * Scalar::from(SECRET)).to_compressed();
    json!({
        "round": number,
        "randomness": hex(&Sha256::digest(signature)),
        "signature": hex(&signature),
    })
}

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
/// Hash that names the chain.
pub const CHAIN_HASH: &str = "70e5a1b1c0ffee00112233445566778899aabbccddeeff00112233445566aa55";

/// Returns what servers say of the chain.
pub fn info() -> Value {
    let key = G2Affine::from(G2Affine::generator() * Scalar::from(SECRET));
    json!({
        "public_key": hex(&key.to_compressed()),
        "period": 3,
        "genesis_time": 1_600_000_000,
        "hash": CHAIN_HASH,
        "groupHash": "00",
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

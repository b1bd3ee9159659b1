//! Proofs of draws: a verifiable random function (RFC 9381, ECVRF-EDWARDS25519-SHA512-TAI), whose public key an epoch
//! commits to.
//!
//! For each run there is one output, and nobody can find it without the epoch's key, or prove another one. So an
//! entrant can check at once, before the reveal, that the output follows from the committed key and its own nonce.

use ed25519_dalek::{SigningKey, VerifyingKey};
use vrf_rfc9381::ec::edwards25519::tai::{
    EdVrfEdwards25519Tai, EdVrfEdwards25519TaiPublicKey, EdVrfEdwards25519TaiSecretKey,
};
use vrf_rfc9381::{Proof as _, Prover as _, VRF, Verifier as _};

use super::canonical::unhex;
use super::secret::EpochKey;
use crate::tasks::hex;

/// Length of a proof, in bytes.
const PROOF_BYTES: usize = 80;
/// Length of an output, in bytes.
pub const OUTPUT_BYTES: usize = 64;

/// Output of the function for one run. It decides which specifications the run draws.
pub type Output = [u8; OUTPUT_BYTES];

/// What a draw is about; the output depends on all of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawMessage<'a> {
    /// Name of the epoch.
    pub epoch: &'a str,
    /// Identifier of the entry.
    pub entry: &'a str,
    /// Number of the entry's run, from 1.
    pub run: u32,
    /// The entrant's nonce.
    pub nonce: &'a str,
}

impl DrawMessage<'_> {
    /// Returns the input of the function: a label and the parts, a line each. Only the nonce, which is last, may itself
    /// have line breaks.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let Self { epoch, entry, run, nonce } = self;
        format!("plumbline draw\n{epoch}\n{entry}\n{run}\n{nonce}").into_bytes()
    }
}

/// Returns the public key of an epoch's draws, in hexadecimal.
#[must_use]
pub fn public_key(key: &EpochKey) -> String {
    // The function's keys are those of Ed25519 (RFC 9381, section 5.5).
    hex(SigningKey::from_bytes(&seed(key)).verifying_key().as_bytes())
}

/// Computes the output of a draw and its proof, in hexadecimal.
#[must_use]
pub fn prove(key: &EpochKey, message: &DrawMessage<'_>) -> (Output, String) {
    let secret = EdVrfEdwards25519TaiSecretKey::from_slice(&seed(key)).expect("a seed has 32 bytes");
    let proof = secret.prove(&message.bytes()).expect("one of 256 hashes is a point of the curve");
    let output = proof.proof_to_hash(EdVrfEdwards25519Tai.ciphersuite()).expect("a proof has an output");
    (output.into(), hex(&proof.encode_to_pi()))
}

/// Checks a proof, and returns the output that it proves; `None` if it proves nothing.
#[must_use]
pub fn verify(public_key: &str, message: &DrawMessage<'_>, proof: &str) -> Option<Output> {
    let proof: [u8; PROOF_BYTES] = unhex(proof)?;
    let public_key: [u8; 32] = unhex(public_key)?;
    // With a key of small order, whoever made it could prove an output of their choice (RFC 9381, section 5.4.5).
    VerifyingKey::from_bytes(&public_key).ok().filter(|key| !key.is_weak())?;
    let verifier = EdVrfEdwards25519TaiPublicKey::from_slice(&public_key).ok()?;
    EdVrfEdwards25519Tai.verify(&verifier, &message.bytes(), &proof).ok().map(Into::into)
}

/// Derives the seed of the function's secret key.
fn seed(key: &EpochKey) -> [u8; 32] {
    key.derive("vrf", &[])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Examples 16 to 18 of RFC 9381, appendix B.3: secret key, public key, input, proof and output.
    const EXAMPLES: [[&str; 5]; 3] = [
        [
            "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
            "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
            "",
            "8657106690b5526245a92b003bb079ccd1a92130477671f6fc01ad16f26f723f26f8a57ccaed74ee1b190bed1f479d9727d2d0f9b005a6e456a35d4fb0daab1268a1b0db10836d9826a528ca76567805",
            "90cf1df3b703cce59e2a35b925d411164068269d7b2d29f3301c03dd757876ff66b71dda49d2de59d03450451af026798e8f81cd2e333de5cdf4f3e140fdd8ae",
        ],
        [
            "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
            "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
            "72",
            "f3141cd382dc42909d19ec5110469e4feae18300e94f304590abdced48aed5933bf0864a62558b3ed7f2fea45c92a465301b3bbf5e3e54ddf2d935be3b67926da3ef39226bbc355bdc9850112c8f4b02",
            "eb4440665d3891d668e7e0fcaf587f1b4bd7fbfe99d0eb2211ccec90496310eb5e33821bc613efb94db5e5b54c70a848a0bef4553a41befc57663b56373a5031",
        ],
        [
            "c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7",
            "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025",
            "af82",
            "9bc0f79119cc5604bf02d23b4caede71393cedfbb191434dd016d30177ccbf8096bb474e53895c362d8628ee9f9ea3c0e52c7a5c691b6c18c9979866568add7a2d41b00b05081ed0f58ee5e31b3a970e",
            "645427e5d00c62a23fb703732fa5d892940935942101e456ecca7bb217c61c452118fec1219202a0edcf038bb6373241578be7217ba85a2687f7a0310b2df19f",
        ],
    ];

    fn bytes(hexadecimal: &str) -> Vec<u8> {
        (0..hexadecimal.len() / 2).map(|i| u8::from_str_radix(&hexadecimal[2 * i..2 * i + 2], 16).unwrap()).collect()
    }

    #[test]
    fn the_examples_of_the_standard_hold() {
        for [secret, public, input, proof, output] in EXAMPLES {
            let own = EdVrfEdwards25519TaiSecretKey::from_slice(&bytes(secret)).unwrap();
            assert_eq!(hex(&own.prove(&bytes(input)).unwrap().encode_to_pi()), proof);
            let verifier = EdVrfEdwards25519TaiPublicKey::from_slice(&bytes(public)).unwrap();
            let proven = EdVrfEdwards25519Tai.verify(&verifier, &bytes(input), &bytes(proof)).unwrap();
            assert_eq!(hex(&proven), output);
        }
    }

    #[test]
    fn a_proof_holds_for_its_own_draw_and_key_alone() {
        let key = EpochKey::new([7; 32]);
        let message = DrawMessage { epoch: "e", entry: "a", run: 1, nonce: "n\nn" };
        let (output, proof) = prove(&key, &message);
        let public = public_key(&key);
        assert_eq!(verify(&public, &message, &proof), Some(output));
        let others = [
            DrawMessage { epoch: "f", ..message },
            DrawMessage { entry: "b", ..message },
            DrawMessage { run: 2, ..message },
            DrawMessage { nonce: "n", ..message },
        ];
        assert!(others.iter().all(|other| verify(&public, other, &proof).is_none()));
        assert!(verify(&public_key(&EpochKey::new([8; 32])), &message, &proof).is_none());
        for i in 0..proof.len() {
            let mut changed = proof.clone().into_bytes();
            changed[i] = if changed[i] == b'0' { b'1' } else { b'0' };
            let proven = verify(&public, &message, std::str::from_utf8(&changed).unwrap());
            assert!(proven.is_none(), "character {i}");
        }
        for wrong in ["", "00", &proof[2..], &"f".repeat(160), &"0".repeat(160)] {
            assert!(verify(&public, &message, wrong).is_none() && verify(wrong, &message, &proof).is_none(), "{wrong}");
        }
    }
}

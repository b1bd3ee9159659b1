//! Cosignatures of witnesses (C2SP tlog-cosignature): a witness has seen that the log only grew.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use ed25519_dalek::{Signature, VerifyingKey};

use super::note::{Checkpoint, key_id};
use crate::hidden::receipts::Signer;

/// Type of cosignatures.
const COSIGNATURE: u8 = 4;
/// Length of a key after its type.
const KEY_BYTES: usize = 32;

/// A witness whose cosignatures a service takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Witness {
    /// Name of the witness, such as `example.org/witness`.
    pub name: String,
    /// Its key as verifiers take it: name, identifier and key.
    pub key: String,
    public: VerifyingKey,
}

impl Witness {
    /// Reads the key of a witness; `None` if the text is not a valid key.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        let text = text.trim();
        let (name, rest) = text.split_once('+')?;
        let (id, key) = rest.split_once('+')?;
        let key = BASE64_STANDARD.decode(key).ok()?;
        let is_own = id == format!("{:08x}", u32::from_be_bytes(key_id(name, &key)));
        let (kind, public) = key.split_first()?;
        let public: [u8; KEY_BYTES] = public.try_into().ok()?;
        let is_name = !name.is_empty() && !name.contains(char::is_whitespace);
        let public = VerifyingKey::from_bytes(&public).ok()?;
        (*kind == COSIGNATURE && is_own && is_name).then(|| Self {
            name: name.to_owned(),
            key: text.to_owned(),
            public,
        })
    }

    /// Verifies a line with which this witness cosigned a checkpoint. Returns the time, in seconds since 1970.
    #[must_use]
    pub fn cosigned(&self, line: &str, checkpoint: &Checkpoint) -> Option<u64> {
        let signature = line.strip_prefix("— ")?.strip_prefix(&self.name)?.strip_prefix(' ')?;
        let bytes = BASE64_STANDARD.decode(signature).ok()?;
        let (id, rest) = bytes.split_first_chunk::<4>()?;
        let (at_s, signature) = rest.split_first_chunk::<8>()?;
        let at_s = u64::from_be_bytes(*at_s);
        let signature = Signature::from_bytes(signature.try_into().ok()?);
        let key = [&[COSIGNATURE][..], self.public.as_bytes()].concat();
        let is_by = *id == key_id(&self.name, &key);
        let holds = || self.public.verify_strict(signed_text(checkpoint, at_s).as_bytes(), &signature).is_ok();
        (is_by && holds()).then_some(at_s)
    }
}

/// Returns the key that verifies the cosignatures of a witness.
#[must_use]
pub fn witness_key(name: &str, signer: &Signer) -> String {
    let key = [&[COSIGNATURE][..], &signer.public_bytes()].concat();
    let id = u32::from_be_bytes(key_id(name, &key));
    format!("{name}+{id:08x}+{}", BASE64_STANDARD.encode(key))
}

/// Returns the line with which a witness cosigns a checkpoint at a time, in seconds since 1970.
#[must_use]
pub fn cosignature(name: &str, signer: &Signer, checkpoint: &Checkpoint, at_s: u64) -> String {
    let key = [&[COSIGNATURE][..], &signer.public_bytes()].concat();
    let signed = signer.sign_text(signed_text(checkpoint, at_s).as_bytes());
    let signature = [&key_id(name, &key)[..], &at_s.to_be_bytes(), &signed].concat();
    format!("— {name} {}\n", BASE64_STANDARD.encode(signature))
}

fn signed_text(checkpoint: &Checkpoint, at_s: u64) -> String {
    format!("cosignature/v1\ntime {at_s}\n{}", checkpoint.text())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cosignature_is_for_one_checkpoint_by_one_witness() {
        let signer = Signer::new(&[9; 32]);
        let checkpoint = Checkpoint { origin: "log.example/1".to_owned(), size: 7, root: [7; 32] };
        let witness = Witness::read(&witness_key("w.example/1", &signer)).unwrap();
        let line = cosignature("w.example/1", &signer, &checkpoint, 1_000);
        assert_eq!(witness.cosigned(line.trim_end(), &checkpoint), Some(1_000));
        assert_eq!(witness.cosigned(line.trim_end(), &Checkpoint { size: 8, ..checkpoint.clone() }), None);
        let other = Witness::read(&witness_key("w.example/1", &Signer::new(&[8; 32]))).unwrap();
        assert_eq!(other.cosigned(line.trim_end(), &checkpoint), None);
        let renamed = Witness::read(&witness_key("w.example/2", &signer)).unwrap();
        assert_eq!(renamed.cosigned(&line.trim_end().replace("/1 ", "/2 "), &checkpoint), None);
        for wrong in ["", "— w.example/1", "— w.example/1 AAAA", "— w.example/1  x", "w.example/1 AAAA"] {
            assert_eq!(witness.cosigned(wrong, &checkpoint), None, "{wrong}");
        }
    }

    #[test]
    fn keys_of_witnesses_are_told_from_keys_of_logs() {
        let signer = Signer::new(&[9; 32]);
        let key = witness_key("w.example/1", &signer);
        assert_eq!(Witness::read(&format!(" {key}\n")).unwrap().key, key);
        let log = crate::hidden::tlog::note::verifier_key("w.example/1", &signer);
        for wrong in ["", "w.example/1", "w+1+x", &log, &key.replacen('w', "v", 1), &key.replacen('w', "w w", 1)] {
            assert_eq!(Witness::read(wrong), None, "{wrong}");
        }
    }
}

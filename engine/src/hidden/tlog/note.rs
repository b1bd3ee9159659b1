//! Checkpoints of a log: signed notes (C2SP signed-note) with origin, size and root (C2SP tlog-checkpoint).

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use ed25519_dalek::{Signature, VerifyingKey};
use sha2::{Digest as _, Sha256};

use crate::hidden::canonical::{Hash, unhex};
use crate::hidden::receipts::Signer;

/// Type of Ed25519 signatures of notes.
const ED25519: u8 = 1;

/// A checkpoint: the size of a log, and the root of its tree at that size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checkpoint {
    /// Name of the log, which is also the name of its key.
    pub origin: String,
    /// Number of entries.
    pub size: u64,
    /// Root of the tree.
    pub root: Hash,
}

impl Checkpoint {
    /// Returns the text that is signed.
    #[must_use]
    pub fn text(&self) -> String {
        format!("{}\n{}\n{}\n", self.origin, self.size, BASE64_STANDARD.encode(self.root))
    }

    /// Splits a note into its text and its lines of signatures.
    #[must_use]
    pub fn parts(note: &str) -> Option<(String, Vec<&str>)> {
        let (text, signatures) = note.split_once("\n\n")?;
        Some((format!("{text}\n"), signatures.lines().collect()))
    }

    /// Reads the text that is signed, whoever signed it.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        let mut lines = text.lines();
        let (origin, size, root) = (lines.next()?.to_owned(), lines.next()?, lines.next()?);
        Some(Self { origin, size: size.parse().ok()?, root: BASE64_STANDARD.decode(root).ok()?.try_into().ok()? })
    }

    /// Reads a note that one of the trusted Ed25519 keys, in hexadecimal, has signed under the name of the log; `None`
    /// if it is no checkpoint or none of them has.
    #[must_use]
    pub fn verified(note: &str, trusted: &[&str]) -> Option<Self> {
        let (text, signatures) = Self::parts(note)?;
        let read = Self::read(&text)?;
        let signed = |line: &str| {
            let (name, signature) = line.strip_prefix("— ")?.split_once(' ')?;
            let signature = BASE64_STANDARD.decode(signature).ok().filter(|_| name == read.origin)?;
            let (id, signature) = signature.split_first_chunk::<4>()?;
            let signature = Signature::from_bytes(signature.try_into().ok()?);
            let is_by = |key: &&str| {
                let key: Option<[u8; 32]> = unhex(key);
                key.is_some_and(|bytes| {
                    let key = VerifyingKey::from_bytes(&bytes);
                    *id == key_id(name, &[&[ED25519][..], &bytes].concat())
                        && key.is_ok_and(|key| key.verify_strict(text.as_bytes(), &signature).is_ok())
                })
            };
            trusted.iter().any(is_by).then_some(())
        };
        // What is not exactly the text of a checkpoint would be signed as something else.
        let is_exact = read.text() == text;
        (is_exact && signatures.iter().any(|line| signed(line).is_some())).then_some(read)
    }

    /// Signs the checkpoint, and returns the note.
    #[must_use]
    pub fn signed(&self, signer: &Signer) -> String {
        let text = self.text();
        let key = key_bytes(signer);
        let mut signature = key_id(&self.origin, &key).to_vec();
        signature.extend(signer.sign_text(text.as_bytes()));
        format!("{text}\n— {} {}\n", self.origin, BASE64_STANDARD.encode(signature))
    }
}

/// Returns the key that verifies the notes of a log, in the form in which verifiers take it: name, identifier and key.
#[must_use]
pub fn verifier_key(origin: &str, signer: &Signer) -> String {
    let key = key_bytes(signer);
    let id = u32::from_be_bytes(key_id(origin, &key));
    format!("{origin}+{id:08x}+{}", BASE64_STANDARD.encode(key))
}

/// Reads the key of a log; returns its name and the key in hexadecimal, or `None` if the text is not a valid key.
#[must_use]
pub fn read_verifier_key(text: &str) -> Option<(String, String)> {
    let (name, rest) = text.trim().split_once('+')?;
    let (id, key) = rest.split_once('+')?;
    let key = BASE64_STANDARD.decode(key).ok().filter(|key| key.len() == 33 && key[0] == ED25519)?;
    let is_own = format!("{:08x}", u32::from_be_bytes(key_id(name, &key))) == id;
    is_own.then(|| (name.to_owned(), crate::tasks::hex(&key[1..])))
}

/// Returns the name of the log whose first receipt was signed with this key, in hexadecimal: it stays when the key
/// changes.
#[must_use]
pub fn origin(first_key: &str) -> String {
    let digest = crate::tasks::hex(&Sha256::digest(first_key));
    format!("plumbline.log/{}", &digest[..16])
}

fn key_bytes(signer: &Signer) -> Vec<u8> {
    [&[ED25519][..], &signer.public_bytes()].concat()
}

pub(super) fn key_id(name: &str, key: &[u8]) -> [u8; 4] {
    let digest = Sha256::new().chain_update(name).chain_update(b"\n").chain_update(key).finalize();
    [digest[0], digest[1], digest[2], digest[3]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Another implementation of the formats reads and verifies what this one writes.
    #[test]
    fn another_implementation_verifies_a_checkpoint() {
        let signer = Signer::new(&[9; 32]);
        let origin = origin(&signer.public_key());
        let checkpoint = Checkpoint { origin: origin.clone(), size: 1_234, root: [7; 32] };
        let note = checkpoint.signed(&signer);
        let verifier = signed_note::StandardVerifier::new(&verifier_key(&origin, &signer)).unwrap();
        let known = signed_note::VerifierList::new(vec![Box::new(verifier)]);
        let read = signed_note::Note::from_bytes(note.as_bytes()).unwrap();
        assert_eq!(read.verify(&known).unwrap().0.len(), 1);
        let told = tlog_tiles::Checkpoint::from_bytes(read.text()).unwrap();
        assert_eq!((told.origin(), told.size(), told.hash().0), (origin.as_str(), 1_234, [7; 32]));
        let changed = note.replacen("1234", "1235", 1);
        assert!(signed_note::Note::from_bytes(changed.as_bytes()).unwrap().verify(&known).is_err());

        let own = signer.public_key();
        let other = Signer::new(&[8; 32]).public_key();
        assert_eq!(Checkpoint::verified(&note, &[&other, &own]), Some(checkpoint));
        assert_eq!(Checkpoint::verified(&note, &[&other]), None);
        assert_eq!(Checkpoint::verified(&changed, &[&own]), None);
        assert_eq!(read_verifier_key(&verifier_key(&origin, &signer)), Some((origin.clone(), own.clone())));
        assert_eq!(read_verifier_key(&verifier_key(&origin, &signer).replacen("log/", "log/0", 1)), None);
        assert_eq!(Checkpoint::verified(&note.replace("plumbline.log", "another.log"), &[&own]), None);
    }
}

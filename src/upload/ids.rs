//! Ids that the client chooses: the same names and content give the same id on every laptop and in every run.

use sha2::{Digest, Sha256};
use uuid::Uuid;

/// A UUID (version 8) from the SHA-256 of `parts`, each with its length before it so that no two lists run together alike.
///
/// ```
/// use ropescope::upload::ids::derived;
/// assert_eq!(derived("ropeway", &[b"North"]), derived("ropeway", &[b"North"]));
/// assert_ne!(derived("rope", &[b"a", b"bc"]), derived("rope", &[b"ab", b"c"]));
/// ```
pub fn derived(kind: &str, parts: &[&[u8]]) -> Uuid {
    let mut hash = Sha256::new();
    hash.update(b"ropescope ");
    for part in std::iter::once(&kind.as_bytes()).chain(parts) {
        hash.update((part.len() as u64).to_be_bytes());
        hash.update(part);
    }
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&hash.finalize()[..16]);
    uuid::Builder::from_custom_bytes(bytes).into_uuid()
}

//! Documents under signature, so that a person can show years later what the service said: flattened JSON Web Signatures
//! (RFC 7515 with Ed25519, RFC 8037), with the signed document readable beside them.

use base64::Engine;
use base64::prelude::BASE64_URL_SAFE_NO_PAD;
use ring::rand::SystemRandom;
use ring::signature::{ED25519, Ed25519KeyPair, KeyPair, UnparsedPublicKey};
use serde_json::{Value, json};
use std::path::Path;

/// Why a document cannot be trusted.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SignatureError {
    /// The file is no signed document.
    #[error("it is no signed document: {0}")]
    Malformed(&'static str),
    /// The signature is not that of the key.
    #[error("the signature does not fit: the document was changed, or another key signed it")]
    Invalid,
    /// The readable part is not what was signed.
    #[error("the readable document is not the one that was signed: it was changed")]
    Changed,
    /// Another key than the expected one.
    #[error("it was signed with the key {signed}, not with {expected}")]
    OtherKey {
        /// Key of the document.
        signed: String,
        /// Key that was expected.
        expected: String,
    },
}

/// A key that signs.
pub struct SigningKey(Ed25519KeyPair);

impl SigningKey {
    /// A new key in PKCS#8, to be kept secret.
    pub fn generate() -> std::io::Result<Vec<u8>> {
        let key = Ed25519KeyPair::generate_pkcs8(&SystemRandom::new())
            .map_err(|_| std::io::Error::other("the random source of the system failed"))?;
        Ok(key.as_ref().to_vec())
    }

    /// Reads a key.
    pub fn read(path: &Path) -> std::io::Result<Self> {
        let rejected =
            |e: ring::error::KeyRejected| std::io::Error::new(std::io::ErrorKind::InvalidData, e.to_string());
        Ed25519KeyPair::from_pkcs8(&std::fs::read(path)?).map(Self).map_err(rejected)
    }

    /// The public key, base64url as in JWK.
    pub fn public(&self) -> String {
        BASE64_URL_SAFE_NO_PAD.encode(self.0.public_key())
    }

    /// `document` with its signature.
    pub fn sign(&self, document: Value) -> Value {
        let header = json!({"alg": "EdDSA", "jwk": {"kty": "OKP", "crv": "Ed25519", "x": self.public()}});
        let protected = BASE64_URL_SAFE_NO_PAD.encode(header.to_string());
        let payload = BASE64_URL_SAFE_NO_PAD.encode(document.to_string());
        let signature = self.0.sign(format!("{protected}.{payload}").as_bytes());
        json!({
            "document": document,
            "protected": protected,
            "payload": payload,
            "signature": BASE64_URL_SAFE_NO_PAD.encode(signature),
        })
    }
}

/// The document that was signed and the public key that signed it; with `expected`, no other key is accepted.
pub fn verify(signed: &Value, expected: Option<&str>) -> Result<(Value, String), SignatureError> {
    let text = |name| signed[name].as_str().ok_or(SignatureError::Malformed("a part of the signature is missing"));
    let (protected, payload) = (text("protected")?, text("payload")?);
    let decode = |text: &str| {
        BASE64_URL_SAFE_NO_PAD.decode(text).map_err(|_| SignatureError::Malformed("a part is not base64url"))
    };
    let parse = |bytes: Vec<u8>| {
        serde_json::from_slice::<Value>(&bytes).map_err(|_| SignatureError::Malformed("a part is not JSON"))
    };
    let header = parse(decode(protected)?)?;
    let key = header["jwk"]["x"].as_str().filter(|_| header["alg"] == "EdDSA");
    let key = key.ok_or(SignatureError::Malformed("it names no Ed25519 key"))?;
    if let Some(expected) = expected.filter(|expected| *expected != key) {
        return Err(SignatureError::OtherKey { signed: key.into(), expected: expected.into() });
    }
    UnparsedPublicKey::new(&ED25519, decode(key)?)
        .verify(format!("{protected}.{payload}").as_bytes(), &decode(text("signature")?)?)
        .map_err(|_| SignatureError::Invalid)?;
    let document = parse(decode(payload)?)?;
    if signed["document"] != document {
        return Err(SignatureError::Changed);
    }
    Ok((document, key.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key() -> SigningKey {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        std::fs::write(&path, SigningKey::generate().unwrap()).unwrap();
        SigningKey::read(&path).unwrap()
    }

    #[test]
    fn a_signed_document_verifies_also_after_it_was_written_in_another_form() {
        let key = key();
        let document = json!({"frames": 12, "metres": 1.25, "text": "Größe"});
        let signed = key.sign(document.clone());
        let pretty: Value = serde_json::from_str(&serde_json::to_string_pretty(&signed).unwrap()).unwrap();
        assert_eq!(verify(&pretty, None), Ok((document.clone(), key.public())));
        assert_eq!(verify(&pretty, Some(&key.public())), Ok((document, key.public())));
    }

    #[test]
    fn whatever_was_changed_is_found() {
        let key = key();
        let signed = key.sign(json!({"frames": 12}));
        let mut changed = signed.clone();
        changed["document"]["frames"] = json!(13);
        assert_eq!(verify(&changed, None), Err(SignatureError::Changed));
        let other = super::tests::key().sign(json!({"frames": 13}));
        let mut swapped = signed.clone();
        swapped["payload"] = other["payload"].clone();
        swapped["document"] = other["document"].clone();
        assert_eq!(verify(&swapped, None), Err(SignatureError::Invalid));
        assert!(matches!(verify(&other, Some(&key.public())), Err(SignatureError::OtherKey { .. })));
        assert!(matches!(verify(&json!({}), None), Err(SignatureError::Malformed(_))));
    }
}

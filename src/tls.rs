//! The cryptography that outgoing connections use: one provider a process.

/// Makes the cryptography of TLS available to this process; does nothing when it already is.
pub fn install() {
    // An error means that another provider is installed already, which is as good.
    let _ = rustls::crypto::ring::default_provider().install_default();
}

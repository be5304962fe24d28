//! TLS to the broker: the root certificates of the shop, the certificate of this machine, and the password of the user
//! (SHP-23).
//!
//! Invariant: a broker is trusted by the certificates of the file alone, not by those of the system. A secret that
//! everybody can read is refused.

use std::path::Path;
use std::sync::Arc;

use retrace_config::NumberedError;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ClientConfig, RootCertStore};

/// Longest password file.
const MAX_PASSWORD_FILE: u64 = 4096;

/// The client's side of TLS, which trusts these root certificates, and shows its own certificate where it has one: its
/// file, and that of its private key.
///
/// # Errors
/// `E5023` where a file cannot be read, or has no certificate or key; where everybody can read the key.
pub(super) fn client_config(ca: &Path, identity: Option<(&Path, &Path)>) -> Result<Arc<ClientConfig>, NumberedError> {
    let unusable = |why: String| {
        let what = format!("{}: {why}", ca.display());
        NumberedError::new("E5023", what, "name the file of the broker's root certificate, in PEM, as `ca`")
    };
    let mut roots = RootCertStore::empty();
    for certificate in CertificateDer::pem_file_iter(ca).map_err(|error| unusable(error.to_string()))? {
        let certificate = certificate.map_err(|error| unusable(error.to_string()))?;
        roots.add(certificate).map_err(|error| unusable(error.to_string()))?;
    }
    if roots.is_empty() {
        return Err(unusable("it has no certificate".into()));
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| unusable(error.to_string()))?;
    let config = config.with_root_certificates(roots);
    Ok(Arc::new(match identity {
        None => config.with_no_client_auth(),
        Some((certificate, key)) => {
            let unusable = |file: &Path, why: String| {
                let what = format!("{}: {why}", file.display());
                let remedy = "name the files of this machine's certificate and its private key, in PEM: `certificate` \
                    and `key`";
                NumberedError::new("E5023", what, remedy)
            };
            require_private(key).map_err(|why| unusable(key, why))?;
            let chain = CertificateDer::pem_file_iter(certificate).and_then(Iterator::collect);
            let chain: Vec<_> = chain.map_err(|error| unusable(certificate, error.to_string()))?;
            let secret = PrivateKeyDer::from_pem_file(key).map_err(|error| unusable(key, error.to_string()))?;
            config.with_client_auth_cert(chain, secret).map_err(|error| unusable(certificate, error.to_string()))?
        }
    }))
}

/// Checks that not everybody on this computer can read a secret.
fn require_private(path: &Path) -> Result<(), String> {
    let found = std::fs::metadata(path).map_err(|error| error.to_string())?;
    if std::os::unix::fs::MetadataExt::mode(&found) & 0o007 != 0 {
        return Err("everybody on this computer can use it: chmod 600 the file".into());
    }
    Ok(())
}

/// The password in a file: its first line.
///
/// # Errors
/// `E5023` where the file cannot be read, or everybody can read it.
pub(super) fn password(path: &Path) -> Result<String, NumberedError> {
    let unusable = |why: String, remedy: &str| {
        let what = format!("{}: {why}", path.display());
        NumberedError::new("E5023", what, remedy.to_owned())
    };
    let unreadable = |error: std::io::Error| unusable(error.to_string(), "name the password file as `password_file`");
    let found = std::fs::metadata(path).map_err(unreadable)?;
    if std::os::unix::fs::MetadataExt::mode(&found) & 0o007 != 0 {
        return Err(unusable("everybody on this computer can use it".into(), "chmod 600 the file"));
    }
    if found.len() > MAX_PASSWORD_FILE {
        return Err(unusable("it is too long for a password".into(), "name the password file as `password_file`"));
    }
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    Ok(text.lines().next().unwrap_or_default().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_password_file_is_private() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("password");
        assert_eq!(password(&path).expect_err("missing").number, "E5023");
        std::fs::write(&path, "secret\nnot this\n").expect("written");
        let allow = |mode| std::fs::set_permissions(&path, PermissionsExt::from_mode(mode)).expect("changed");
        allow(0o644);
        let refused = password(&path).expect_err("everybody can read it");
        assert!(!refused.to_string().contains("secret"), "{refused}");
        allow(0o600);
        assert_eq!(password(&path).expect("private"), "secret");
    }

    #[test]
    fn a_file_without_a_certificate_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("root.pem");
        assert_eq!(client_config(&path, None).expect_err("missing").number, "E5023");
        for text in ["", "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"] {
            std::fs::write(&path, text).expect("written");
            assert_eq!(client_config(&path, None).expect_err(text).number, "E5023", "{text}");
        }
    }
}

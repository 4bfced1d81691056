//! Trust on a network: the accepted certificate authorities, the program's own certificate, and secrets. Each is read
//! from a file.

use crate::disk;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ClientConfig, RootCertStore};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A certificate, key or secret file that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct TrustError {
    /// Path of the file.
    pub path: PathBuf,
    /// The problem of the file, as a sentence.
    pub problem: String,
}

impl TrustError {
    fn new(path: &Path, problem: impl ToString) -> Self {
        TrustError { path: path.to_owned(), problem: problem.to_string() }
    }
}

/// Returns the password or token in the first line of a file.
///
/// # Errors
/// If the file cannot be read, or its first line is empty.
pub fn secret(file: &Path) -> Result<String, TrustError> {
    let bytes = disk::read(file).map_err(|error| TrustError::new(file, error))?;
    let text = String::from_utf8(bytes).map_err(|_| {
        TrustError::new(
            file,
            "the file is not valid UTF-8 text; \
        save it as UTF-8",
        )
    })?;
    match text.lines().next().map(str::trim_end).filter(|line| !line.is_empty()) {
        Some(secret) => Ok(secret.to_owned()),
        None => Err(TrustError::new(
            file,
            "the first line of the file is empty; write the password or token into this line",
        )),
    }
}

/// Configures a TLS client that accepts only servers with a certificate signed by the authorities in this PEM file.
/// With `own`, the client also presents its own certificate, which is given with its key.
///
/// # Errors
/// If a file cannot be read, or does not contain certificates or a key.
pub fn client_config(authorities: &Path, own: Option<&[PathBuf; 2]>) -> Result<ClientConfig, TrustError> {
    let mut roots = RootCertStore::empty();
    for certificate in certificates(authorities)? {
        roots.add(certificate).map_err(|error| TrustError::new(authorities, error))?;
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| TrustError::new(authorities, error))?
        .with_root_certificates(roots);
    let Some([file, key_file]) = own else { return Ok(builder.with_no_client_auth()) };
    let chain = certificates(file)?;
    let key = disk::read(key_file).map_err(|error| TrustError::new(key_file, error))?;
    let key = PrivateKeyDer::from_pem_slice(&key)
        .map_err(|error| TrustError::new(key_file, format!("the file is not a PEM private key: {error}")))?;
    let failed =
        |error| TrustError::new(file, format!("the certificate cannot be used with its private key: {error}"));
    builder.with_client_auth_cert(chain, key).map_err(failed)
}

fn certificates(file: &Path) -> Result<Vec<CertificateDer<'static>>, TrustError> {
    let bytes = disk::read(file).map_err(|error| TrustError::new(file, error))?;
    let read: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&bytes).collect();
    let all = read.map_err(|error| TrustError::new(file, format!("the file is not a PEM certificate: {error}")))?;
    if all.is_empty() {
        return Err(TrustError::new(
            file,
            "the file contains no certificate in PEM format; give the path of a PEM \
            certificate",
        ));
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_secret_is_the_first_line_of_its_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("token");
        let read = |text: &[u8]| {
            std::fs::write(&file, text).expect("written");
            secret(&file).map_err(|error| error.problem)
        };
        assert_eq!(read(b"pass word\r\nsecond line\n"), Ok("pass word".to_owned()));
        assert_eq!(read(b"alone"), Ok("alone".to_owned()));
        let empty =
            Err("the first line of the file is empty; write the password or token into this line".to_owned());
        assert_eq!([read(b""), read(b"\nsecond\n")], [empty.clone(), empty]);
        assert_eq!(read(&[0xff]), Err("the file is not valid UTF-8 text; save it as UTF-8".to_owned()));
        let missing = secret(&folder.path().join("none")).expect_err("not there");
        assert!(missing.to_string().ends_with("none: No such file or directory (os error 2)"), "{missing}");
    }

    #[test]
    fn files_without_certificates_are_reported() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("ca.pem");
        std::fs::write(&file, "no certificate").expect("written");
        let error = client_config(&file, None).expect_err("nothing in it");
        assert!(
            error.to_string().ends_with(
                "ca.pem: the file contains no certificate in PEM format; give the \
            path of a PEM certificate"
            ),
            "{error}"
        );
        let own = rcgen::generate_simple_self_signed(vec!["server".to_owned()]).expect("a certificate");
        std::fs::write(&file, own.cert.pem()).expect("written");
        assert!(client_config(&file, None).is_ok());
        let error = client_config(&file, Some(&[file.clone(), file.clone()])).expect_err("no key");
        assert!(error.to_string().contains("ca.pem: the file is not a PEM private key"), "{error}");
    }
}

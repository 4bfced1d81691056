//! The page's certificate: a given certificate, or one that the program makes for itself and stores beside its
//! store.

use super::error::PageFileError;
use panelprep_base::disk;
use rcgen::{CertificateParams, KeyPair};
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use sha2::{Digest, Sha256};
use std::io::Write;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::NamedTempFile;

/// The names of the files that the program makes.
const OWN_FILE_NAMES: [&str; 2] = ["page-certificate.pem", "page-key.pem"];

/// The certificate that a server presents in TLS.
pub struct Certificate {
    /// The configuration of the server's side of TLS.
    pub config: Arc<ServerConfig>,
    /// The SHA-256 of the certificate, as browsers show it, if it is the program's own.
    pub fingerprint: Option<String>,
}

/// Reads the certificate that the cell's file names; without one, the program's own, which is made if it is
/// missing.
///
/// # Errors
/// If a file cannot be read or written, or is not a certificate and its key.
pub fn certificate(
    given: Option<&[PathBuf; 2]>,
    folder: &Path,
    listen: SocketAddr,
) -> Result<Certificate, PageFileError> {
    let own = OWN_FILE_NAMES.map(|name| folder.join(name));
    let files = match given {
        Some(files) => files,
        None => {
            if !own.iter().all(|file| file.is_file()) {
                make_certificate(&own, listen)?;
            }
            &own
        }
    };
    let [text, key] = files;
    let read = |file: &Path| disk::read(file).map_err(|error| PageFileError::file_error(file, error));
    let chain: Vec<CertificateDer<'static>> = CertificateDer::pem_slice_iter(&read(text)?)
        .collect::<Result<_, _>>()
        .map_err(|error| PageFileError::file_error(text, format!("the file is not a PEM certificate: {error}")))?;
    let private = PrivateKeyDer::from_pem_slice(&read(key)?)
        .map_err(|error| PageFileError::file_error(key, format!("the file is not a PEM private key: {error}")))?;
    let first = chain.first().ok_or_else(|| PageFileError::file_error(text, "the file contains no certificate"))?;
    let is_own = given.is_none();
    let fingerprint = is_own.then(|| {
        let bytes = Sha256::digest(first.as_ref());
        bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(":")
    });
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, private))
        .map_err(|error| {
            PageFileError::file_error(text, format!("the certificate cannot be used with its private key: {error}"))
        })?;
    Ok(Certificate { config: Arc::new(config), fingerprint })
}

/// Makes a certificate for this computer, for ten years: a browser has to be configured to trust its fingerprint
/// only once.
fn make_certificate([text, key]: &[PathBuf; 2], listen: SocketAddr) -> Result<(), PageFileError> {
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    let mut names = vec![host, "localhost".to_owned(), "127.0.0.1".to_owned()];
    names.extend((!listen.ip().is_unspecified()).then(|| listen.ip().to_string()));
    let failed =
        |error: rcgen::Error| PageFileError::file_error(text, format!("cannot create a certificate: {error}"));
    let pair = KeyPair::generate().map_err(failed)?;
    let mut params = CertificateParams::new(names).map_err(failed)?;
    params.distinguished_name.push(rcgen::DnType::CommonName, "Panelprep operator's page");
    let certificate = params.self_signed(&pair).map_err(failed)?;
    write(key, &pair.serialize_pem())?;
    write(text, &certificate.pem())
}

/// Writes a whole file that only its owner can read.
fn write(file: &Path, text: &str) -> Result<(), PageFileError> {
    let folder = file.parent().unwrap_or(Path::new("."));
    let written = NamedTempFile::new_in(folder).and_then(|mut new| new.write_all(text.as_bytes()).map(|()| new));
    let placed = written.and_then(|new| new.persist(file).map_err(|error| error.error));
    placed.map(drop).map_err(|error| PageFileError::file_error(file, error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_certificate_is_made_once_and_its_key_is_private() {
        let folder = tempfile::tempdir().expect("a folder");
        let listen = SocketAddr::from(([0, 0, 0, 0], 8_443));
        let of = || certificate(None, folder.path(), listen).expect("made").fingerprint.expect("its own");
        let first = of();
        assert_eq!((first.len(), of()), (32 * 3 - 1, first.clone()), "the same after a restart");
        let key = folder.path().join(OWN_FILE_NAMES[1]);
        assert_eq!(std::fs::metadata(&key).expect("there").permissions().mode() & 0o777, 0o600);
        std::fs::write(&key, "no key").expect("written");
        let error = certificate(None, folder.path(), listen).err().expect("refused").to_string();
        assert!(error.contains("page-key.pem") && error.contains("not a PEM private key"), "{error}");
    }
}

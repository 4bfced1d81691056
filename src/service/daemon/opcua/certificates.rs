//! The folder of certificates: the server's own certificate with its key, the certificates of trusted clients, and
//! those of rejected clients. Also the errors because of which the OPC UA server cannot be started.
//!
//! ```text
//! own/cert.der            certificate of the server, created if it is missing; clients must be configured to trust it
//! private/private.pem     key of this certificate; no other program may read it
//! trusted/*.der           certificates of clients that may connect: a person moves them here
//! rejected/*.der          certificates of clients that were rejected; only the newest ones are kept
//! ```

use opcua::crypto::{CertificateStore, KeySize, PrivateKey, PublicKey, X509, X509Data};
use std::collections::BTreeSet;
use std::fs;
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The server's own certificate; the path is relative to the folder of certificates.
pub(super) const OWN_CERTIFICATE: &str = "own/cert.der";
/// Its key.
pub(super) const KEY_PATH: &str = "private/private.pem";
/// Folder of the certificates of trusted clients.
pub(super) const TRUSTED_FOLDER: &str = "trusted";
/// Folder of the certificates of rejected clients.
pub(super) const REJECTED_FOLDER: &str = "rejected";
/// Maximum number of rejected certificates that are kept, so that a client that sends new certificates continuously
/// cannot fill the disk.
const MAX_REJECTED: usize = 32;
/// Validity of the server's certificate, days: ten years, because each client must be configured to trust a new one.
const VALIDITY_DAYS: u32 = 3_650;
const KEY_BITS: u32 = 2_048;

/// Creates the missing folders, and the server's own certificate if it is missing. Returns the SHA-1 thumbprint of the
/// certificate in the form in which OPC UA clients show it.
///
/// # Errors
/// If the disk cannot be written, or a file is not a certificate.
pub(super) fn prepare(folder: &Path, application_uri: &str, hosts: &[String]) -> Result<String, OpcUaError> {
    for name in ["own", "private", TRUSTED_FOLDER, REJECTED_FOLDER] {
        let path = folder.join(name);
        fs::create_dir_all(&path).map_err(|error| OpcUaError::file_error(&path, error))?;
    }
    let private = folder.join("private");
    fs::set_permissions(&private, Permissions::from_mode(0o700))
        .map_err(|error| OpcUaError::file_error(&private, error))?;
    let (own, key) = (folder.join(OWN_CERTIFICATE), folder.join(KEY_PATH));
    match (own.is_file(), key.is_file()) {
        (true, true) => {}
        (false, false) => make_certificate((&own, &key), application_uri, hosts)?,
        (true, false) => {
            return Err(OpcUaError::file_error(
                &key,
                "the file is missing; put the key of own/cert.der there, or remove own/cert.der",
            ));
        }
        (false, true) => {
            return Err(OpcUaError::file_error(
                &own,
                "the file is missing; put the certificate of the key there, or remove private/private.pem",
            ));
        }
    }
    for file in [&own, &key] {
        panelprep_base::disk::read(file).map_err(|error| OpcUaError::file_error(file, error))?;
    }
    let private = CertificateStore::read_pkey(&key)
        .map_err(|_| OpcUaError::file_error(&key, "the file is not a PEM private key (RSA, PKCS #8)"))?;
    let certificate = CertificateStore::read_cert(&own)
        .map_err(|_| OpcUaError::file_error(&own, "the file is not a DER certificate"))?;
    let public = certificate.public_key().map_err(|error| OpcUaError::file_error(&own, error))?;
    let belong_together =
        is_matching_key(&private, &public).map_err(|problem| OpcUaError::file_error(&key, problem))?;
    if !belong_together {
        return Err(OpcUaError::file_error(&key, "the key does not belong to the certificate own/cert.der"));
    }
    Ok(certificate.thumbprint().as_hex_string())
}

/// Returns whether the private key belongs to the public key: signs a text and verifies the signature.
fn is_matching_key(private: &PrivateKey, public: &PublicKey) -> Result<bool, String> {
    if private.size() * 8 < KEY_BITS as usize {
        return Err(format!("the key has {} bits (minimum {KEY_BITS} bits)", private.size() * 8));
    }
    let mut signature = vec![0; private.size()];
    private.sign_sha256(b"probe", &mut signature).map_err(|error| error.to_string())?;
    Ok(public.verify_sha256(b"probe", &signature).unwrap_or(false))
}

/// The trusted certificate files that were already checked, each with its modification time.
#[derive(Debug, Default)]
pub(super) struct TrustedFiles {
    known_files: BTreeSet<(PathBuf, SystemTime)>,
}

impl TrustedFiles {
    /// Renames new client certificates to the file names that async-opcua expects. A person may add a certificate with
    /// any file name, or in PEM format; it is renamed or converted. Returns the result for each new file, for the log.
    /// The call blocks while it waits for the disk.
    pub fn rename_new_certificates(&mut self, folder: &Path) -> Vec<String> {
        let trusted = folder.join(TRUSTED_FOLDER);
        let found = fs::read_dir(&trusted).into_iter().flatten().flatten();
        let files = found.filter_map(|entry| {
            let about = entry.metadata().ok().filter(fs::Metadata::is_file)?;
            Some((entry.path(), about.modified().ok()?))
        });
        let now: BTreeSet<(PathBuf, SystemTime)> = files.collect();
        let rejected =
            now.difference(&self.known_files).filter_map(|(file, _)| rename_certificate(file, &trusted)).collect();
        self.known_files = now;
        rejected
    }
}

/// Renames a certificate to the file name that async-opcua expects; returns a message if the file was renamed or is not
/// a certificate.
fn rename_certificate(file: &Path, trusted: &Path) -> Option<String> {
    let read = panelprep_base::disk::read(file).ok();
    let certificate = read.and_then(|bytes| X509::from_der(&bytes).or_else(|_| X509::from_pem(&bytes)).ok());
    let Some(certificate) = certificate else {
        return Some(format!(
            "{}: the file is not a certificate; no client is trusted by this file",
            file.display()
        ));
    };
    let name = trusted.join(CertificateStore::cert_file_name(&certificate));
    if file == name {
        return None;
    }
    let der = certificate.to_der().map_err(|error| error.to_string());
    let placed = der.and_then(|der| {
        fs::write(&name, der).and_then(|()| fs::remove_file(file)).map_err(|error| error.to_string())
    });
    Some(match placed {
        Ok(()) => format!("{} is trusted now, and the file was renamed to {}", file.display(), name.display()),
        Err(problem) => format!("{}: {problem}", file.display()),
    })
}

/// Creates a certificate for this computer and its key. Both are first written to a temporary folder, and the key's
/// permissions are set before the key is moved to its final place.
fn make_certificate((own, key): (&Path, &Path), application_uri: &str, hosts: &[String]) -> Result<(), OpcUaError> {
    let data = X509Data {
        key_size: KEY_BITS,
        common_name: "Panelprep".to_owned(),
        organization: "Panelprep".to_owned(),
        organizational_unit: String::new(),
        country: String::new(),
        state: String::new(),
        alt_host_names: X509Data::alt_host_names(application_uri, Some(hosts.to_vec()), false, false, false),
        certificate_duration_days: VALIDITY_DAYS,
    };
    let folder = key.parent().unwrap_or(Path::new("."));
    let beside = tempfile::tempdir_in(folder).map_err(|error| OpcUaError::file_error(folder, error))?;
    let [new_own, new_key] = ["cert.der", "private.pem"].map(|name| beside.path().join(name));
    CertificateStore::create_certificate_and_key(&data, false, &new_own, &new_key)
        .map_err(|problem| OpcUaError::file_error(own, format!("cannot create a certificate: {problem}")))?;
    let placed = fs::set_permissions(&new_key, Permissions::from_mode(0o600))
        .and_then(|()| fs::rename(&new_key, key))
        .and_then(|()| fs::rename(&new_own, own));
    placed.map_err(|error| OpcUaError::file_error(own, error))
}

/// Detects new files in the folder of rejected clients.
#[derive(Debug, Default)]
pub(super) struct RejectedFiles {
    known_files: BTreeSet<PathBuf>,
    is_listed_once: bool,
}

impl RejectedFiles {
    /// Returns the files that were added since the last call; removes the oldest files above the maximum number. Files
    /// that existed when the service started are not new. The call blocks while it waits for the disk.
    pub fn take_new_files(&mut self, folder: &Path) -> Vec<PathBuf> {
        let mut found: Vec<(SystemTime, PathBuf)> = fs::read_dir(folder.join(REJECTED_FOLDER))
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|entry| Some((entry.metadata().and_then(|data| data.modified()).ok()?, entry.path())))
            .collect();
        found.sort();
        let surplus = found.len().saturating_sub(MAX_REJECTED);
        for (_, old) in found.drain(..surplus) {
            if let Err(error) = fs::remove_file(&old) {
                tracing::warn!("{}: {error}", old.display());
            }
        }
        let now: BTreeSet<PathBuf> = found.into_iter().map(|(_, path)| path).collect();
        let new = now.difference(&self.known_files).cloned().collect();
        self.known_files = now;
        if std::mem::replace(&mut self.is_listed_once, true) { new } else { Vec::new() }
    }
}

/// Describes a certificate for a person who must decide whether to trust it.
pub(super) fn describe_certificate(file: &Path) -> String {
    let name = |certificate: &X509| {
        let subject: String = certificate.subject_name().chars().filter(|c| !c.is_control()).take(120).collect();
        format!("{subject}, SHA-1 {}", certificate.thumbprint().as_hex_string())
    };
    CertificateStore::read_cert(file)
        .map_or_else(|_| "a file that is not a certificate".to_owned(), |found| name(&found))
}

/// Error: a file or folder of certificates cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("certificate file {}: {problem}; [opcua] certificates sets the folder", file.display())]
pub struct OpcUaError {
    /// The file.
    pub file: PathBuf,
    /// The problem.
    pub problem: String,
}

impl OpcUaError {
    pub(super) fn file_error(file: &Path, problem: impl ToString) -> Self {
        OpcUaError { file: file.to_owned(), problem: problem.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_certificate_is_made_once_and_its_key_is_private() {
        let folder = tempfile::tempdir().expect("a folder");
        let hosts = ["localhost".to_owned(), "127.0.0.1".to_owned()];
        let of = || prepare(folder.path(), "urn:panelprep:test", &hosts);
        let first = of().expect("made");
        assert_eq!((first.len(), of().expect("read")), (40, first.clone()), "the same after a restart");
        let mode = |name: &str| fs::metadata(folder.path().join(name)).expect("there").permissions().mode() & 0o777;
        assert_eq!((mode(KEY_PATH), mode("private")), (0o600, 0o700));
        let own = CertificateStore::read_cert(&folder.path().join(OWN_CERTIFICATE)).expect("a certificate");
        assert!(
            own.is_application_uri_valid("urn:panelprep:test").is_ok()
                && own.is_hostname_valid("localhost").is_ok()
        );
        assert_eq!(
            fs::read_dir(folder.path().join("private")).expect("there").count(),
            1,
            "nothing is left beside it"
        );
        fs::write(folder.path().join(KEY_PATH), "no key").expect("written");
        let error = of().expect_err("refused").to_string();
        assert!(error.contains("private.pem") && error.contains("not a PEM private key"), "{error}");
        fs::remove_file(folder.path().join(KEY_PATH)).expect("removed");
        let error = of().expect_err("refused").to_string();
        assert!(
            error.contains("private.pem: the file is missing"),
            "a lost key is reported, and no new certificate is made: {error}"
        );
    }

    #[test]
    fn a_key_of_another_certificate_is_refused() {
        let folders = [0; 2].map(|_| tempfile::tempdir().expect("a folder"));
        let of =
            |folder: &tempfile::TempDir| prepare(folder.path(), "urn:panelprep:test", &["localhost".to_owned()]);
        folders.iter().for_each(|folder| drop(of(folder).expect("made")));
        let [from, to] = [&folders[0], &folders[1]].map(|folder| folder.path().join(KEY_PATH));
        fs::copy(from, to).expect("copied");
        let error = of(&folders[1]).expect_err("refused").to_string();
        assert!(error.contains("private.pem: the key does not belong to the certificate own/cert.der"), "{error}");
    }

    /// A certificate with any file name is renamed correctly; a file that is not a certificate is reported once.
    #[test]
    fn a_trusted_certificate_may_have_any_name() {
        let folder = tempfile::tempdir().expect("a folder");
        prepare(folder.path(), "urn:panelprep:test", &["localhost".to_owned()]).expect("made");
        let trusted = folder.path().join(TRUSTED_FOLDER);
        fs::copy(folder.path().join(OWN_CERTIFICATE), trusted.join("line.crt")).expect("copied");
        fs::write(trusted.join("notes.txt"), "ask Ada").expect("written");
        let mut seen = TrustedFiles::default();
        let mut results = seen.rename_new_certificates(folder.path());
        results.sort();
        let [line, notes] = &results[..] else { panic!("{results:?}") };
        assert!(
            line.contains("line.crt is trusted now, and the file was renamed to ")
                && notes.contains("notes.txt: the file is not a certificate")
        );
        let certificate = CertificateStore::read_cert(&folder.path().join(OWN_CERTIFICATE)).expect("a certificate");
        let named = trusted.join(CertificateStore::cert_file_name(&certificate));
        assert!(named.is_file() && !trusted.join("line.crt").exists());
        assert_eq!(seen.rename_new_certificates(folder.path()), Vec::<String>::new());
    }

    #[test]
    fn the_number_of_rejected_certificates_is_limited() {
        let folder = tempfile::tempdir().expect("a folder");
        let rejected = folder.path().join(REJECTED_FOLDER);
        fs::create_dir(&rejected).expect("made");
        let mut seen = RejectedFiles::default();
        fs::write(rejected.join("old.der"), "").expect("written");
        assert_eq!(seen.take_new_files(folder.path()), Vec::<PathBuf>::new(), "it was there before");
        for number in 0..100 {
            fs::write(rejected.join(format!("{number:03}.der")), "").expect("written");
        }
        assert_eq!(seen.take_new_files(folder.path()).len(), MAX_REJECTED);
        assert_eq!(fs::read_dir(&rejected).expect("there").count(), MAX_REJECTED);
        assert_eq!(seen.take_new_files(folder.path()), Vec::<PathBuf>::new());
    }
}

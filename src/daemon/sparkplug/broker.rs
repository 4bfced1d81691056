//! How the broker is reached: address, TLS, user and password. The files are read once, when the service starts.

use super::error::SparkplugError;
use crate::cell::{BrokerTls, SparkplugNode};
use crate::disk;
use crate::sparkplug::Message;
use rumqttc::{LastWill, MqttOptions, QoS, TlsConfiguration, Transport};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ClientConfig, RootCertStore};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// A connection that is silent for so long is asked whether it lives; the broker tells the death after one and a half times that.
const KEEP_ALIVE: Duration = Duration::from_secs(10);
/// The largest message that is taken from the broker, and the largest that is sent, in bytes. A command is far smaller.
const MOST_BYTES: [usize; 2] = [16 * 1_024, 256 * 1_024];

/// How the broker is reached.
#[derive(Clone)]
pub(super) struct Broker {
    /// Its address and port, for people.
    pub address: String,
    options: MqttOptions,
}

impl Broker {
    /// Reads what `[sparkplug]` names.
    ///
    /// # Errors
    /// Where a file cannot be read or is not what it must be.
    pub fn read(node: &SparkplugNode) -> Result<Self, SparkplugError> {
        let client_id = format!("{}/{}", node.group_id, node.edge_node_id);
        let mut options = MqttOptions::new(client_id, node.broker.clone(), node.port);
        options
            .set_keep_alive(KEEP_ALIVE)
            .set_clean_session(true)
            .set_max_packet_size(MOST_BYTES[0], MOST_BYTES[1]);
        if let Some(tls) = &node.tls {
            let config = TlsConfiguration::Rustls(Arc::new(client_config(tls)?));
            options.set_transport(Transport::Tls(config));
        }
        if let Some((user, file)) = &node.login {
            options.set_credentials(user.clone(), password(file)?);
        }
        Ok(Broker { address: format!("{}:{}", node.broker, node.port), options })
    }

    /// How to connect with this will.
    pub fn options(&self, will: Message) -> MqttOptions {
        let mut options = self.options.clone();
        options.set_last_will(LastWill::new(will.topic, will.payload, quality(will.qos), false));
        options
    }
}

/// The quality of service by its number.
pub(super) fn quality(qos: u8) -> QoS {
    if qos == 0 { QoS::AtMostOnce } else { QoS::AtLeastOnce }
}

/// A password is the first line of its file.
fn password(file: &Path) -> Result<String, SparkplugError> {
    let bytes = disk::read(file).map_err(|error| SparkplugError::file(file, error))?;
    let text = String::from_utf8(bytes).map_err(|_| SparkplugError::file(file, "it is no UTF-8 text"))?;
    match text.lines().next().filter(|line| !line.is_empty()) {
        Some(password) => Ok(password.to_owned()),
        None => Err(SparkplugError::file(file, "its first line is empty; write the password there")),
    }
}

fn client_config(tls: &BrokerTls) -> Result<ClientConfig, SparkplugError> {
    let authority = &tls.ca_certificate;
    let mut roots = RootCertStore::empty();
    for certificate in certificates(authority)? {
        roots.add(certificate).map_err(|error| SparkplugError::file(authority, error))?;
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| SparkplugError::file(authority, error))?
        .with_root_certificates(roots);
    let Some([file, key_file]) = &tls.own else { return Ok(builder.with_no_client_auth()) };
    let chain = certificates(file)?;
    let key = disk::read(key_file).map_err(|error| SparkplugError::file(key_file, error))?;
    let key = PrivateKeyDer::from_pem_slice(&key)
        .map_err(|error| SparkplugError::file(key_file, format!("it is no PEM private key: {error}")))?;
    let failed = |error| SparkplugError::file(file, format!("it cannot be shown with this key: {error}"));
    builder.with_client_auth_cert(chain, key).map_err(failed)
}

fn certificates(file: &Path) -> Result<Vec<CertificateDer<'static>>, SparkplugError> {
    let bytes = disk::read(file).map_err(|error| SparkplugError::file(file, error))?;
    let read: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&bytes).collect();
    let all = read.map_err(|error| SparkplugError::file(file, format!("it is no PEM certificate: {error}")))?;
    if all.is_empty() {
        return Err(SparkplugError::file(file, "it holds no PEM certificate"));
    }
    Ok(all)
}

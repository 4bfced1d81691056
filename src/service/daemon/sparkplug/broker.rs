//! How the broker is reached: address, TLS, user and password. The files are read again for each connection.

use panelprep_base::trust::{self, TrustError};
use panelprep_cell::cell::SparkplugNode;
use panelprep_interfaces::sparkplug::Message;
use rumqttc::{LastWill, MqttOptions, QoS, TlsConfiguration, Transport};
use std::sync::Arc;

/// Time without data after which a connection is checked, s; the broker reports the node's death after one and a half
/// times this time.
const KEEP_ALIVE_S: u16 = 10;
/// Largest message that is accepted from the broker, and largest message that is sent, in bytes. A command is far
/// smaller.
const MAX_BYTES: [usize; 2] = [16 * 1_024, 256 * 1_024];

/// How the broker is reached.
pub(super) struct BrokerConnection {
    options: MqttOptions,
}

impl BrokerConnection {
    /// Reads the files that `[sparkplug]` names.
    ///
    /// # Errors
    /// If a file cannot be read or is not valid.
    pub fn read(node: &SparkplugNode) -> Result<Self, TrustError> {
        let client_id = format!("{}/{}", node.group_id, node.edge_node_id);
        let mut options = MqttOptions::new(client_id, (node.broker.clone(), node.port));
        options
            .set_keep_alive(KEEP_ALIVE_S)
            .set_clean_session(true)
            .set_max_packet_size(MAX_BYTES[0], MAX_BYTES[1]);
        if let Some(tls) = &node.tls {
            let config = trust::client_config(&tls.ca_certificate, tls.client_certificate.as_ref())?;
            let config = TlsConfiguration::Rustls(Arc::new(config));
            options.set_transport(Transport::Tls(config));
        }
        if let Some((user, file)) = &node.login {
            options.set_credentials(user.clone(), trust::secret(file)?);
        }
        Ok(BrokerConnection { options })
    }

    /// Returns the options for a connection with this will.
    pub fn connection_options(&self, will: Message) -> MqttOptions {
        let mut options = self.options.clone();
        options.set_last_will(LastWill::new(will.topic, will.payload, quality(will.qos), false));
        options
    }
}

/// Returns the quality of service with this number.
pub(super) fn quality(qos: u8) -> QoS {
    if qos == 0 { QoS::AtMostOnce } else { QoS::AtLeastOnce }
}

//! A connection to a broker.

use super::error::BrokerError;
use crate::cell::{Broker, BrokerLogin};
use crate::trust;
use async_nats::jetstream::{self, Context};
use async_nats::{Client, ConnectOptions};
use std::time::Duration;

/// An answer that takes longer is none.
const PATIENCE: Duration = Duration::from_secs(5);
/// Messages on their way without an acknowledgement.
const IN_FLIGHT: usize = 1_024;

#[derive(Debug, Clone)]
pub(super) struct Link {
    pub address: String,
    pub client: Client,
    pub context: Context,
}

impl Link {
    /// Connects once. Whoever loses the connection makes a new one, so that nothing of an old one is taken for an answer.
    pub async fn connect(broker: &Broker, name: &str) -> Result<Self, BrokerError> {
        let options = ConnectOptions::new()
            .name(name)
            .connection_timeout(PATIENCE)
            .request_timeout(Some(PATIENCE))
            .ping_interval(Duration::from_secs(10))
            .max_reconnects(1);
        let options = match &broker.ca {
            Some(file) => options.add_root_certificates(file.clone()),
            None => options,
        };
        let options = options.require_tls(broker.address.starts_with("tls://"));
        let options = login(options, &broker.login).await?;
        let failed = |problem: String| BrokerError::Connect { address: broker.address.clone(), problem };
        let client = options.connect(&broker.address).await.map_err(|error| failed(error.to_string()))?;
        let context = jetstream::ContextBuilder::new()
            .timeout(PATIENCE)
            .ack_timeout(PATIENCE)
            .max_ack_inflight(IN_FLIGHT)
            .backpressure_on_inflight(true)
            .build(client.clone());
        Ok(Link { address: broker.address.clone(), client, context })
    }

    pub fn failed(&self, doing: &'static str, problem: impl ToString) -> BrokerError {
        BrokerError::Failed { address: self.address.clone(), doing, problem: problem.to_string() }
    }
}

async fn login(options: ConnectOptions, login: &BrokerLogin) -> Result<ConnectOptions, BrokerError> {
    match login {
        BrokerLogin::Anybody => Ok(options),
        BrokerLogin::Credentials(path) => options
            .credentials_file(path)
            .await
            .map_err(|error| BrokerError::Login { path: path.clone(), problem: error.to_string() }),
        BrokerLogin::Password { user, file } => {
            let password = trust::secret(file)
                .map_err(|error| BrokerError::Login { path: error.path, problem: error.problem })?;
            Ok(options.user_and_password(user.clone(), password))
        }
    }
}

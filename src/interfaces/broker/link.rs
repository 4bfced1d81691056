//! A connection to a broker.

use super::error::BrokerError;
use async_nats::jetstream::{self, Context};
use async_nats::{Client, ConnectOptions, Event};
use panelprep_base::trust::{self, TrustError};
use panelprep_cell::cell::{Broker, BrokerLogin};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// The time limit for an answer; a later one does not count.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(5);
/// Messages on their way without an acknowledgement.
const MAX_IN_FLIGHT: usize = 1_024;

#[derive(Debug, Clone)]
pub(super) struct Link {
    pub address: String,
    pub client: Client,
    pub context: Context,
    last_refusal: LastRefusal,
}

/// The broker's last refusal on this connection: the broker does not answer a refused request.
pub(super) type LastRefusal = Arc<Mutex<Option<String>>>;

/// Returns a problem together with the broker's refusal.
pub(super) fn append_refusal(problem: impl ToString, refused: &LastRefusal) -> String {
    match refused.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(refused) => format!("{}; the broker reports: {refused}", problem.to_string()),
        None => problem.to_string(),
    }
}

impl Link {
    /// Connects once. A caller that loses the connection makes a new one, so that nothing from the old one is
    /// mistaken for an answer.
    pub async fn connect(broker: &Broker, name: &str) -> Result<Self, BrokerError> {
        let options = ConnectOptions::new()
            .name(name)
            .connection_timeout(REQUEST_TIMEOUT)
            .request_timeout(Some(REQUEST_TIMEOUT))
            .ping_interval(Duration::from_secs(10))
            .max_reconnects(1);
        let options = match &broker.ca {
            Some(file) => {
                // The library's error does not name the file, and the library accepts a file without a certificate.
                // Therefore the file is checked here first.
                trust::client_config(file, None)?;
                options.add_root_certificates(file.clone())
            }
            None => options,
        };
        let options = options.require_tls(broker.address.starts_with("tls://"));
        let options = login(options, &broker.login).await?;
        let refused = Arc::new(Mutex::new(None));
        let hears = refused.clone();
        let options = options.event_callback(move |event| {
            if let Event::ServerError(error) = event {
                *hears.lock().unwrap_or_else(PoisonError::into_inner) = Some(error.to_string());
            }
            std::future::ready(())
        });
        let failed = |problem: &str| {
            let problem = format!("{problem}{}", advice(problem, broker));
            BrokerError::Connect { address: broker.address.clone(), problem }
        };
        let client = options.connect(&broker.address).await.map_err(|error| failed(&error.to_string()))?;
        let context = jetstream::ContextBuilder::new()
            .timeout(REQUEST_TIMEOUT)
            .ack_timeout(REQUEST_TIMEOUT)
            .max_ack_inflight(MAX_IN_FLIGHT)
            .backpressure_on_inflight(true)
            .build(client.clone());
        Ok(Link { address: broker.address.clone(), client, context, last_refusal: refused })
    }

    pub fn operation_error(&self, doing: &'static str, problem: impl ToString) -> BrokerError {
        BrokerError::Failed {
            address: self.address.clone(),
            operation: doing,
            problem: append_refusal(problem, &self.last_refusal),
        }
    }

    /// Returns the variable that receives the broker's refusals from now on.
    pub fn refused(&self) -> LastRefusal {
        self.last_refusal.clone()
    }
}

/// Returns the advice for a message of the library.
fn advice(problem: &str, broker: &Broker) -> &'static str {
    let is_tls = broker.address.starts_with("tls://");
    let has = |words: &str| problem.contains(words);
    if has("authorization violation") || has("Authorization") {
        "; check user with password_file, or credentials, of the broker"
    } else if has("UnknownIssuer") {
        "; the file at ca does not contain the authority that signed the broker's certificate"
    } else if has("InvalidContentType") || is_tls && has("TLS is not supported") {
        "; the broker does not use TLS: configure a certificate at the broker, or use an address with nats://"
    } else if has("CertificateRequired") || has("BadCertificate") {
        "; the broker requires a client certificate, which this program does not send: use user or credentials"
    } else {
        ""
    }
}

async fn login(options: ConnectOptions, login: &BrokerLogin) -> Result<ConnectOptions, BrokerError> {
    match login {
        BrokerLogin::Anybody => Ok(options),
        BrokerLogin::Credentials(path) => options
            .credentials_file(path)
            .await
            .map_err(|error| TrustError { path: path.clone(), problem: error.to_string() }.into()),
        BrokerLogin::Password { user, file } => {
            let password = trust::secret(file)?;
            Ok(options.user_and_password(user.clone(), password))
        }
    }
}

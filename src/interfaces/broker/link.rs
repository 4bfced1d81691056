//! The connection to the broker, the requests of a cell to the broker, and the errors of both.

use async_nats::jetstream::context::{GetStreamErrorKind, PublishAckFuture};
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::stream::LastRawMessageErrorKind;
use async_nats::jetstream::{Context, ErrorCode};
use async_nats::{Client, ConnectOptions, Event, jetstream};
use panelprep_base::trust::{self, TrustError};
use panelprep_cell::cell::{Broker, BrokerLogin, CellName};
use panelprep_store::office::{Chunk, RecipeOffer, subject};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Maximum time until a reply; a later reply is ignored.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(5);
/// Maximum number of messages that were sent but not acknowledged.
const MAX_IN_FLIGHT: usize = 1_024;

/// Errors of the connection to the broker.
#[derive(Debug, thiserror::Error)]
pub enum BrokerError {
    /// A file for the broker connection (certificate, credentials or password) cannot be used.
    #[error(transparent)]
    File(#[from] TrustError),
    /// The broker does not reply, or refuses the connection.
    #[error("cannot connect to the broker {address}: {problem}")]
    Connect {
        /// The address of the broker.
        address: String,
        /// The message of the connection.
        problem: String,
    },
    /// The streams of this program do not exist on the broker.
    #[error("the broker {address} has no stream {stream}; start `panelprep archive run`, which creates the stream")]
    NoStream {
        /// The address of the broker.
        address: String,
        /// The name of the missing stream.
        stream: &'static str,
    },
    /// The broker did not accept a message, or did not acknowledge it.
    #[error("the broker {address} did not accept a message: {problem}")]
    Refused {
        /// The address of the broker.
        address: String,
        /// The message of the broker.
        problem: String,
    },
    /// Any other operation of the broker failed.
    #[error("the broker {address}: cannot {operation}: {problem}")]
    Failed {
        /// The address of the broker.
        address: String,
        /// The operation that failed.
        operation: &'static str,
        /// The message of the broker.
        problem: String,
    },
}

#[derive(Debug, Clone)]
pub(super) struct Link {
    pub address: String,
    pub client: Client,
    pub context: Context,
    last_refusal: LastRefusal,
}

/// The last refusal of the broker on this connection. It arrives separately, because the broker does not reply to a
/// refused request.
type LastRefusal = Arc<Mutex<Option<String>>>;

/// Returns a problem as text, with the broker's last refusal appended.
fn append_refusal(problem: impl ToString, refused: &LastRefusal) -> String {
    match refused.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(refused) => format!("{}; the broker reports: {refused}", problem.to_string()),
        None => problem.to_string(),
    }
}

impl Link {
    /// Connects once, without reconnecting. After a lost connection the caller must create a new one, so that no late
    /// reply can be taken for a reply on the new connection.
    pub async fn connect(broker: &Broker, name: &str) -> Result<Self, BrokerError> {
        let options = ConnectOptions::new()
            .name(name)
            .connection_timeout(REQUEST_TIMEOUT)
            .request_timeout(Some(REQUEST_TIMEOUT))
            .ping_interval(Duration::from_secs(10))
            .max_reconnects(1);
        let options = match &broker.ca {
            Some(file) => {
                // The file is checked here, because the library accepts a file without a certificate, and its error
                // does not name the file.
                trust::client_config(file, None)?;
                options.add_root_certificates(file.clone())
            }
            None => options,
        };
        let options = options.require_tls(broker.address.starts_with("tls://"));
        let options = apply_login(options, &broker.login).await?;
        let refused = Arc::new(Mutex::new(None));
        let hears = refused.clone();
        let options = options.event_callback(move |event| {
            if let Event::ServerError(error) = event {
                *hears.lock().unwrap_or_else(PoisonError::into_inner) = Some(error.to_string());
            }
            std::future::ready(())
        });
        let failed = |problem: &str| {
            let problem = format!("{problem}{}", advice_for_problem(problem, broker));
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

    /// Returns the variable that contains the last refusal of the broker.
    pub fn refused(&self) -> LastRefusal {
        self.last_refusal.clone()
    }
}

/// Returns what to do about an error of the library.
fn advice_for_problem(problem: &str, broker: &Broker) -> &'static str {
    let is_tls = broker.address.starts_with("tls://");
    let has = |words: &str| problem.contains(words);
    if has("authorization violation") || has("Authorization") {
        "; check user and password_file, or credentials, in the settings of the broker"
    } else if has("UnknownIssuer") {
        "; the file at ca does not contain the certificate authority that signed the broker's certificate"
    } else if has("InvalidContentType") || is_tls && has("TLS is not supported") {
        "; the broker does not use TLS: configure a certificate at the broker, or use an address with nats://"
    } else if has("CertificateRequired") || has("BadCertificate") {
        "; the broker requires a client certificate, which this program does not send: use user or credentials"
    } else {
        ""
    }
}

async fn apply_login(options: ConnectOptions, login: &BrokerLogin) -> Result<ConnectOptions, BrokerError> {
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

/// The connection of a cell to the broker.
#[derive(Debug)]
pub struct CellLink {
    link: Link,
    cell: CellName,
}

/// A message that was sent but not acknowledged. The broker acknowledges a message after it is stored on disk.
pub struct PendingMessage {
    ack: PublishAckFuture,
    address: String,
    last_refusal: LastRefusal,
}

impl PendingMessage {
    /// Waits for the broker's acknowledgement.
    ///
    /// # Errors
    /// If the broker refuses the message, it was stored in another stream, or no acknowledgement arrives in time.
    pub async fn wait_acknowledged(self) -> Result<(), BrokerError> {
        let refused = |problem: String| BrokerError::Refused { address: self.address.clone(), problem };
        let ack = self.ack.await.map_err(|error| refused(append_refusal(error, &self.last_refusal)))?;
        match ack.stream == subject::STREAM {
            true => Ok(()),
            false => Err(refused(format!(
                "the message was stored in the stream {} instead of {}",
                ack.stream,
                subject::STREAM
            ))),
        }
    }
}

impl CellLink {
    /// Connects to the broker.
    ///
    /// # Errors
    /// If the broker cannot be reached, or refuses the connection.
    pub async fn connect(broker: &Broker, cell: &CellName) -> Result<Self, BrokerError> {
        let link = Link::connect(broker, &format!("panelprep {cell}")).await?;
        Ok(CellLink { link, cell: cell.clone() })
    }

    /// Returns a text that identifies the sender and the stream: the names of the cell and of the stream, and the
    /// creation time of the stream. If the text changes, the stream is new and contains none of the earlier messages.
    ///
    /// # Errors
    /// If there is no stream.
    pub async fn stream(&self) -> Result<String, BrokerError> {
        let stream = self.link.context.get_stream(subject::STREAM).await;
        let stream = stream.map_err(|error| match error.kind() {
            GetStreamErrorKind::JetStream(problem) if problem.error_code() == ErrorCode::STREAM_NOT_FOUND => {
                BrokerError::NoStream { address: self.link.address.clone(), stream: subject::STREAM }
            }
            _ => self.link.operation_error("report its streams", error),
        })?;
        let info = stream.cached_info();
        // If this text has changed, the new stream contains none of the messages that this cell has sent.
        Ok(format!("{} {} {}", self.cell, info.config.name, info.created.unix_timestamp_nanos()))
    }

    /// Returns the number up to which the office server has all records of this epoch; `None` if it has not reported a
    /// number.
    ///
    /// # Errors
    /// If the broker does not reply, or the stored value is not a number.
    pub async fn archived_number(&self, epoch: &str) -> Result<Option<u64>, BrokerError> {
        let context = &self.link.context;
        let stream = context.get_stream_no_info(subject::ARCHIVED_STREAM).await;
        let stream = stream
            .map_err(|error| self.link.operation_error("read the number of the last archived record", error))?;
        let last = stream.get_last_raw_message_by_subject(&subject::archived_subject(&self.cell, epoch)).await;
        let message = match last {
            Ok(message) => message,
            Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => return Ok(None),
            Err(error) => {
                return Err(self.link.operation_error("read the number of the last archived record", error));
            }
        };
        let number = std::str::from_utf8(&message.payload).ok().and_then(|text| text.parse().ok());
        let wrong = || {
            self.link
                .operation_error("read the number of the last archived record", "the stored value is not a number")
        };
        number.map(Some).ok_or_else(wrong)
    }

    /// Returns the recipe that the office offers for this panel; `None` if there is no offer.
    ///
    /// # Errors
    /// If the broker does not reply, or its reply is not an offer for this panel.
    pub async fn recipe_offer(&self, panel: &str) -> Result<Option<RecipeOffer>, BrokerError> {
        let stream = self.link.context.get_stream_no_info(subject::OFFER_STREAM).await;
        let failed = |problem: String| self.link.operation_error("read the offered recipes", problem);
        let stream = stream.map_err(|error| failed(error.to_string()))?;
        match stream.get_last_raw_message_by_subject(&subject::offer_subject(panel)).await {
            Ok(message) => {
                let offer = RecipeOffer::read(&message.payload).map_err(|error| failed(error.to_string()))?;
                match offer.panel == panel {
                    true => Ok(Some(offer)),
                    false => Err(failed(format!("the offer is for another panel, {}", offer.panel.escape_debug()))),
                }
            }
            Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok(None),
            Err(error) => Err(failed(error.to_string())),
        }
    }

    /// Sends a message chunk; the broker acknowledges it later. `again` is the number of earlier attempts to send this
    /// chunk, which the office server did not receive.
    ///
    /// # Errors
    /// If the chunk cannot be sent.
    pub async fn send(&self, chunk: &Chunk, again: u64) -> Result<PendingMessage, BrokerError> {
        let refused = |problem: String| BrokerError::Refused { address: self.link.address.clone(), problem };
        let bytes = chunk.bytes().map_err(|error| refused(error.to_string()))?;
        let message = PublishMessage::build().payload(bytes.into()).message_id(chunk.message_id(again));
        let sent = self.link.context.send_publish(subject::records(&self.cell), message).await;
        let ack = sent.map_err(|error| refused(error.to_string()))?;
        Ok(PendingMessage { ack, address: self.link.address.clone(), last_refusal: self.link.refused() })
    }

    /// Publishes the state of the cell to the present subscribers, without acknowledgement.
    ///
    /// # Errors
    /// If the state cannot be sent.
    pub async fn publish_state(&self, state: Vec<u8>) -> Result<(), BrokerError> {
        let published = self.link.client.publish(subject::state(&self.cell), state.into()).await;
        published.map_err(|error| self.link.operation_error("send the cell's state", error))
    }
}

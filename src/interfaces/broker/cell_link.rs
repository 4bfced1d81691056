//! A cell's requests to the broker.

use super::error::BrokerError;
use super::link::{LastRefusal, Link, append_refusal};
use async_nats::jetstream::ErrorCode;
use async_nats::jetstream::context::{GetStreamErrorKind, PublishAckFuture};
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::stream::LastRawMessageErrorKind;
use panelprep_cell::cell::{Broker, CellName};
use panelprep_store::office::{Chunk, RecipeOffer, subject};

/// The connection of a cell to the broker.
#[derive(Debug)]
pub struct CellLink {
    link: Link,
    cell: CellName,
}

/// A message that was sent and that is not yet confirmed: the broker confirms that the message is on its disk.
pub struct PendingMessage {
    ack: PublishAckFuture,
    address: String,
    last_refusal: LastRefusal,
}

impl PendingMessage {
    /// Waits for the broker's acknowledgement.
    ///
    /// # Errors
    /// If the broker refuses the message, another stream accepted it, or nothing comes in time.
    pub async fn wait_acknowledged(self) -> Result<(), BrokerError> {
        let refused = |problem: String| BrokerError::Refused { address: self.address.clone(), problem };
        let ack = self.ack.await.map_err(|error| refused(append_refusal(error, &self.last_refusal)))?;
        match ack.stream == subject::STREAM {
            true => Ok(()),
            false => Err(refused(format!(
                "the message was stored in the stream {}, not in {}",
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
    /// If the broker cannot be reached, or refuses.
    pub async fn connect(broker: &Broker, cell: &CellName) -> Result<Self, BrokerError> {
        let link = Link::connect(broker, &format!("panelprep {cell}")).await?;
        Ok(CellLink { link, cell: cell.clone() })
    }

    /// Returns a text that identifies the stream and the sender: the cell's name, the stream's name, and the creation
    /// time of the stream. Another stream has none of the messages that the one before it accepted.
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
        // If this text has changed, the new stream has none of the messages that this cell sent before.
        Ok(format!("{} {} {}", self.cell, info.config.name, info.created.unix_timestamp_nanos()))
    }

    /// Returns the number up to which the office has everything of this epoch; `None` if the office never reported
    /// one.
    ///
    /// # Errors
    /// If the broker cannot report it.
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

    /// Returns the recipe that the office offers for this panel; `None` if it offers none.
    ///
    /// # Errors
    /// If the broker cannot report it, or its answer is not an offer for this panel.
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

    /// Sends a part of a message. If the office did not have the part, it is sent again, and `again` counts the
    /// repetitions. The broker's acknowledgement comes later.
    ///
    /// # Errors
    /// If it cannot be sent.
    pub async fn send(&self, chunk: &Chunk, again: u64) -> Result<PendingMessage, BrokerError> {
        let refused = |problem: String| BrokerError::Refused { address: self.link.address.clone(), problem };
        let bytes = chunk.bytes().map_err(|error| refused(error.to_string()))?;
        let message = PublishMessage::build().payload(bytes.into()).message_id(chunk.message_id(again));
        let sent = self.link.context.send_publish(subject::records(&self.cell), message).await;
        let ack = sent.map_err(|error| refused(error.to_string()))?;
        Ok(PendingMessage { ack, address: self.link.address.clone(), last_refusal: self.link.refused() })
    }

    /// Publishes the cell's state to the clients that listen now; it may be lost.
    ///
    /// # Errors
    /// If it cannot be sent.
    pub async fn publish_state(&self, state: Vec<u8>) -> Result<(), BrokerError> {
        let published = self.link.client.publish(subject::state(&self.cell), state.into()).await;
        published.map_err(|error| self.link.operation_error("send the cell's state", error))
    }
}

//! The connection of the archive to the broker.

use super::link::{BrokerError, Link};
use async_nats::Subscriber;
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType};
use async_nats::jetstream::{AckKind, Message};
use futures_util::StreamExt;
use panelprep_cell::cell::{Broker, CellName};
use panelprep_store::office::{RecipeOffer, subject};
use std::time::{Duration, Instant};

/// Name of the archive's consumer in the stream.
const CONSUMER: &str = "archive";
/// Time after which the broker delivers a message again if it was not acknowledged.
const ACK_WAIT: Duration = Duration::from_secs(60);
/// Maximum age of the oldest message without acknowledgement. The broker should deliver it again after [`ACK_WAIT`];
/// after this longer time, the consumer is treated as stuck.
const STUCK_TIMEOUT: Duration = Duration::from_secs(150);
/// Interval of the check for a stuck consumer.
const STUCK_CHECK_INTERVAL: Duration = Duration::from_secs(15);
/// Maximum number of messages that are delivered but not acknowledged, including the chunks of incomplete files.
const MAX_ACK_PENDING: i64 = 20_000;
/// Time within which the broker recognises a duplicate of a message; later duplicates are recognised by the archive.
const DUPLICATE_WINDOW: Duration = Duration::from_secs(3_600);
/// Maximum time until the first message of a batch.
const BATCH_TIMEOUT: Duration = Duration::from_secs(1);

/// The connection of the archive to the broker.
#[derive(Debug)]
pub struct OfficeLink {
    link: Link,
    consumer: PullConsumer,
    /// The number up to which all messages are acknowledged, and the time at which this number last changed.
    /// `last_check` is the time of the last check.
    floor: (u64, Instant),
    last_check: Instant,
}

/// Creates the archive's consumer in the stream of records, or returns the existing one.
async fn consumer(link: &Link) -> Result<PullConsumer, BrokerError> {
    let stream = link.context.get_stream(subject::STREAM).await;
    let stream = stream.map_err(|error| link.operation_error("find its stream", error))?;
    let config = pull::Config {
        durable_name: Some(CONSUMER.to_owned()),
        ack_policy: AckPolicy::Explicit,
        ack_wait: ACK_WAIT,
        max_ack_pending: MAX_ACK_PENDING,
        ..pull::Config::default()
    };
    let consumer = stream.get_or_create_consumer(CONSUMER, config).await;
    consumer.map_err(|error| link.operation_error("create the consumer of the archive in the stream", error))
}

/// A message that the broker has delivered.
#[derive(Debug)]
pub struct Delivery {
    /// The content of the message.
    pub bytes: Vec<u8>,
    /// The subject on which the message was sent; the broker restricts which cell may send on it.
    pub subject: String,
    /// The receipt with which the message is acknowledged.
    pub receipt: Receipt,
}

/// The receipt of a delivered message, which acknowledges or refuses the message. Until then the broker keeps the
/// message.
#[derive(Debug)]
pub struct Receipt {
    message: Message,
    address: String,
}

impl Receipt {
    /// Acknowledges that the message is stored, so that the broker may delete it.
    ///
    /// # Errors
    /// If the acknowledgement cannot be sent; the message is then delivered again.
    pub async fn acknowledge(&self) -> Result<(), BrokerError> {
        self.send_ack(AckKind::Ack).await
    }

    /// Refuses a message that can never be stored, so that the broker deletes it.
    ///
    /// # Errors
    /// If the refusal cannot be sent; the message is then delivered again.
    pub async fn refuse(&self) -> Result<(), BrokerError> {
        self.send_ack(AckKind::Term).await
    }

    async fn send_ack(&self, kind: AckKind) -> Result<(), BrokerError> {
        let failed = |error: async_nats::Error| BrokerError::Failed {
            address: self.address.clone(),
            operation: "acknowledge a message",
            problem: error.to_string(),
        };
        self.message.ack_with(kind).await.map_err(failed)
    }
}

/// Returns the broker's message; if its disk is too small, with what to do.
fn append_advice(problem: &str) -> String {
    match problem.contains("insufficient storage") {
        true => format!(
            "{problem}; the broker's disk has less space than waiting_gb requires: lower waiting_gb, or give the \
             broker a larger disk"
        ),
        false => problem.to_owned(),
    }
}

impl OfficeLink {
    /// Connects to the broker, and creates or updates the streams. The maximum size of the stream of records is
    /// `most_bytes`.
    ///
    /// # Errors
    /// If the broker cannot be reached, refuses the connection, or has no JetStream.
    pub async fn connect(broker: &Broker, most_bytes: i64) -> Result<Self, BrokerError> {
        let link = Link::connect(broker, "panelprep archive").await?;
        let records = Config {
            name: subject::STREAM.to_owned(),
            subjects: vec![subject::ALL_RECORDS.to_owned()],
            retention: RetentionPolicy::WorkQueue,
            discard: DiscardPolicy::New,
            storage: StorageType::File,
            max_bytes: most_bytes,
            duplicate_window: DUPLICATE_WINDOW,
            ..Config::default()
        };
        let archived = Config {
            name: subject::ARCHIVED_STREAM.to_owned(),
            subjects: vec![subject::ALL_ARCHIVED.to_owned()],
            storage: StorageType::File,
            max_messages_per_subject: 1,
            ..Config::default()
        };
        let offers = Config {
            name: subject::OFFER_STREAM.to_owned(),
            subjects: vec![subject::ALL_OFFERS.to_owned()],
            storage: StorageType::File,
            max_messages_per_subject: 1,
            ..Config::default()
        };
        for config in [archived, offers, records] {
            let made = link.context.create_or_update_stream(config).await;
            made.map_err(|error| link.operation_error("make a stream", append_advice(&error.to_string())))?;
        }
        let consumer = consumer(&link).await?;
        let now = Instant::now();
        Ok(OfficeLink { link, consumer, floor: (0, now), last_check: now })
    }

    /// Recreates the consumer if the broker no longer delivers a message, and returns whether it did so; previous
    /// receipts are then invalid. After the broker was killed, it may treat messages as delivered and never deliver
    /// them again (observed with nats-server 2.9 in a thousand kills). A new consumer receives all messages that the
    /// broker still has; the archive recognises those that it has already stored by their names.
    ///
    /// # Errors
    /// If the broker does not reply.
    pub async fn recreate_stuck_consumer(&mut self) -> Result<bool, BrokerError> {
        if self.last_check.elapsed() < STUCK_CHECK_INTERVAL {
            return Ok(false);
        }
        self.last_check = Instant::now();
        let info = self.consumer.get_info().await;
        let info = info.map_err(|error| self.link.operation_error("report its deliveries", error))?;
        let (waits, floor) = (info.num_ack_pending, info.ack_floor.stream_sequence);
        if waits == 0 || floor != self.floor.0 {
            self.floor = (floor, Instant::now());
            return Ok(false);
        }
        if self.floor.1.elapsed() < STUCK_TIMEOUT {
            return Ok(false);
        }
        self.floor.1 = Instant::now();
        tracing::warn!(
            "the broker has not delivered one of {waits} messages for {} s: the messages are requested again",
            STUCK_TIMEOUT.as_secs()
        );
        let stream = self.link.context.get_stream(subject::STREAM).await;
        let stream = stream.map_err(|error| self.link.operation_error("find its stream", error))?;
        let gone = stream.delete_consumer(CONSUMER).await;
        gone.map_err(|error| {
            self.link.operation_error("remove the consumer of the archive from the stream", error)
        })?;
        self.consumer = consumer(&self.link).await?;
        Ok(true)
    }

    /// Returns the next messages, at most `most`; empty if no message arrives within a second.
    ///
    /// # Errors
    /// If the broker does not reply.
    pub async fn next(&self, most: usize) -> Result<Vec<Delivery>, BrokerError> {
        let failed = |problem: String| self.link.operation_error("deliver messages", problem);
        let batch = self.consumer.batch().max_messages(most).expires(BATCH_TIMEOUT).messages().await;
        let mut batch = batch.map_err(|error| failed(error.to_string()))?;
        let mut all = Vec::new();
        while let Some(message) = batch.next().await {
            let mut message = message.map_err(|error| failed(error.to_string()))?;
            // The content is moved out of the receipt, which may be kept for a long time.
            let bytes = Vec::from(std::mem::take(&mut message.message.payload));
            let subject = message.subject.to_string();
            all.push(Delivery { bytes, subject, receipt: Receipt { message, address: self.link.address.clone() } });
        }
        Ok(all)
    }

    /// Publishes the number up to which all records of a cell's epoch are archived, and waits until the broker has
    /// stored it on disk.
    ///
    /// # Errors
    /// If the broker does not accept the message.
    pub async fn publish_archived(&self, cell: &CellName, epoch: &str, number: u64) -> Result<(), BrokerError> {
        let said =
            self.link.context.publish(subject::archived_subject(cell, epoch), number.to_string().into()).await;
        let failed =
            |problem: String| self.link.operation_error("publish the number of the last archived record", problem);
        let ack = said.map_err(|error| failed(error.to_string()))?;
        ack.await.map(drop).map_err(|error| failed(error.to_string()))
    }

    /// Publishes an offer of a recipe to all cells, which replaces the previous offer for its panel, and waits until
    /// the broker has stored it on disk.
    ///
    /// # Errors
    /// If the broker does not accept the message.
    pub async fn publish_offer(&self, offer: &RecipeOffer) -> Result<(), BrokerError> {
        let failed = |problem: String| self.link.operation_error("offer a recipe", problem);
        let bytes = offer.bytes().map_err(|error| failed(error.to_string()))?;
        let said = self.link.context.publish(subject::offer_subject(&offer.panel), bytes.into()).await;
        let ack = said.map_err(|error| failed(error.to_string()))?;
        ack.await.map(drop).map_err(|error| failed(error.to_string()))
    }

    /// Subscribes to the states that all cells report.
    ///
    /// # Errors
    /// If the broker does not permit the subscription.
    pub async fn states(&self) -> Result<StateSubscription, BrokerError> {
        let heard = self.link.client.subscribe(subject::ALL_STATES).await;
        let heard =
            heard.map_err(|error| self.link.operation_error("subscribe to the states of the cells", error))?;
        Ok(StateSubscription { subscriber: heard, link: self.link.clone() })
    }
}

/// A subscription to the states that the cells report.
pub struct StateSubscription {
    subscriber: Subscriber,
    link: Link,
}

impl StateSubscription {
    /// Returns the subject and the bytes of the next state.
    ///
    /// # Errors
    /// If the connection was lost; a new connection is made automatically.
    pub async fn next(&mut self) -> Result<(String, Vec<u8>), BrokerError> {
        match self.subscriber.next().await {
            Some(state) => Ok((state.subject.to_string(), state.payload.into())),
            None => Err(self.link.operation_error(
                "subscribe to the states of the cells",
                "the connection was lost; a new connection is made automatically",
            )),
        }
    }
}

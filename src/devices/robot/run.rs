//! The thread of the link: it connects to a controller, transfers bytes between sockets and session, processes
//! requests, and advances the virtual time. The TCP connections are configured so that a controller that does not
//! respond is detected.

use super::queue::{LinkRequest, ReportQueue};
use panelprep_base::supervision::SupervisedThread;
use panelprep_cell::cell;
use panelprep_kuka::eki::{Channel, ClockMode, LinkLoss, Report, Session, StopCause, Time};
use socket2::{SockRef, TcpKeepalive};
use std::io::{Error as IoError, ErrorKind};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::TcpStream;
use tokio::sync::mpsc;

/// Time limit for opening a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Time after which a connection is closed if the controller does not acknowledge sent bytes (TCP).
const USER_TIMEOUT: Duration = Duration::from_secs(1);

/// Minimum and maximum delay between two attempts to connect; the delay is doubled after each attempt.
const MIN_RECONNECT_DELAY: Duration = Duration::from_millis(100);
const MAX_RECONNECT_DELAY: Duration = Duration::from_secs(1);
/// Time limit for sending an abort before the link is closed.
const ABORT_SEND_TIMEOUT: Duration = Duration::from_millis(100);
/// Time on the wall clock after which a controller in lock step is treated as lost if it does not reply; in lock step
/// the session has no deadlines.
const LOCK_STEP_TIMEOUT: Duration = Duration::from_secs(10);
/// Maximum time for which a report may wait while commands are queued; then the epoch ends. Heartbeats must show that
/// the program supervises the robot, not only that this thread runs.
const REPORT_READ_TIMEOUT: Duration = Duration::from_secs(1);
/// Interval at which the thread reports to its supervisor that it is alive, if nothing else happens.
const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(500);

/// The address and ports on which a controller listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    /// Host name or address of the controller.
    pub host: String,
    /// Port of the command channel.
    pub command_port: u16,
    /// Port of the state channel.
    pub state_port: u16,
}

impl From<&cell::Robot> for Address {
    fn from(robot: &cell::Robot) -> Self {
        Address {
            host: robot.host().to_owned(),
            command_port: robot.command_port(),
            state_port: robot.state_port(),
        }
    }
}

/// Connects the command channel, then the state channel. So a controller that receives a state request has both
/// channels.
async fn connect(address: &Address) -> Result<(TcpStream, TcpStream), LinkLoss> {
    // The channels are connected one after the other: if the robot program does not run, the message contains only one
    // refused port.
    let command = open(Channel::Command, &address.host, address.command_port).await?;
    let state = open(Channel::State, &address.host, address.state_port).await?;
    Ok((command, state))
}

async fn open(channel: Channel, host: &str, port: u16) -> Result<TcpStream, LinkLoss> {
    let address = format!("{host}:{port}");
    let stream = match tokio::time::timeout(CONNECT_TIMEOUT, TcpStream::connect((host, port))).await {
        Ok(Ok(stream)) => stream,
        Ok(Err(error)) => return Err(connection_refusal(&error, channel, address)),
        Err(_) => return Err(no_answer_loss(channel, address)),
    };
    configure_stream(&stream).map_err(|error| system_loss(channel, &error))?;
    Ok(stream)
}

/// Returns the reason for a failed connection. If a cable is unplugged, a router or the operating system reports that
/// there is no route; this is treated as a controller that does not respond.
fn connection_refusal(error: &IoError, channel: Channel, address: String) -> LinkLoss {
    match error.kind() {
        ErrorKind::ConnectionRefused => LinkLoss::Refused { channel, address },
        ErrorKind::TimedOut | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
            no_answer_loss(channel, address)
        }
        ErrorKind::PermissionDenied => system_loss(channel, error),
        _ => LinkLoss::System { channel, problem: format!("{address}: {error}") },
    }
}

fn no_answer_loss(channel: Channel, address: String) -> LinkLoss {
    LinkLoss::NoAnswer { channel, address, waited_ms: CONNECT_TIMEOUT.as_millis() as u64 }
}

fn configure_stream(stream: &TcpStream) -> Result<(), IoError> {
    // Nagle's algorithm would delay a heartbeat or an abort until the last segment is acknowledged.
    stream.set_nodelay(true)?;
    let socket = SockRef::from(stream);
    let keepalive = TcpKeepalive::new().with_time(USER_TIMEOUT).with_interval(USER_TIMEOUT).with_retries(3);
    socket.set_tcp_keepalive(&keepalive)?;
    #[cfg(target_os = "linux")]
    // TCP keepalive is inactive while data is unacknowledged; in this case the user timeout detects an unplugged cable.
    socket.set_tcp_user_timeout(Some(USER_TIMEOUT))?;
    Ok(())
}

/// Returns the operating system's error; if a permission is missing, also where to check it.
fn system_loss(channel: Channel, error: &IoError) -> LinkLoss {
    if matches!(error.kind(), ErrorKind::ConnectionReset | ErrorKind::ConnectionAborted | ErrorKind::BrokenPipe) {
        return LinkLoss::Closed { channel };
    }
    let networks = match error.kind() {
        ErrorKind::PermissionDenied => {
            "; check the firewall, and that the cell's networks are in \
             /etc/systemd/system/panelprep.service.d/network.conf"
        }
        _ => "",
    };
    LinkLoss::System { channel, problem: format!("{error}{networks}") }
}

pub(super) struct LinkLoop {
    address: Address,
    session: Session,
    pace: ClockMode,
    orders: mpsc::UnboundedReceiver<LinkRequest>,
    reports: Arc<ReportQueue>,
    started: Instant,
    /// The last controller time that was received; only in lock step.
    virtual_now: Time,
    /// The last loss that was reported; cleared when a controller replies.
    reported_loss: Option<LinkLoss>,
    sign: SupervisedThread,
}

/// All senders of requests were dropped, so the link must end.
struct NoSenders;

/// The two connections, and the bytes that are not written to them yet.
struct LinkStreams {
    command: TcpStream,
    state: TcpStream,
    command_out: Vec<u8>,
    state_out: Vec<u8>,
}

impl Drop for LinkLoop {
    fn drop(&mut self) {
        self.reports.close();
        if !std::thread::panicking() {
            self.sign.report_done();
        }
    }
}

impl LinkLoop {
    pub(super) fn new(
        address: Address,
        session: Session,
        pace: ClockMode,
        (orders, reports): (mpsc::UnboundedReceiver<LinkRequest>, Arc<ReportQueue>),
        sign: SupervisedThread,
    ) -> Self {
        LinkLoop {
            address,
            session,
            pace,
            orders,
            reports,
            started: Instant::now(),
            virtual_now: Time::default(),
            reported_loss: None,
            sign,
        }
    }

    /// Connects, and reconnects after each loss, until all senders of requests are dropped.
    pub(super) async fn run(mut self) {
        let mut pause = MIN_RECONNECT_DELAY;
        loop {
            let address = self.address.clone();
            match self.run_beside_requests(connect(&address)).await {
                Err(NoSenders) => return,
                Ok(Err(why)) => {
                    self.session.disconnected(why);
                    self.publish();
                }
                Ok(Ok((command, state))) => {
                    let (command_out, state_out) = (Vec::new(), Vec::new());
                    let mut streams = LinkStreams { command, state, command_out, state_out };
                    self.session.connected(self.now());
                    let served = self.serve(&mut streams).await;
                    self.send_pending_abort(&mut streams).await;
                    self.publish();
                    if let Err(NoSenders) = served {
                        return;
                    }
                    // Only a reply of the controller resets the delay. Otherwise a controller that accepts connections
                    // and closes them would be tried ten times a second.
                    if self.reported_loss.is_none() {
                        pause = MIN_RECONNECT_DELAY;
                    }
                }
            }
            // A random addition of up to a quarter of the delay: so clients do not all connect at the same time to a
            // controller that was restarted.
            let jitter = pause * (self.started.elapsed().subsec_nanos() % 256) / 1024;
            if let Err(NoSenders) = self.run_beside_requests(tokio::time::sleep(pause + jitter)).await {
                return;
            }
            pause = (2 * pause).min(MAX_RECONNECT_DELAY);
        }
    }

    /// Waits for this future, and processes requests meanwhile.
    async fn run_beside_requests<T>(&mut self, work: impl Future<Output = T>) -> Result<T, NoSenders> {
        tokio::pin!(work);
        loop {
            self.sign.report_working();
            tokio::select! {
                result = &mut work => return Ok(result),
                () = tokio::time::sleep(HEARTBEAT_INTERVAL) => {}
                order = self.orders.recv() => self.handle_request(order.ok_or(NoSenders)?),
            }
        }
    }

    /// Runs the session on two connections until one of them fails or is closed.
    async fn serve(&mut self, streams: &mut LinkStreams) -> Result<(), NoSenders> {
        let mut last_received = Instant::now();
        loop {
            self.sign.report_working();
            // If the cycle hangs, this thread must not keep the arm moving with its heartbeats.
            if self.pace == ClockMode::Wall && self.reports.unread_for() >= REPORT_READ_TIMEOUT {
                self.session.interrupt(StopCause::Unattended);
            }
            while let Some((channel, bytes)) = self.session.poll_transmit(self.now()) {
                match channel {
                    Channel::Command => streams.command_out.extend_from_slice(&bytes),
                    Channel::State => {
                        streams.state_out.extend_from_slice(&bytes);
                        // In lock step the controller sends nothing between two requests, however long a computation
                        // takes. So its silence is measured from the last request.
                        if self.pace == ClockMode::LockStep {
                            last_received = Instant::now();
                        }
                    }
                }
            }
            self.publish();
            if !self.session.is_connected() {
                return Ok(());
            }
            // In lock step acknowledgements are read together with the state message that follows them, so that the
            // result does not depend on the speed of the computer.
            let reads_command = self.pace == ClockMode::Wall;
            let deadline = self.deadline(last_received);
            let step = tokio::select! {
                // The order is important: first a stop by the caller, then the state channel, then the command channel.
                // In random order, many acknowledgements could delay an abort.
                biased;
                order = self.orders.recv() => {
                    let Some(order) = order else {
                        #[expect(clippy::let_underscore_must_use, reason = "an abort fails only without a connection")]
                        let _ = self.session.abort();
                        return Err(NoSenders);
                    };
                    self.handle_request(order);
                    Ok(())
                }
                ready = streams.state.writable(), if !streams.state_out.is_empty() => {
                    ready.and_then(|()| write(&streams.state, &mut streams.state_out)).map_err(|error| system_loss(Channel::State, &error))
                }
                ready = streams.state.readable() => {
                    last_received = Instant::now();
                    ready.map_err(|error| system_loss(Channel::State, &error)).and_then(|()| self.read(streams))
                }
                ready = streams.command.writable(), if !streams.command_out.is_empty() => {
                    ready.and_then(|()| write(&streams.command, &mut streams.command_out)).map_err(|error| system_loss(Channel::Command, &error))
                }
                ready = streams.command.readable(), if reads_command => {
                    ready.map_err(|error| system_loss(Channel::Command, &error)).and_then(|()| self.receive_acks(&streams.command))
                }
                () = tokio::time::sleep_until(deadline.into()) => self.time_passed(last_received),
                // Nothing has happened; the loop continues and reports to the supervisor that the thread is alive.
                () = tokio::time::sleep(HEARTBEAT_INTERVAL) => Ok(()),
            };
            if let Err(why) = step {
                self.session.disconnected(why);
            }
        }
    }

    fn deadline(&self, heard: Instant) -> Instant {
        match self.pace {
            ClockMode::LockStep if self.session.awaits_answer() => heard + LOCK_STEP_TIMEOUT,
            // In lock step no deadline is due before the next request; any long time is suitable here.
            ClockMode::LockStep => Instant::now() + LOCK_STEP_TIMEOUT,
            ClockMode::Wall => {
                let due = self.session.deadline().map_or(MAX_RECONNECT_DELAY, Time::since_start);
                self.started + due
            }
        }
    }

    fn time_passed(&mut self, heard: Instant) -> Result<(), LinkLoss> {
        self.session.time_passed(self.now());
        let silence = heard.elapsed();
        if self.pace == ClockMode::LockStep && self.session.awaits_answer() && silence >= LOCK_STEP_TIMEOUT {
            let silence_ms = silence.as_millis() as u64;
            return Err(LinkLoss::Silent { channel: Channel::State, silence_ms });
        }
        Ok(())
    }

    /// Reads the state channel; in lock step the command channel is read first.
    fn read(&mut self, streams: &LinkStreams) -> Result<(), LinkLoss> {
        let mut bytes = [0; 16 * 1024];
        let count = read_available(Channel::State, &streams.state, &mut bytes)?;
        if self.pace == ClockMode::LockStep {
            self.receive_acks(&streams.command)?;
        }
        let now = self.now();
        self.session.push_state_bytes(&bytes[..count], now);
        Ok(())
    }

    fn receive_acks(&mut self, stream: &TcpStream) -> Result<(), LinkLoss> {
        let mut bytes = [0; 16 * 1024];
        loop {
            let count = read_available(Channel::Command, stream, &mut bytes)?;
            if count == 0 {
                return Ok(());
            }
            let now = self.now();
            self.session.push_command_bytes(&bytes[..count], now);
        }
    }

    fn handle_request(&mut self, order: LinkRequest) {
        self.reports.mark_active();
        // If the caller no longer waits for the reply, sending the reply fails, which has no effect.
        match order {
            LinkRequest::Queue(command, reply) => drop(reply.send(self.session.queue(command))),
            LinkRequest::QueuePath(points, reply) => drop(reply.send(self.session.queue_path(&points))),
            LinkRequest::QueuePathWithin(points, permitted, reply) => {
                drop(reply.send(self.session.queue_path_within(&points, permitted)));
            }
            LinkRequest::Permit(last, reply) => drop(reply.send(self.session.permit_commands(last))),
            LinkRequest::OpenEpoch(above, reply) => drop(reply.send(self.session.open_epoch_above(above))),
            LinkRequest::Line(bits) => self.session.set_line_signals(bits),
            LinkRequest::Abort(reply) => drop(reply.send(self.session.abort())),
            // If there is no connection, the controller has already stopped by itself.
            LinkRequest::Stop => self.session.stop_now(),
            // The time must not advance while a reply is pending, or while the caller has not read a report.
            LinkRequest::Grant { report_count }
                if report_count == self.reports.reported_count() && !self.session.awaits_answer() =>
            {
                self.session.heartbeat(self.now());
            }
            LinkRequest::Grant { .. } => {}
        }
    }

    /// Moves the session's reports to the queue. In lock step all reports of one reply are moved together, so that a
    /// caller reacts to the first of them before the time advances further.
    fn publish(&mut self) {
        if self.pace == ClockMode::LockStep && self.session.awaits_answer() {
            return;
        }
        while let Some(report) = self.session.poll_report() {
            match &report {
                Report::LinkLost { why }
                    if self.reported_loss.as_ref().is_some_and(|earlier| is_same_loss(earlier, why)) =>
                {
                    continue;
                }
                Report::LinkLost { why } => self.reported_loss = Some(why.clone()),
                Report::Connected { state } => {
                    self.reported_loss = None;
                    self.virtual_now = Time::from_ms(u64::from(state.time_ms));
                }
                Report::State(state) => self.virtual_now = Time::from_ms(u64::from(state.time_ms)),
                _ => {}
            }
            self.reports.add(report, self.pace == ClockMode::Wall);
        }
    }

    fn now(&self) -> Time {
        match self.pace {
            ClockMode::Wall => Time::from_start(self.started.elapsed()),
            ClockMode::LockStep => self.virtual_now,
        }
    }

    /// Sends a pending abort before the connections are closed.
    async fn send_pending_abort(&mut self, streams: &mut LinkStreams) {
        while let Some((channel, bytes)) = self.session.poll_transmit(self.now()) {
            if channel == Channel::State {
                streams.state_out.extend_from_slice(&bytes);
            }
        }
        let leave = async {
            while !streams.state_out.is_empty() {
                streams.state.writable().await?;
                write(&streams.state, &mut streams.state_out)?;
            }
            Ok::<(), IoError>(())
        };
        #[expect(
            clippy::let_underscore_must_use,
            reason = "if it cannot be sent, the controller's own watchdog stops the robot"
        )]
        let _ = tokio::time::timeout(ABORT_SEND_TIMEOUT, leave).await;
    }
}

/// Reads the available bytes without waiting; returns 0 if there are none.
fn read_available(channel: Channel, stream: &TcpStream, bytes: &mut [u8]) -> Result<usize, LinkLoss> {
    match stream.try_read(bytes) {
        Ok(0) => Err(LinkLoss::Closed { channel }),
        Ok(count) => Ok(count),
        Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(0),
        Err(error) => Err(system_loss(channel, &error)),
    }
}

fn write(stream: &TcpStream, bytes: &mut Vec<u8>) -> Result<(), IoError> {
    match stream.try_write(bytes) {
        Ok(count) => {
            bytes.drain(..count);
            Ok(())
        }
        Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(()),
        Err(error) => Err(error),
    }
}

/// Returns whether two losses have the same cause, so that the cause is reported once.
fn is_same_loss(one: &LinkLoss, other: &LinkLoss) -> bool {
    std::mem::discriminant(one) == std::mem::discriminant(other)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error code of the kernel if the unit's IPAddressDeny blocks a packet.
    #[test]
    fn a_network_that_the_unit_does_not_allow_is_reported() {
        let said =
            system_loss(Channel::Command, &IoError::from_raw_os_error(rustix::io::Errno::PERM.raw_os_error()));
        assert!(said.to_string().contains("panelprep.service.d/network.conf"), "{said}");
        let other = system_loss(
            Channel::Command,
            &IoError::from_raw_os_error(rustix::io::Errno::NETUNREACH.raw_os_error()),
        );
        assert!(!other.to_string().contains("network.conf"), "{other}");
    }

    /// The error codes of the kernel if a cable is unplugged, and if no program listens on the port.
    #[test]
    fn a_host_that_cannot_be_reached_does_not_answer() {
        let loss = |errno: rustix::io::Errno| {
            let error = IoError::from_raw_os_error(errno.raw_os_error());
            connection_refusal(&error, Channel::Command, "192.0.2.7:54600".to_owned())
        };
        for errno in [rustix::io::Errno::HOSTUNREACH, rustix::io::Errno::NETUNREACH, rustix::io::Errno::TIMEDOUT] {
            let said = loss(errno).to_string();
            assert!(
                said.contains("192.0.2.7:54600 does not respond") && said.contains("the cable is connected"),
                "{said}"
            );
        }
        assert!(matches!(loss(rustix::io::Errno::CONNREFUSED), LinkLoss::Refused { .. }));
        assert!(matches!(loss(rustix::io::Errno::PERM), LinkLoss::System { .. }));
    }
}

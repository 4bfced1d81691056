//! Counters of a camera's link since the program began.

/// Frames, packets and losses: sums over all connections of the camera.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Number of accepted frames.
    pub accepted: u64,
    /// Number of frames that were received and refused.
    pub refused: u64,
    /// Number of frames that are missing in the numbering of a free running camera.
    pub lost: u64,
    /// Number of stills for which nothing came in time.
    pub timeouts: u64,
    /// Number of stills that were triggered once more.
    pub retries: u64,
    /// Number of triggers sent although the camera did not report that it was ready.
    pub unarmed: u64,
    /// Number of times that the camera's clock was set back.
    pub clock_steps: u64,
    /// Number of received packets.
    pub packets: u64,
    /// Packets that arrived only after a resend request.
    pub resent_packets: u64,
    /// Number of packets that never came.
    pub missing_packets: u64,
    /// Number of frames for which no buffer was free.
    pub underruns: u64,
    /// Number of times that the camera was lost.
    pub losses: u64,
    /// Number of times that the camera was connected.
    pub connections: u64,
}

impl Statistics {
    /// Returns the sum of both.
    pub fn plus(self, other: Statistics) -> Self {
        Statistics {
            accepted: self.accepted + other.accepted,
            refused: self.refused + other.refused,
            lost: self.lost + other.lost,
            timeouts: self.timeouts + other.timeouts,
            retries: self.retries + other.retries,
            unarmed: self.unarmed + other.unarmed,
            clock_steps: self.clock_steps + other.clock_steps,
            packets: self.packets + other.packets,
            resent_packets: self.resent_packets + other.resent_packets,
            missing_packets: self.missing_packets + other.missing_packets,
            underruns: self.underruns + other.underruns,
            losses: self.losses + other.losses,
            connections: self.connections + other.connections,
        }
    }
}

impl std::fmt::Display for Statistics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Statistics { accepted, refused, lost, timeouts, retries, .. } = self;
        let Statistics { unarmed, clock_steps, .. } = self;
        let Statistics { packets, resent_packets, missing_packets, underruns, losses, connections, .. } = self;
        write!(
            f,
            "{accepted} frames accepted, {refused} refused, {lost} lost, {timeouts} timeouts, {retries} retries, \
             {unarmed} triggered before ready, {clock_steps} backward steps of its clock; {packets} packets, \
             {resent_packets} requested again, {missing_packets} missing, {underruns} without a buffer; connected \
             {connections} times, lost {losses} times"
        )
    }
}

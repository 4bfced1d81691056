//! The effect of an output in the world, and its delay: a lamp needs time, a disc spins up, a valve closes.

use panelprep_cell::cell::Output;

/// Delay until the device at an output follows, ms.
struct DeviceDelays {
    on_ms: u64,
    off_ms: u64,
}

fn delays(output: Output) -> DeviceDelays {
    let (on_ms, off_ms) = match output {
        Output::Light => (300, 0),
        Output::Spray => (0, 200), // the valve closes slower than it opens
        Output::LensShutter => (250, 250),
        Output::Extraction => (800, 500),
        Output::Tool => (1_000, 600),
    };
    DeviceDelays { on_ms, off_ms }
}

/// An output and the feedback that follows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Signal {
    pub output: Output,
    /// Number n of the output `$OUT[n]`.
    pub number: u16,
    /// Number n of `$IN[n]` of its feedback.
    pub feedback: u16,
    /// The output's value.
    pub on: bool,
    /// Time of the last change, ms.
    since_ms: u64,
    /// Whether the driven device was running when the output last changed.
    was_running: bool,
}

impl Signal {
    pub fn new(output: Output, number: u16, feedback: u16) -> Self {
        Signal { output, number, feedback, on: false, since_ms: 0, was_running: false }
    }

    /// The output changes.
    pub fn switch(&mut self, on: bool, now_ms: u64) {
        self.was_running = self.is_running(now_ms);
        (self.on, self.since_ms) = (on, now_ms);
    }

    /// Returns whether the driven device runs.
    pub fn is_running(&self, now_ms: u64) -> bool {
        let DeviceDelays { on_ms, off_ms } = delays(self.output);
        let follows = now_ms >= self.since_ms + if self.on { on_ms } else { off_ms };
        if follows { self.on } else { self.was_running }
    }

    /// Returns the feedback: for the spray whether it is off, for everything else whether it runs.
    pub fn is_feedback_on(&self, now_ms: u64) -> bool {
        self.is_running(now_ms) != (self.output == Output::Spray)
    }

    /// Returns the start-up progress of the driven device, 0…1, linear in time; when the device is switched off, the
    /// value is 0 at once.
    pub fn share(&self, now_ms: u64) -> f64 {
        let since_ms = now_ms.saturating_sub(self.since_ms) as f64;
        let on_ms = delays(self.output).on_ms.max(1) as f64;
        if !self.on {
            0.0
        } else if self.was_running {
            1.0
        } else {
            (since_ms / on_ms).min(1.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_switched_off_before_it_ran_never_ran() {
        let mut tool = Signal::new(Output::Tool, 5, 4);
        tool.switch(true, 100);
        assert!(!tool.is_feedback_on(1_099));
        tool.switch(false, 600);
        assert!((600..3_000).all(|now_ms| !tool.is_feedback_on(now_ms)));
        tool.switch(true, 3_000);
        assert!(!tool.is_feedback_on(3_999) && tool.is_feedback_on(4_000));
        tool.switch(false, 5_000);
        assert!(tool.is_feedback_on(5_599) && !tool.is_feedback_on(5_600), "it runs down");
    }

    #[test]
    fn the_spray_reports_that_it_is_off() {
        let mut spray = Signal::new(Output::Spray, 2, 1);
        assert!(spray.is_feedback_on(0));
        spray.switch(true, 10);
        assert!(!spray.is_feedback_on(10));
        spray.switch(false, 5_000);
        assert!(!spray.is_feedback_on(5_199) && spray.is_feedback_on(5_200));
    }
}

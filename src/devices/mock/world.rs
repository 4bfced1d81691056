//! The world around the controller: outputs act on it, inputs come from it.

/// The world on the other side of the controller's terminals. The world is called while the controller is locked, so
/// it must not request anything from the controller.
pub trait World: Send {
    /// `$OUT[number]` changed.
    fn on_output(&mut self, number: u16, value: bool, time_ms: u64);

    /// Returns the state of `$IN[number]` now; `None` keeps the state that
    /// [`Controller::set_input`](super::Controller::set_input) has set.
    fn input(&self, number: u16, time_ms: u64) -> Option<bool>;
}

/// Nothing is connected.
#[derive(Debug, Clone, Copy, Default)]
pub struct UnconnectedWorld;

impl World for UnconnectedWorld {
    fn on_output(&mut self, _: u16, _: bool, _: u64) {}

    fn input(&self, _: u16, _: u64) -> Option<bool> {
        None
    }
}

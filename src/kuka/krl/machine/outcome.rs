//! The result of executing a statement or a step.

/// The way in which a step ended.
#[derive(Debug, Clone, PartialEq)]
pub enum StepPause {
    /// The statement has ended.
    Statement,
    /// The step waits, for the arm or for time.
    Waits,
    /// The program has reached its end.
    Ended,
    /// The interpreter cannot continue: file, line and reason.
    Fault(String),
}

/// The result of a step.
pub(super) enum StepFlow {
    Next,
    /// The same step must be executed again later.
    Wait,
    Ended,
}

/// The error of a step: a message, boxed so that the result of a successful step stays small.
#[derive(Debug)]
#[allow(clippy::box_collection, reason = "a result is twice as large with the text itself")]
pub(super) struct StepError(Box<String>);

impl From<String> for StepError {
    fn from(message: String) -> Self {
        StepError(Box::new(message))
    }
}

impl From<&str> for StepError {
    fn from(message: &str) -> Self {
        StepError(Box::new(message.to_owned()))
    }
}

impl From<StepError> for String {
    fn from(wrong: StepError) -> Self {
        *wrong.0
    }
}

/// The result of a step, or its error.
pub(super) type StepResult = Result<StepFlow, StepError>;

//! The result of executing a statement or a step.

/// The way in which a step ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Pause {
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
pub(super) enum Flow {
    Next,
    /// The same step must be executed again later.
    Wait,
    Ended,
}

/// The error of a step: a message, boxed so that the result of a successful step stays small.
#[derive(Debug)]
#[allow(clippy::box_collection, reason = "a result is twice as large with the text itself")]
pub(super) struct Wrong(Box<String>);

impl From<String> for Wrong {
    fn from(message: String) -> Self {
        Wrong(Box::new(message))
    }
}

impl From<&str> for Wrong {
    fn from(message: &str) -> Self {
        Wrong(Box::new(message.to_owned()))
    }
}

impl From<Wrong> for String {
    fn from(wrong: Wrong) -> Self {
        *wrong.0
    }
}

/// The result of a step, or its error.
pub(super) type Stepped = Result<Flow, Wrong>;

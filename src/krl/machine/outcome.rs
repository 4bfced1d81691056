//! How a step or a statement ends.

/// How a step ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Pause {
    /// The statement is over.
    Statement,
    /// It waits, for the arm or for time.
    Waits,
    /// The program is at its end.
    Ended,
    /// It cannot continue: file, line and reason.
    Fault(String),
}

/// What a step comes to.
pub(super) enum Flow {
    Next,
    /// The same step again, later.
    Wait,
    Ended,
}

/// How a step can go wrong: a message, behind a pointer so that what goes right stays small.
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

/// How a step ended, or what was wrong with it.
pub(super) type Stepped = Result<Flow, Wrong>;

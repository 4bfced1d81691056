//! The steps of a transaction at which tests look at the files.

/// Moments at which a process may end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    Prepared,
    Committed,
    Settled,
}

/// A hook with which tests look at the files at each step; the program does not use it.
#[derive(Default)]
pub(super) struct Steps {
    #[cfg(test)]
    pub told: Option<Box<dyn Fn(Step) + Send>>,
}

impl std::fmt::Debug for Steps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Steps")
    }
}

impl Steps {
    #[cfg_attr(not(test), expect(clippy::unused_self, reason = "only tests look"))]
    pub fn reach(&self, step: Step) {
        #[cfg(test)]
        if let Some(told) = &self.told {
            told(step);
        }
        let _ = step;
    }
}

//! The compliant tool as the loop sees it. No command blocks for an answer of the tool.

use super::port::{Command, Port};
use panelprep_cell::force::ForceSetPoint;
use panelprep_devices::acf::{ConnectedTool, ToolReport};
use serde::Serialize;

/// The requests to the tool.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ToolCommand {
    /// From now on, presses with these set-points.
    Press(ForceSetPoint),
    /// Reports the news.
    Report,
}

/// An answer of the tool.
#[derive(Debug, Clone, PartialEq)]
pub enum ToolAnswer {
    /// Answer to `Press`.
    Done,
    /// Answer to `Report`: a reading or the loss of the tool's link; `None` if there is nothing new.
    Report(Option<ToolReport>),
}

impl Command for ToolCommand {
    type Answer = ToolAnswer;
}

/// The tool's commands as functions.
pub trait ToolPort: Port<ToolCommand> {
    /// See [`ToolCommand::Press`].
    fn set_force(&mut self, press: ForceSetPoint) {
        self.perform(ToolCommand::Press(press));
    }

    /// See [`ToolCommand::Report`].
    fn next_report(&mut self) -> Option<ToolReport> {
        let ToolAnswer::Report(news) = self.perform(ToolCommand::Report) else { return None };
        news
    }
}

impl<P: Port<ToolCommand> + ?Sized> ToolPort for P {}

/// A tool that is connected by a link; `None` if the tool is a spring.
#[derive(Default)]
pub struct LinkedTool(Option<Box<dyn ConnectedTool>>);

impl LinkedTool {
    /// Links this tool.
    pub fn new(tool: impl ConnectedTool + 'static) -> Self {
        LinkedTool(Some(Box::new(tool)))
    }
}

impl Port<ToolCommand> for LinkedTool {
    fn perform(&mut self, command: ToolCommand) -> ToolAnswer {
        match (command, &mut self.0) {
            (ToolCommand::Press(press), Some(tool)) => {
                tool.set_force(press);
                ToolAnswer::Done
            }
            (ToolCommand::Press(_), None) => ToolAnswer::Done,
            (ToolCommand::Report, tool) => ToolAnswer::Report(tool.as_mut().and_then(|tool| tool.next_report())),
        }
    }
}

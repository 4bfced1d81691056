//! The table of all OPC UA methods, each with its request, arguments and required permission. Methods that are not in
//! the table cannot be called.

use panelprep_cell::accounts::{Permission, Role};

/// The requests of the methods. Each is a request of the service, with the same checks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::VariantArray)]
#[expect(missing_docs, reason = "the names are the requests of the service")]
pub enum Command {
    Reset,
    Start,
    Hold,
    Unhold,
    Stop,
    Abort,
    Clear,
    Accept,
    NewDisc,
    AcknowledgeAlarm,
}

/// The data type of an argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArgumentKind {
    /// A text.
    String,
    /// True or false.
    Boolean,
    /// A whole number.
    UInt32,
}

impl ArgumentKind {
    /// Returns the name of the OPC UA data type.
    pub fn name(self) -> &'static str {
        match self {
            ArgumentKind::String => "String",
            ArgumentKind::Boolean => "Boolean",
            ArgumentKind::UInt32 => "UInt32",
        }
    }
}

/// An argument of a method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Argument {
    /// Name of the argument.
    pub name: &'static str,
    /// Data type of the argument.
    pub kind: ArgumentKind,
    /// Description of the argument.
    pub meaning: &'static str,
}

/// An OPC UA method of the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Method {
    /// Name of the method.
    pub name: &'static str,
    /// The request that the method makes.
    pub command: Command,
    /// The arguments of the method.
    pub arguments: &'static [Argument],
    /// The permission that the caller needs; `None` if every session may call the method.
    pub required_permission: Option<Permission>,
    /// Description of the method.
    pub meaning: &'static str,
}

impl Method {
    /// Returns whether a caller with this role may call the method; `None` for a caller without an account.
    pub fn is_allowed(&self, role: Option<Role>) -> bool {
        self.required_permission.is_none_or(|permission| role.is_some_and(|role| role.has_permission(permission)))
    }
}

const fn text(name: &'static str, meaning: &'static str) -> Argument {
    Argument { name, kind: ArgumentKind::String, meaning }
}

const fn method_without_arguments(
    name: &'static str,
    command: Command,
    needs: Option<Permission>,
    meaning: &'static str,
) -> Method {
    Method { name, command, arguments: &[], required_permission: needs, meaning }
}

use Permission::{Accept, Acknowledge, Operate};

const STEP: Argument = Argument {
    name: "Step",
    kind: ArgumentKind::UInt32,
    meaning: "Value of Cycle/Step when the decision was made. The call is refused if the step has changed since then.",
};

/// All methods of the server.
pub const METHODS: &[Method] = &[
    method_without_arguments(
        "Reset",
        Command::Reset,
        Some(Operate),
        "From Stopped or Complete to Idle: all outputs are switched off, and a self-test without motion is performed.",
    ),
    Method {
        name: "Start",
        command: Command::Start,
        arguments: &[
            text("Recipe", "The file name of a recipe in the folder of [page] recipes, such as panel.toml."),
            text(
                "RecipeHash",
                "SHA-256 of the recipe on which the decision was made, from Recipes/Hashes. The call is refused if \
                 the recipe was changed since then.",
            ),
            text("SerialNumber", "The serial number of the part; empty for a part without one."),
            text("WorkOrder", "The work order of the part; empty without a work order."),
            Argument {
                name: "AnotherPart",
                kind: ArgumentKind::Boolean,
                meaning: "True if a different part is in the fixture than in the earlier cycles: the sanding passes of this part are counted from zero. The value is recorded with the cycle.",
            },
        ],
        required_permission: Some(Operate),
        meaning: "From Idle: starts a cycle on the panel in the fixture. The record names the logged-in person as \
                  the operator.",
    },
    method_without_arguments(
        "Hold",
        Command::Hold,
        Some(Operate),
        "Interrupts the work: switches the tool off, retracts it, and ends in Held.",
    ),
    Method {
        name: "Unhold",
        command: Command::Unhold,
        arguments: &[
            Argument {
                name: "Dried",
                kind: ArgumentKind::Boolean,
                meaning: "True if a person has dried the panel: the panel is located again.",
            },
            STEP,
        ],
        required_permission: Some(Operate),
        meaning: "Continues from Held, after the panel's pose was verified.",
    },
    method_without_arguments(
        "Stop",
        Command::Stop,
        None,
        "Ends the cycle; the unit ends in Stopped. This is not an emergency stop.",
    ),
    method_without_arguments(
        "Abort",
        Command::Abort,
        None,
        "Ends everything immediately; the unit ends in Aborted. This is not an emergency stop.",
    ),
    Method {
        name: "Clear",
        command: Command::Clear,
        arguments: &[STEP],
        required_permission: Some(Operate),
        meaning: "From Aborted to Stopped: a person confirms that the cause is removed and the pad is off the \
                  panel.",
    },
    Method {
        name: "Accept",
        command: Command::Accept,
        arguments: &[STEP],
        required_permission: Some(Accept),
        meaning: "Accepts the result and continues from Held for review.",
    },
    method_without_arguments(
        "NewDisc",
        Command::NewDisc,
        Some(Operate),
        "Records that a new disc was mounted, while the cell is at \
                                                       rest.",
    ),
    Method {
        name: "AcknowledgeAlarm",
        command: Command::AcknowledgeAlarm,
        arguments: &[text("Alarm", "ID of the alarm, from Alarms/Ids.")],
        required_permission: Some(Acknowledge),
        meaning: "Records that the person has seen an alarm. The alarm and the cell do not change.",
    },
];

/// Returns the method with this name.
pub fn method(name: &str) -> Option<&'static Method> {
    METHODS.iter().find(|method| method.name == name)
}

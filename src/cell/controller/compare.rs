//! Compares the controller's files with the cell's file and with each other. Each contradiction is reported with the
//! file, the line and the key that must be corrected. Unchanged files of a correct cell have no contradictions.
//!
//! The last part compares the calls in the controller's programs with the routines that exist: the cell's own
//! subroutines, and the calls in KUKA's program of the submit interpreter.

use super::data::DataComparison;
use super::data_list::{DataList, Number, compare_declarations};
use super::names::{COMMANDS, CONFIG, Difference, Differences, MOTION, STATES, SUBMIT, USER, is_named};
use super::sum::text_sum;
use crate::cell::{Cell, RobotKind};
use panelprep_kuka::eki::{CELLCMD, CELLSTAT, ChannelFile, Element};
use panelprep_kuka::krl::{StatedCall, StatedRoutine, parse};
use std::collections::BTreeSet;

/// The texts of the files on the controller. A file that is `None` is not compared.
#[derive(Debug, Clone, Copy, Default)]
pub struct ControllerFiles<'a> {
    /// The text of `cell_config.dat`.
    pub config: Option<&'a str>,
    /// The text of `cell_motion.src`.
    pub motion: Option<&'a str>,
    /// The text of `CELLCMD.xml`.
    pub commands: Option<&'a str>,
    /// The text of `CELLSTAT.xml`.
    pub states: Option<&'a str>,
    /// The text of `cell_user.src`.
    pub user: Option<&'a str>,
    /// The text of `sps.sub`.
    pub submit: Option<&'a str>,
    /// The IP addresses of the controller, if the cell's file states a host name and this name was resolved.
    pub host_addresses: &'a [[u8; 4]],
}

impl<'a> ControllerFiles<'a> {
    /// Selects the controller's files from a list of file names and texts.
    pub fn among(files: &[(&str, &'a str)]) -> Self {
        let text = |name: &str| files.iter().find(|(file, _)| is_named(file, name)).map(|(_, text)| *text);
        ControllerFiles {
            config: text(CONFIG),
            motion: text(MOTION),
            commands: text(COMMANDS),
            states: text(STATES),
            user: text(USER),
            submit: text(SUBMIT),
            host_addresses: &[],
        }
    }
}

/// The result of a comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The contradictions that were found.
    pub differences: Vec<Difference>,
    /// Values that could not be compared, each with the reason.
    pub not_compared: Vec<String>,
}

/// Returns the contradictions between the controller's programs; the cell's file is not needed.
pub fn among_programs(files: &ControllerFiles<'_>) -> Vec<Difference> {
    let mut found = Differences::default();
    let config = files.config.map(|text| DataList::parse(CONFIG, text));
    if let Some(config) = &config {
        compare_declarations(config, &mut found);
    }
    found.compare_calls(files, config.as_ref());
    found.0
}

/// Returns the contradictions between the controller's files, and between these files and the cell's file.
pub fn compare(files: &ControllerFiles<'_>, cell: &Cell) -> Comparison {
    let mut found = Differences::default();
    let mut not_compared = Vec::new();
    let config = files.config.map(|text| DataList::parse(CONFIG, text));
    if let Some(config) = &config {
        let missing = compare_declarations(config, &mut found);
        DataComparison { config, missing, cell, found: &mut found }.compare_all();
    }
    found.compare_calls(files, config.as_ref());
    let ports = [cell.robot().command_port(), cell.robot().state_port()];
    let channels = [
        (COMMANDS, files.commands, CELLCMD, ["CELL_F_CMD_ALIVE", "CELL_F_CMD_CAME"], (ports[0], ports[1])),
        (STATES, files.states, CELLSTAT, ["CELL_F_STAT_ALIVE", "CELL_F_STAT_CAME"], (ports[1], ports[0])),
    ];
    for (file, text, ours, flags, ports) in channels {
        let Some(text) = text else { continue };
        let Some((theirs, ours)) = found.parse_channel(file, text, ours) else { continue };
        found.compare_settings(file, &theirs, &ours);
        if let Some(config) = &config {
            found.compare_channel_flags(file, text, (&theirs, config), flags);
        }
        if cell.robot().kind() == RobotKind::Eki {
            not_compared.extend(found.compare_address(
                (file, text),
                &theirs,
                cell.robot().host(),
                files.host_addresses,
            ));
            found.compare_port(file, text, &theirs, ports);
        }
    }
    if let (Some(text), Some(config)) = (files.motion, &config) {
        found.compare_interrupts(text, config);
    }
    Comparison { differences: found.0, not_compared }
}

impl Differences {
    /// Compares the calls in the controller's programs with the routines that exist.
    fn compare_calls(&mut self, files: &ControllerFiles<'_>, config: Option<&DataList>) {
        if let Some(text) = files.user {
            check_subroutines(text, config, self);
        }
        if let Some(text) = files.submit {
            check_submit_calls(text, self);
        }
    }

    /// Parses the file of a channel, and the file of the same channel in this release. A file that cannot be parsed is
    /// reported as a difference.
    fn parse_channel(&mut self, file: &'static str, text: &str, ours: &str) -> Option<(ChannelFile, ChannelFile)> {
        match (ChannelFile::parse(text), ChannelFile::parse(ours)) {
            (Ok(theirs), Ok(ours)) => Some((theirs, ours)),
            (Err(error), _) | (_, Err(error)) => {
                self.note(file, 1, "", error.to_string());
                None
            }
        }
    }

    /// Compares the elements and the transfer settings of a channel. The address, the port and the flags are specific
    /// to the cell.
    fn compare_settings(&mut self, file: &'static str, theirs: &ChannelFile, ours: &ChannelFile) {
        self.compare_elements(file, "RECEIVE", (&theirs.received, &ours.received));
        self.compare_elements(file, "SEND", (&theirs.sent, &ours.sent));
        let (expected, found) = (ours.peer, theirs.peer);
        if found != expected {
            self.note(
                file,
                1,
                "CONFIGURATION/EXTERNAL/TYPE",
                format!("is {found}, must be {expected}, because the PC is the client"),
            );
        }
        if theirs.environment != ours.environment {
            let message = "must be Submit, as in this program's own file: the channel must exist as long as the submit \
                           interpreter runs";
            self.note(file, 1, "CONFIGURATION/INTERNAL/ENVIRONMENT", message);
        }
        if theirs.protocol != ours.protocol {
            self.note(
                file,
                1,
                "CONFIGURATION/INTERNAL/PROTOCOL",
                "is not TCP, the protocol that the PC uses; write TCP",
            );
        }
        if theirs.memory != ours.memory {
            let message = format!(
                "found {} entries in {} order and {} bytes; this program expects {} entries in {} order and {} bytes",
                theirs.memory.entries,
                theirs.memory.order,
                theirs.memory.bytes,
                ours.memory.entries,
                ours.memory.order,
                ours.memory.bytes
            );
            self.note(file, 1, "CONFIGURATION/INTERNAL/BUFFERING", message);
        }
        if (theirs.ping, theirs.alive_out, theirs.connect_timeout_ms)
            != (ours.ping, ours.alive_out, ours.connect_timeout_ms)
        {
            let message = "Ping, Set_Out or TIMEOUT differs from this program's own file; remove the additions";
            self.note(file, 1, "CONFIGURATION/INTERNAL", message);
        }
    }

    /// Compares the XML elements of one direction, in their order.
    fn compare_elements(&mut self, file: &'static str, section: &str, (theirs, ours): (&[Element], &[Element])) {
        let what = |element: &Element| {
            let flags = (element.set_out, element.set_flag.is_some());
            (element.tag.clone(), element.kind, element.order, flags)
        };
        let (found, expected): (Vec<_>, Vec<_>) =
            (theirs.iter().map(what).collect(), ours.iter().map(what).collect());
        if found == expected {
            return;
        }
        let place = found.iter().zip(&expected).position(|(found, expected)| found != expected);
        let place = place.unwrap_or(found.len().min(expected.len()));
        let word = |elements: &[Element]| {
            elements.get(place).map_or("nothing".to_owned(), |it| {
                let kind = it.kind.map_or("no type".to_owned(), |kind| kind.to_string());
                format!("{} ({kind})", it.tag)
            })
        };
        let line = theirs.get(place).or(theirs.last()).map_or(1, |element| element.line);
        let message = format!(
            "position {} is {}, but this program's own file has {}; copy {file} from this program's config/kuka",
            place + 1,
            word(theirs),
            word(ours)
        );
        self.note(file, line, format!("{section} ELEMENT"), message);
    }

    fn compare_channel_flags(
        &mut self,
        file: &'static str,
        text: &str,
        (theirs, config): (&ChannelFile, &DataList),
        [alive, came]: [&str; 2],
    ) {
        let came_by: Vec<&Element> = theirs.received.iter().filter(|element| element.set_flag.is_some()).collect();
        let raised = [
            (alive, theirs.alive_flag, find_line(text, "<ALIVE"), "CONFIGURATION/INTERNAL/ALIVE".to_owned()),
            (
                came,
                came_by.first().and_then(|element| element.set_flag),
                came_by.first().map_or(1, |element| element.line),
                "RECEIVE ELEMENT".to_owned(),
            ),
        ];
        for (name, flag, line, key) in raised {
            let Some(stated) = config.get(name) else { continue };
            if flag.map(f64::from) != Some(stated.value) {
                let found = flag.map_or("sets no flag".to_owned(), |flag| format!("sets $FLAG[{flag}]"));
                let message = format!(
                    "{found}, but {name} of {CONFIG} (line {}) is {}: the program would never detect the flag; make \
                     both the same",
                    stated.line, stated.value
                );
                self.note(file, line, key, message);
            }
        }
        if came_by.len() > 1 {
            let message =
                "two elements set a flag; only the root element may set one, when the whole message has arrived";
            self.note(file, came_by[1].line, "RECEIVE ELEMENT", message);
        }
    }

    /// Compares the address on which the controller listens with the host in the cell's file. Returns the reason if the
    /// comparison is not possible.
    fn compare_address(
        &mut self,
        (file, text): (&'static str, &str),
        theirs: &ChannelFile,
        host: &str,
        host_addresses: &[[u8; 4]],
    ) -> Option<String> {
        let key = "CONFIGURATION/INTERNAL/IP";
        let Some(stated) = &theirs.address else {
            let message = format!(
                "is missing: the file does not state the address on which the controller listens; write <IP> with its address, as \
                 [robot] host of the cell's file ({host})"
            );
            self.note(file, find_line(text, "<INTERNAL>"), key, message);
            return None;
        };
        let Some(listens) = parse_ipv4(stated) else {
            let message = format!(
                "is \"{stated}\", which is not an address: the controller cannot listen there; write four numbers, as \
                 [robot] host of the cell's file ({host})"
            );
            self.note(file, find_line(text, "<IP>"), key, message);
            return None;
        };
        let own = parse_ipv4(host).or((host == "localhost").then_some([127, 0, 0, 1]));
        let addresses: Vec<[u8; 4]> = own.into_iter().chain(host_addresses.iter().copied()).collect();
        if addresses.is_empty() {
            return Some(format!(
                "[robot] host is the name {host}: its address is not known here, so it is not compared with {stated}, at \
                 which {file} listens"
            ));
        }
        if !addresses.contains(&listens) {
            let message = format!(
                "is {stated}, and [robot] host of the cell's file is {host}{}: the controller listens at the first, \
                 the PC connects to the second; make both the same",
                format_resolved_addresses(host, &addresses)
            );
            self.note(file, find_line(text, "<IP>"), key, message);
        }
        None
    }

    fn compare_port(&mut self, file: &'static str, text: &str, theirs: &ChannelFile, (port, others): (u16, u16)) {
        if theirs.port == port {
            return;
        }
        let what = if theirs.port == others {
            "command_port and state_port are exchanged"
        } else {
            "the PC could not connect"
        };
        let message =
            format!("is {}, but [robot] of the cell's file has {port}: {what}; make both the same", theirs.port);
        self.note(file, find_line(text, "<PORT>"), "CONFIGURATION/INTERNAL/PORT", message);
    }

    /// Compares the numbers in INTERRUPT DECL with those of the data list: KRL accepts no variable names in these
    /// lines.
    fn compare_interrupts(&mut self, text: &str, config: &DataList) {
        for (number, variable, name) in
            [(20, "$FLAG", "CELL_F_HALT"), (21, "$FLAG", "CELL_F_STOP"), (22, "$TIMER_FLAG", "CELL_T_SUBMIT")]
        {
            let Some(stated) = config.get(name) else { continue };
            let declared = format!("INTERRUPT DECL {number} WHEN {variable}[");
            let place = text.lines().enumerate().find_map(|(index, line)| {
                let rest = line.split(';').next().unwrap_or_default().trim().strip_prefix(&declared)?;
                Some((index + 1, rest.split(']').next()?.trim().parse::<f64>().ok()))
            });
            let key = format!("INTERRUPT DECL {number}");
            match place {
                None => self.note(
                    MOTION,
                    1,
                    key,
                    format!("is missing; this interrupt must monitor {variable} with the number {name}"),
                ),
                Some((line, found)) if found != Some(stated.value) => {
                    let found = found.map_or("no number".to_owned(), |found| found.to_string());
                    let message = format!(
                        "monitors {variable}[{found}], but {name} of {CONFIG} (line {}) is {}: the stop would not be \
                         detected; make both the same",
                        stated.line, stated.value
                    );
                    self.note(MOTION, line, key, message);
                }
                Some(_) => {}
            }
        }
    }
}

fn find_line(text: &str, what: &str) -> usize {
    text.lines().position(|line| line.contains(what)).map_or(1, |index| index + 1)
}

/// Parses an IPv4 address; `None` if the text is a host name.
fn parse_ipv4(text: &str) -> Option<[u8; 4]> {
    let numbers = text.trim().split('.').map(|number| number.parse().ok()).collect::<Option<Vec<u8>>>()?;
    numbers.try_into().ok()
}

/// Returns the resolved IP addresses of a host name, in parentheses; empty if the host is an IP address.
fn format_resolved_addresses(host: &str, addresses: &[[u8; 4]]) -> String {
    if parse_ipv4(host).is_some() {
        return String::new();
    }
    let each: Vec<String> = addresses.iter().map(|[a, b, c, d]| format!("{a}.{b}.{c}.{d}")).collect();
    format!(" ({})", each.join(", "))
}

/// The routine that `cell_motion.src` calls to execute a subroutine.
const DISPATCHER_ROUTINE: &str = "CELL_USER_CALL";
/// The variable with the number of subroutines.
const COUNT_VARIABLE: &str = "CELL_USER_N";
/// The variable with the checksum of the subroutines' text.
const CHECKSUM_VARIABLE: &str = "CELL_USER_REVISION";
/// Maximum number of cases that one message lists.
const MAX_LISTED_CASES: usize = 8;

/// Compares the cell's own subroutines with the number of subroutines and the checksum of their text in the data list.
pub(super) fn check_subroutines(text: &str, config: Option<&DataList>, found: &mut Differences) {
    match parse(USER, text).stated_routine(DISPATCHER_ROUTINE) {
        None => {
            let message = "is missing: cell_motion calls each subroutine by this routine, and the controller would \
                           not select the program; write `GLOBAL DEF CELL_USER_CALL(N:IN)`, as in this program's own file";
            found.note(USER, 1, DISPATCHER_ROUTINE, message);
        }
        Some(routine) => {
            dispatcher(&routine, found);
            if let Some(count) = config.and_then(|config| config.get(COUNT_VARIABLE)) {
                check_cases(&routine, count, found);
            }
        }
    }
    let Some(stated) = config.and_then(|config| config.get(CHECKSUM_VARIABLE)) else { return };
    let computed = text_sum(text);
    if stated.value != computed as f64 {
        let message = format!(
            "is {}, and the text of {USER} has the sum {computed}: it was edited, or is another file; write {computed}, \
             so that the sum that the controller reports follows from it",
            stated.value
        );
        found.note(CONFIG, stated.line, CHECKSUM_VARIABLE, message);
    }
}

fn dispatcher(routine: &StatedRoutine, found: &mut Differences) {
    if !routine.global {
        let message = "is not GLOBAL: cell_motion would not find it; write `GLOBAL DEF CELL_USER_CALL(N:IN)`";
        found.note(USER, routine.line, DISPATCHER_ROUTINE, message);
    }
    if routine.parameters != 1 {
        let message = format!("has {} parameters, but cell_motion passes one: N:IN", routine.parameters);
        found.note(USER, routine.line, DISPATCHER_ROUTINE, message);
    }
    for switch in routine.switches.iter().filter(|switch| !switch.is_on_first_parameter) {
        let message = "does not branch by the first parameter of CELL_USER_CALL, which is the index that the PC calls: \
                       another subroutine, or none, would be executed and reported; write SWITCH with that parameter";
        found.note(USER, switch.line, "SWITCH", message);
    }
}

/// Compares the CASE branches with the number of subroutines: every index below this number needs its own CASE.
fn check_cases(routine: &StatedRoutine, count: Number, found: &mut Differences) {
    let Some(counted) = count.as_integer().filter(|count| (0..=1_000).contains(count)) else { return };
    let stated: BTreeSet<i32> = routine.cases.iter().map(|case| case.value).collect();
    let missing: Vec<i32> = (0..counted).filter(|index| !stated.contains(index)).collect();
    if !missing.is_empty() {
        let mut listed: Vec<String> = missing.iter().take(MAX_LISTED_CASES).map(i32::to_string).collect();
        if missing.len() > MAX_LISTED_CASES {
            listed.push(format!("{} more", missing.len() - MAX_LISTED_CASES));
        }
        let message = format!(
            "has no CASE {}, and {COUNT_VARIABLE} of {CONFIG} (line {}) counts {counted}: such a call would do nothing and be \
             reported as executed; add the cases, or lower the number",
            listed.join(", "),
            count.line
        );
        found.note(USER, routine.line, DISPATCHER_ROUTINE, message);
    }
    for case in &routine.cases {
        let key = format!("CASE {}", case.value);
        if !(0..counted).contains(&case.value) {
            let message = format!(
                "is never called: {COUNT_VARIABLE} of {CONFIG} (line {}) counts {counted}, from 0; increase this number, or remove the case",
                count.line
            );
            found.note(USER, case.line, key, message);
        } else if case.is_empty {
            let message = "does nothing, and a call would be reported as executed; call a subroutine there";
            found.note(USER, case.line, key, message);
        }
    }
}

/// Reports additional calls: CELL_INIT and CELL_CYCLE must each be called exactly once, in the main routine.
fn note_additional_calls(main: &[StatedCall], others: &[StatedCall], found: &mut Differences) {
    for (name, effect) in [
        ("CELL_INIT", "each call ends the epoch and closes the channels"),
        ("CELL_CYCLE", "the cycle of the link would run twice in each pass of the loop"),
    ] {
        for call in main.iter().filter(|call| call.name == name).skip(1) {
            found.note(SUBMIT, call.line, name, format!("is called a second time: {effect}; remove this call"));
        }
        for call in others.iter().filter(|call| call.name == name) {
            let message = format!("is called outside of the main routine: {effect}; remove this call");
            found.note(SUBMIT, call.line, name, message);
        }
    }
}

/// Checks that the program of the submit interpreter calls CELL_INIT once before its loop, and CELL_CYCLE inside the
/// loop.
pub(super) fn check_submit_calls(text: &str, found: &mut Differences) {
    let file = parse(SUBMIT, text);
    let calls = file.main_calls();
    note_additional_calls(&calls, &file.other_calls(), found);
    let first = |name: &str| calls.iter().find(|call: &&StatedCall| call.name == name);
    let (begins, cycles) = (first("CELL_INIT"), first("CELL_CYCLE"));
    match begins {
        None => {
            let message =
                "is not called: the channels would not be opened; write CELL_INIT( ) into the fold USER INIT";
            found.note(SUBMIT, 1, "CELL_INIT", message);
        }
        Some(call) if call.in_loop || cycles.is_some_and(|cycle| cycle.line < call.line) => {
            let message = "is called in the loop or after CELL_CYCLE( ): each call ends the epoch and closes the \
                           channels; write it into the fold USER INIT, before LOOP";
            found.note(SUBMIT, call.line, "CELL_INIT", message);
        }
        Some(_) => {}
    }
    match cycles {
        None => {
            let message = "is not called: no command is read and no stop is received; write CELL_CYCLE( ) into the fold \
                           USER PLC";
            found.note(SUBMIT, 1, "CELL_CYCLE", message);
        }
        Some(call) if !call.in_loop => {
            let message = "is called outside of the loop, so only once, and no later stop is received; write it into the \
                           fold USER PLC, between LOOP and ENDLOOP";
            found.note(SUBMIT, call.line, "CELL_CYCLE", message);
        }
        Some(_) => {}
    }
}

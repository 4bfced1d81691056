//! `[tool]`: the kind of the sanding tool, which presses with a spring or with its own force control, and the settings
//! of a force-controlled (compliant) tool.

use super::devices::is_valid_host;
use panelprep_base::config::{Choice, Section};
use panelprep_base::geometry::STANDARD_GRAVITY_M_S2;
use panelprep_base::number_text::distinguishable_texts;

/// The tool that presses the disc onto the panel.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Tool {
    /// `kind = "spring"`: a pad on a spring, fixed to the flange; it receives no commands.
    #[default]
    Spring,
    /// A tool with its own force control.
    Compliant(CompliantTool),
}

impl Tool {
    /// Returns the settings of a compliant tool; `None` for a spring.
    pub fn compliant(&self) -> Option<&CompliantTool> {
        match self {
            Tool::Spring => None,
            Tool::Compliant(tool) => Some(tool),
        }
    }
}

/// The settings of a tool with its own force control.
#[derive(Debug, Clone, PartialEq)]
pub struct CompliantTool {
    /// The tool's network address; `None` for the simulated tool.
    pub address: Option<ToolAddress>,
    /// The word with which the program logs in to the tool.
    pub login: String,
    /// The tool's id in telegrams.
    pub id: u16,
    /// Length of the actuator's stroke, mm; the tool centre point is calibrated at half the stroke.
    pub stroke_mm: f64,
    /// Maximum pulling force of the actuator, N, as a negative number. The pull holds the pad back when it is in the
    /// air.
    pub min_force_n: f64,
    /// Maximum pushing force of the actuator, N.
    pub max_force_n: f64,
    /// The mass that the actuator carries, kg.
    pub payload_kg: f64,
    /// The force that the tool's sensor measures without load, N.
    pub zero_n: f64,
    /// Period of the commands to the tool, ms.
    pub period_ms: u16,
    /// Maximum time until the tool replies, ms.
    pub reply_ms: u16,
    /// Maximum deviation of the force from its set-point, N.
    pub band_n: f64,
    /// Maximum time for which the deviation may be larger than `band_n`, ms.
    pub band_ms: u16,
    /// Maximum time without contact while the tool presses, ms.
    pub contact_ms: u16,
}

/// The network address of a tool and its login.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ToolAddress {
    /// Host name or IP address of the tool's controller.
    pub host: String,
    /// TCP port of the tool's controller.
    pub port: u16,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ToolKind {
    Spring,
    Simulated,
    Acf,
}

impl Choice for ToolKind {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("spring", ToolKind::Spring), ("simulated", ToolKind::Simulated), ("acf", ToolKind::Acf)];
}

/// Keys of every compliant tool. `ACF_KEYS` are the additional keys of a tool that is connected over the network.
const COMPLIANT_KEYS: [&str; 10] = [
    "stroke_mm",
    "min_force_n",
    "max_force_n",
    "payload_kg",
    "zero_n",
    "period_ms",
    "reply_ms",
    "band_n",
    "band_ms",
    "contact_ms",
];
const ACF_KEYS: [&str; 4] = ["host", "tcp_port", "login", "id"];
/// Keys that the file must state for a tool on the network, because their values have no default.
const REQUIRED: [(&str, &str); 5] = [
    ("host", "kind = \"acf\" needs the address of its controller"),
    ("stroke_mm", "kind = \"acf\" needs its stroke, in mm, from its data sheet"),
    ("min_force_n", "kind = \"acf\" needs the maximum pulling force, in N, as a negative number"),
    ("max_force_n", "kind = \"acf\" needs the maximum pushing force, in N"),
    ("payload_kg", "kind = \"acf\" needs the mass that it carries, in kg; `panelprep calibrate force` measures it"),
];

pub(super) fn parse_tool(section: &Section<'_, '_>) -> Option<Tool> {
    let kind = section.parse("kind", (), Some(ToolKind::Spring));
    let host = section.parse::<Option<String>>("host", (), Some(None));
    let port = section.parse("tcp_port", 1..=65_535, Some(7_070_u16));
    let login = section.parse::<String>("login", (), Some("ferba".to_owned()));
    let id = section.parse("id", 0..=65_535, Some(1_040_u16));
    // The defaults belong to the simulated tool; for a real tool these keys are required.
    let stroke_mm = section.parse("stroke_mm", 2.0..=200.0, Some(30.0));
    let min_force_n = section.parse("min_force_n", -1_000.0..=-1.0, Some(-60.0));
    let max_force_n = section.parse("max_force_n", 1.0..=1_000.0, Some(100.0));
    let payload_kg = section.parse("payload_kg", 0.0..=50.0, Some(1.5));
    let zero_n = section.parse("zero_n", -50.0..=50.0, Some(0.0));
    let period_ms = section.parse("period_ms", 4..=50, Some(10_u16));
    let reply_ms = section.parse("reply_ms", 10..=150, Some(100_u16));
    let band_n = section.parse("band_n", 0.5..=100.0, Some(5.0));
    let band_ms = section.parse("band_ms", 20..=200, Some(150_u16));
    let contact_ms = section.parse("contact_ms", 20..=250, Some(200_u16));
    section.finish();
    let (kind, host, login) = (kind?, host?, login?);
    if !check_keys(section, kind, (host.as_deref(), &login)) {
        return None;
    }
    let tool = CompliantTool {
        address: host
            .filter(|_| kind == ToolKind::Acf)
            .map(|host| ToolAddress { host, port: port.unwrap_or_default() }),
        login,
        id: id?,
        stroke_mm: stroke_mm?,
        min_force_n: min_force_n?,
        max_force_n: max_force_n?,
        payload_kg: payload_kg?,
        zero_n: zero_n?,
        period_ms: period_ms?,
        reply_ms: reply_ms?,
        band_n: band_n?,
        band_ms: band_ms?,
        contact_ms: contact_ms?,
    };
    if kind == ToolKind::Spring {
        return Some(Tool::Spring);
    }
    let weighs_n = tool.payload_kg * STANDARD_GRAVITY_M_S2;
    if -tool.min_force_n <= weighs_n {
        let [found, allowed] = distinguishable_texts(tool.min_force_n, -weighs_n, 1);
        let message = format!(
            "found {found}, must be below {allowed}, the weight of payload_kg: in the air, this force must hold the \
             payload back in every orientation"
        );
        section.problem("min_force_n", message);
        return None;
    }
    Some(Tool::Compliant(tool))
}

/// Returns whether all required keys are present, every key has an effect, and address and login are valid. Each
/// problem is reported.
fn check_keys(section: &Section<'_, '_>, kind: ToolKind, (host, login): (Option<&str>, &str)) -> bool {
    let mut right = true;
    let mut wrong = |key: &str, message: String| {
        section.problem(key, message);
        right = false;
    };
    let word = ToolKind::KEYWORDS.iter().find(|(_, known)| *known == kind).map_or("", |(word, _)| word);
    let of_compliant =
        COMPLIANT_KEYS.iter().filter(|_| kind == ToolKind::Spring).map(|key| (*key, "\"simulated\" or \"acf\""));
    let of_acf = ACF_KEYS.iter().filter(|_| kind != ToolKind::Acf).map(|key| (*key, "\"acf\""));
    for (key, needs) in of_compliant.chain(of_acf).filter(|(key, _)| section.has_key(key)) {
        wrong(key, format!("has no effect with kind = \"{word}\"; this key is valid only with kind = {needs}"));
    }
    for (key, what_to_do) in REQUIRED.iter().filter(|(key, _)| kind == ToolKind::Acf && !section.has_key(key)) {
        wrong(key, format!("is missing; {what_to_do}"));
    }
    if let Some(host) = host.filter(|host| !is_valid_host(host)) {
        wrong("host", format!("found \"{host}\", valid: an address such as 172.31.1.150, or a host name"));
    }
    let is_word =
        (1..=32).contains(&login.len()) && login.bytes().all(|byte| byte.is_ascii_graphic() && byte != b'k');
    if !is_word {
        wrong(
            "login",
            format!(
                "found \"{login}\", valid: 1 to 32 printable ASCII characters without spaces and without k, which ends \
                 a telegram"
            ),
        );
    }
    right
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    fn tool(text: &str) -> Tool {
        Cell::check("f", text).unwrap_or_else(|problems| panic!("{problems}")).tool().clone()
    }

    const ACF: &str = "[tool]\nkind = 'acf'\nhost = '172.31.1.150'\nstroke_mm = 35.5\nmin_force_n = -100\nmax_force_n = 100\n\
                       payload_kg = 2.1\n";

    #[test]
    fn a_spring_is_the_default_and_a_compliant_tool_needs_all_values() {
        assert_eq!((tool(""), tool("[tool]\nkind = 'spring'")), (Tool::Spring, Tool::Spring));
        let acf = tool(ACF);
        let acf = acf.compliant().expect("compliant");
        assert_eq!(acf.address, Some(ToolAddress { host: "172.31.1.150".to_owned(), port: 7_070 }));
        assert_eq!((acf.login.as_str(), acf.id, acf.stroke_mm, acf.payload_kg), ("ferba", 1_040, 35.5, 2.1));
        assert_eq!(tool("[tool]\nkind = 'simulated'").compliant().map(|tool| tool.address.clone()), Some(None));
        // The limits must be short enough: after a lost link or a force outside of its band, time is needed for the
        // retract.
        assert!(acf.reply_ms <= 150 && acf.band_ms <= 200 && acf.contact_ms <= 250);
    }

    #[test]
    fn what_is_missing_or_has_no_effect_is_reported() {
        let says = |text: &str| Cell::check("f", text).expect_err("refused").to_string();
        let told = says("[tool]\nstroke_mm = 30\nhost = 'a'");
        assert!(told.contains("f:2: tool.stroke_mm: has no effect with kind = \"spring\""), "{told}");
        assert!(
            told.contains(
                "f:3: tool.host: has no effect with kind = \"spring\"; this key is valid only with kind = \"acf\""
            ),
            "{told}"
        );
        let told = says("[tool]\nkind = 'acf'");
        for key in ["host", "stroke_mm", "min_force_n", "max_force_n", "payload_kg"] {
            assert!(told.contains(&format!("tool.{key}: is missing; kind = \"acf\" needs")), "{told}");
        }
        assert!(says("[tool]\nkind = 'acff'").contains("acf"));
        assert!(says(&format!("{ACF}login = 'kuka'")).contains("tool.login: found \"kuka\""));
        assert!(says(&ACF.replace("-100", "-20")).contains("must be below -20.6, the weight of payload_kg"));
        assert!(says(&ACF.replace("172.31.1.150", "172.31.1")).contains("tool.host: found"));
        assert!(says(&format!("{ACF}reply_ms = 400")).contains("10 to 150"));
    }
}

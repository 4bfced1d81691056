//! Settings files of a Zivid camera, in YAML, as saved by Zivid Studio: the values that this program checks before the
//! SDK loads the file.
//!
//! A settings file for 3D shots contains `Settings`; one for pictures of the film contains `Settings2D`. The cell's own
//! lamp lights the film: the camera's projector would cause a moving glare on the water and heat the camera. Therefore
//! Brightness must be 0 in every acquisition of a film, and must be stated, because the SDK's default switches the
//! projector on. A lamp on alternating current flickers with half of the mains period; if the exposure is a multiple of
//! this time, all pictures have the same brightness. The SDK checks all other values.

use panelprep_base::config::{Problem, Problems};
use saphyr::{LoadableYamlNode, MarkedYaml, Scalar, YamlData};
use strum::{IntoStaticStr, VariantArray};

/// Frequency of the mains supply.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr, VariantArray)]
pub enum MainsFrequency {
    /// Europe, most of Asia and Africa.
    #[strum(serialize = "50 Hz")]
    Hz50,
    /// North America, part of Japan.
    #[strum(serialize = "60 Hz")]
    Hz60,
}

impl MainsFrequency {
    /// Both frequencies.
    pub const ALL: &'static [MainsFrequency] = <Self as VariantArray>::VARIANTS;

    /// Returns the frequency as text for people.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the period of a lamp's flicker, µs: half of the mains period.
    pub fn flicker_period_us(self) -> f64 {
        match self {
            MainsFrequency::Hz50 => 1e6 / 100.0,
            MainsFrequency::Hz60 => 1e6 / 120.0,
        }
    }

    /// Returns whether an exposure is a multiple of the flicker period. The tolerance is 1 % of the period.
    pub fn is_flicker_multiple(self, exposure_us: f64) -> bool {
        let periods = exposure_us / self.flicker_period_us();
        periods.round() >= 1.0 && (periods - periods.round()).abs() <= 0.01
    }
}

/// The use for which a settings file is intended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ZividUse {
    /// 3D shots with colour.
    Scan,
    /// Pictures of the film.
    Film,
}

/// The values of a settings file that this program uses.
#[derive(Debug, Clone, PartialEq)]
pub struct ZividSettings {
    usage: ZividUse,
    exposures_us: Vec<f64>,
}

const SCAN: &str = "Settings";
const FILM: &str = "Settings2D";

impl ZividSettings {
    /// Parses a settings file of either use. `file` is its name in messages.
    ///
    /// # Errors
    /// If the text is not YAML or not a settings file, or contains invalid values. Each problem has its line and key.
    pub fn read(file: &str, text: &str) -> Result<Self, Problems> {
        let mut list = Vec::new();
        let found = read(text, None, &mut list);
        found.filter(|_| list.is_empty()).ok_or(Problems { file: file.to_owned(), list })
    }

    /// Parses a settings file that must be intended for this use.
    ///
    /// # Errors
    /// The errors of [`ZividSettings::read`], or if the file is intended for the other use.
    pub fn check(file: &str, text: &str, usage: ZividUse) -> Result<Self, Problems> {
        let mut list = Vec::new();
        let found = read(text, Some(usage), &mut list);
        found.filter(|_| list.is_empty()).ok_or(Problems { file: file.to_owned(), list })
    }

    /// Returns the use for which the file is intended.
    pub fn usage(&self) -> ZividUse {
        self.usage
    }

    /// Returns the exposures of all acquisitions, µs; empty if one of them is not stated.
    pub fn exposures_us(&self) -> &[f64] {
        &self.exposures_us
    }

    /// Returns the total exposure of a shot, µs; `None` if the exposure of one acquisition is not stated.
    pub fn exposure_us(&self) -> Option<f64> {
        (!self.exposures_us.is_empty()).then(|| self.exposures_us.iter().sum())
    }

    /// Returns the mains frequencies at which all exposures are a multiple of the flicker period.
    pub fn matching_mains(&self) -> Vec<MainsFrequency> {
        let fits = |mains: &MainsFrequency| {
            self.exposures_us.iter().all(|exposure_us| mains.is_flicker_multiple(*exposure_us))
        };
        MainsFrequency::ALL.iter().copied().filter(|mains| !self.exposures_us.is_empty() && fits(mains)).collect()
    }

    /// Returns a description of the settings, one line for each property.
    pub fn summary(&self) -> Vec<String> {
        let usage = match self.usage {
            ZividUse::Scan => "Zivid settings for 3D shots with colour",
            ZividUse::Film => "Zivid settings for pictures of the film, by the cell's own light",
        };
        let exposures: Vec<String> = self.exposures_us.iter().map(|us| format!("{us:.0} µs")).collect();
        let exposures = match exposures.len() {
            0 => "exposures by the SDK's default".to_owned(),
            _ => format!("exposures {}", exposures.join(", ")),
        };
        let mains: Vec<String> = self.matching_mains().into_iter().map(|mains| mains.name().to_owned()).collect();
        let light = match mains.len() {
            0 => "with a mains lamp, the brightness of the pictures varies; with a direct-current lamp, it is constant"
                .to_owned(),
            _ => format!("with a lamp on mains of {}, all pictures have the same brightness", mains.join(" or ")),
        };
        vec![usage.to_owned(), exposures, light]
    }
}

/// A YAML node, with its path as the key in messages.
struct Node<'y> {
    yaml: &'y MarkedYaml<'y>,
    key: String,
}

impl<'y> Node<'y> {
    fn problem(&self, message: impl Into<String>) -> Problem {
        Problem { line: self.yaml.span.start.line(), key: self.key.clone(), message: message.into() }
    }

    fn get(&self, name: &str) -> Option<Node<'y>> {
        let YamlData::Mapping(mapping) = &self.yaml.data else { return None };
        let named = |key: &MarkedYaml| matches!(&key.data, YamlData::Value(Scalar::String(text)) if text == name);
        let (_, yaml) = mapping.iter().find(|(key, _)| named(key))?;
        let key = if self.key.is_empty() { name.to_owned() } else { format!("{}.{name}", self.key) };
        Some(Node { yaml, key })
    }

    fn missing_key_problem(&self, name: &str, message: &str) -> Problem {
        let key = if self.key.is_empty() { name.to_owned() } else { format!("{}.{name}", self.key) };
        Problem { line: self.yaml.span.start.line(), key, message: format!("is missing; {message}") }
    }

    fn number(&self) -> Option<f64> {
        match &self.yaml.data {
            YamlData::Value(Scalar::Integer(number)) => Some(*number as f64),
            YamlData::Value(Scalar::FloatingPoint(number)) => Some(number.into_inner()),
            _ => None,
        }
    }
}

fn read(text: &str, usage: Option<ZividUse>, problems: &mut Vec<Problem>) -> Option<ZividSettings> {
    let documents = match MarkedYaml::load_from_str(text) {
        Ok(documents) => documents,
        Err(error) => {
            let message = format!("this is not valid YAML: {}", error.info());
            problems.push(Problem { line: error.marker().line(), key: String::new(), message });
            return None;
        }
    };
    let whole = |message: String| Problem { line: 1, key: String::new(), message };
    let [document] = documents.as_slice() else {
        problems.push(whole(format!("found {} YAML documents, valid: exactly one", documents.len())));
        return None;
    };
    let top = Node { yaml: document, key: String::new() };
    if top.get("__version__").is_none() {
        problems.push(top.missing_key_problem(
            "__version__",
            "Zivid Studio writes it at the top of its settings, and the SDK \
                                                  requires it",
        ));
    }
    let (scan, film) = (top.get(SCAN), top.get(FILM));
    let (settings, found) = match (scan, film) {
        (Some(scan), None) => (scan, ZividUse::Scan),
        (None, Some(film)) => (film, ZividUse::Film),
        _ => {
            let message = "the file must contain exactly one of Settings (3D shots with colour) and Settings2D (pictures of the film)";
            problems.push(whole(message.to_owned()));
            return None;
        }
    };
    if let Some(usage) = usage.filter(|usage| *usage != found) {
        let (found, wanted) = match usage {
            ZividUse::Scan => (FILM, "settings for 3D shots, with Settings at the top"),
            ZividUse::Film => (SCAN, "settings for pictures, with Settings2D at the top"),
        };
        problems.push(settings.problem(format!("found {found}, expected {wanted}")));
        return None;
    }
    if found == ZividUse::Scan && settings.get("Color").and_then(|color| color.get(FILM)).is_none() {
        problems.push(
            settings.missing_key_problem("Color.Settings2D", "a 3D shot needs the settings of its colour picture"),
        );
    }
    let exposures_us = stated_exposures(&settings, found, problems);
    Some(ZividSettings { usage: found, exposures_us })
}

/// Returns the exposures of all acquisitions; empty if one of them is not stated.
fn stated_exposures(settings: &Node<'_>, usage: ZividUse, problems: &mut Vec<Problem>) -> Vec<f64> {
    let needed = "a shot consists of one or more acquisitions";
    let Some(all) = settings.get("Acquisitions") else {
        problems.push(settings.missing_key_problem("Acquisitions", needed));
        return Vec::new();
    };
    let each: &[MarkedYaml] = match &all.yaml.data {
        YamlData::Sequence(each) => each,
        _ => &[],
    };
    if each.is_empty() {
        problems.push(all.problem(format!("found none, at least one is needed: {needed}")));
    }
    let mut exposures_us = Some(Vec::new());
    for (index, yaml) in each.iter().enumerate() {
        let entry = Node { yaml, key: format!("{}[{index}]", all.key) };
        let Some(acquisition) = entry.get("Acquisition") else {
            problems.push(
                entry.missing_key_problem("Acquisition", "each entry of Acquisitions must contain an Acquisition"),
            );
            continue;
        };
        if usage == ZividUse::Film {
            problems.extend(projector_problem(&acquisition));
        }
        match acquisition.get("ExposureTime") {
            Some(time) => match time.number().filter(|us| *us > 0.0 && us.is_finite()) {
                Some(us) => exposures_us.as_mut().into_iter().for_each(|all| all.push(us)),
                None => problems.push(time.problem("valid: a number of µs above 0")),
            },
            None if usage == ZividUse::Film => {
                problems.push(acquisition.missing_key_problem("ExposureTime", "state the exposure in µs"))
            }
            None => exposures_us = None,
        }
    }
    exposures_us.unwrap_or_default()
}

/// Returns the problem of an acquisition of a film in which the projector may be on.
fn projector_problem(acquisition: &Node<'_>) -> Option<Problem> {
    const WHY: &str = "the cell's own lamp lights the film: the light of the camera's projector would cause glare on \
                       the water and heat the camera";
    let Some(brightness) = acquisition.get("Brightness") else {
        return Some(acquisition.missing_key_problem(
            "Brightness",
            &format!("state the value 0, because the SDK's default is not 0; {WHY}"),
        ));
    };
    match brightness.number() {
        Some(0.0) => None,
        Some(found) => Some(brightness.problem(format!("found {found}, the value must be 0; {WHY}"))),
        None => Some(brightness.problem(format!("the value must be the number 0; {WHY}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCAN_FILE: &str = include_str!("../../../config/zivid/scan.yml");
    const FILM_FILE: &str = include_str!("../../../config/zivid/film.yml");

    fn problem_text(text: &str, usage: ZividUse) -> String {
        ZividSettings::check("film.yml", text, usage).expect_err("refused").to_string()
    }

    #[test]
    fn the_samples_are_valid_and_fit_mains_of_50_hz() {
        let scan = ZividSettings::check("scan.yml", SCAN_FILE, ZividUse::Scan).unwrap_or_else(|p| panic!("{p}"));
        let film = ZividSettings::check("film.yml", FILM_FILE, ZividUse::Film).unwrap_or_else(|p| panic!("{p}"));
        assert_eq!((scan.exposure_us(), film.exposure_us()), (Some(10_000.0), Some(20_000.0)));
        for settings in [&scan, &film] {
            assert_eq!(settings.matching_mains(), [MainsFrequency::Hz50]);
        }
        assert!(film.summary()[2].contains("mains of 50 Hz"), "{:?}", film.summary());
        // The sample's own comment recommends this exposure for the other mains frequency.
        let film_60 = FILM_FILE.replace("20000", "16667");
        let film_60 = ZividSettings::read("film.yml", &film_60).unwrap_or_else(|p| panic!("{p}"));
        assert_eq!(film_60.matching_mains(), [MainsFrequency::Hz60]);
    }

    /// Expected values, calculated by hand: 8 ms are 0.8 periods of 10 ms and 0.96 periods of 8.33 ms; 50 ms are 5 and
    /// 6 periods.
    #[test]
    fn an_exposure_fits_mains_if_it_is_a_multiple_of_the_flicker_period() {
        let fits =
            |us: f64| [MainsFrequency::Hz50, MainsFrequency::Hz60].map(|mains| mains.is_flicker_multiple(us));
        assert_eq!(fits(8_000.0), [false, false]);
        assert_eq!(fits(10_000.0), [true, false]);
        assert_eq!(fits(8_333.0), [false, true]);
        assert_eq!(fits(50_000.0), [true, true]);
        assert_eq!((fits(10_099.0), fits(10_101.0), fits(50.0)), ([true, false], [false; 2], [false; 2]));
    }

    #[test]
    fn a_film_lit_by_the_projector_is_refused_with_its_line() {
        let line = FILM_FILE.lines().position(|line| line.contains("Brightness: 0")).expect("it has one") + 1;
        let lit = problem_text(&FILM_FILE.replace("Brightness: 0", "Brightness: 1.8"), ZividUse::Film);
        let words = format!(
            "film.yml:{line}: Settings2D.Acquisitions[0].Acquisition.Brightness: found 1.8, the value must be 0"
        );
        assert!(lit.starts_with(&words), "{lit}");
        let unsaid = problem_text(&FILM_FILE.replace("Brightness: 0", "# Brightness: 0"), ZividUse::Film);
        assert!(unsaid.contains("Acquisition.Brightness: is missing; state the value 0"), "{unsaid}");
        let word = problem_text(&FILM_FILE.replace("Brightness: 0", "Brightness: off"), ZividUse::Film);
        assert!(word.contains("Brightness: the value must be the number 0"), "{word}");
        // The projector may be on in a 3D shot, which needs it.
        assert!(SCAN_FILE.contains("Brightness: 1.8"));
    }

    #[test]
    fn other_files_are_refused_with_the_problem() {
        let cases = [
            (SCAN_FILE, ZividUse::Film, "found Settings, expected settings for pictures, with Settings2D"),
            (FILM_FILE, ZividUse::Scan, "found Settings2D, expected settings for 3D shots"),
            ("a: [", ZividUse::Film, "this is not valid YAML"),
            ("[scanner]\nkind = 'zivid'", ZividUse::Film, "this is not valid YAML"),
            (
                "scanner: zivid",
                ZividUse::Film,
                "the file must contain exactly one of Settings (3D shots with colour) and Settings2D",
            ),
            (
                "Settings2D:\n  Acquisitions: []\n",
                ZividUse::Film,
                "film.yml:2: Settings2D.Acquisitions: found none",
            ),
            ("Settings2D: {}\n", ZividUse::Film, "Settings2D.Acquisitions: is missing"),
            (
                "Settings:\n  Acquisitions:\n    - Acquisition: {}\n",
                ZividUse::Scan,
                "Settings.Color.Settings2D: is missing",
            ),
        ];
        for (text, usage, words) in cases {
            let reported = problem_text(text, usage);
            assert!(reported.contains(words), "{words}: {reported}");
        }
        let unversioned = problem_text(&FILM_FILE.replace("__version__", "version"), ZividUse::Film);
        assert!(unversioned.contains("__version__: is missing"), "{unversioned}");
    }
}

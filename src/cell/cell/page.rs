//! `[page]`: the operator's page. It is off until `listen` is set.

use core::net::SocketAddr;
use panelprep_base::config::Section;
use std::path::{Path, PathBuf};

/// The address of the page, and how long people stay logged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Page {
    /// The address and port; without it there is no page.
    pub listen: Option<SocketAddr>,
    /// The files of the certificate and of its key, PEM; without them the program makes its own certificate if other
    /// computers can reach the page.
    pub certificate: Option<[PathBuf; 2]>,
    /// The folder of the recipes that can be started.
    pub recipes: PathBuf,
    /// A translation table: the page's texts in further languages.
    pub translations: Option<PathBuf>,
    /// The number of minutes without an action after which a session ends.
    pub idle_min: usize,
    /// The largest number of sessions of one account at one time.
    pub sessions: usize,
}

const IDLE_MIN: std::ops::RangeInclusive<usize> = 1..=720;
const SESSIONS: std::ops::RangeInclusive<usize> = 1..=20;

pub(super) fn parse_page(folder: &Path, section: &Section<'_, '_>) -> Option<Page> {
    let listen = section.parse::<Option<String>>("listen", (), Some(None));
    let [certificate, key] =
        ["certificate", "certificate_key"].map(|key| section.parse::<Option<String>>(key, (), Some(None)));
    let recipes = section.parse::<String>("recipes", (), Some(".".to_owned()));
    let words = section.parse::<Option<String>>("words", (), Some(None));
    let idle_min = section.parse::<usize>("idle_min", IDLE_MIN, Some(30));
    let sessions = section.parse::<usize>("sessions", SESSIONS, Some(3));
    section.finish();
    let (certificate, key) = (certificate?, key?);
    if certificate.is_some() != key.is_some() {
        let missing = if key.is_some() { "certificate" } else { "certificate_key" };
        section.problem(missing, "is missing; certificate and certificate_key belong together");
        return None;
    }
    let listen = listen?;
    let address = match &listen {
        None => None,
        Some(text) => match text.parse::<SocketAddr>() {
            Ok(address) if address.port() > 0 => Some(address),
            _ => {
                let allowed = "valid: an IP address and a port, such as \"127.0.0.1:8443\" or \"0.0.0.0:8443\"";
                section.problem("listen", format!("found \"{text}\", {allowed}"));
                return None;
            }
        },
    };
    Some(Page {
        listen: address,
        certificate: certificate.zip(key).map(|(file, key)| [folder.join(file), folder.join(key)]),
        recipes: folder.join(recipes?),
        translations: words?.map(|name| folder.join(name)),
        idle_min: idle_min?,
        sessions: sessions?,
    })
}

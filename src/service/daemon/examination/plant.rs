//! The checks of `panelprep doctor` for systems outside the cell: production line, office server, quality system and
//! MQTT broker. They read the files for these systems and connect to the servers without a login; no data is sent.

use super::check::ExaminedItem;
use crate::setup::{SetupFault, disk, parse_recipe_for_cell};
use panelprep_base::trust::{self, TrustError};
use panelprep_cell::cell::{Broker, BrokerLogin, Cell, authority};
use std::io::{Error, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// Time limit for opening a connection to a server.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);

/// Checks all plant connections that the cell's file names.
pub(super) fn check_connections(cell: &Cell) -> Vec<ExaminedItem> {
    let mut checks = Vec::new();
    if let Some(fault) = SetupFault::missing_plant(cell) {
        checks.push(ExaminedItem::failed("plant", fault.to_string(), "use the program of the package"));
    }
    checks.extend(cell.line().map(|line| check_line_recipe(cell, &line.recipe)));
    if let Some(office) = cell.office() {
        let address = office.broker.address.split_once("://").map_or("", |(_, rest)| rest);
        checks.push(check_reachable("office", broker_files(&office.broker), address.to_owned()));
    }
    if let Some(push) = cell.push() {
        let files = check_secrets(push.token_file.as_deref())
            .and_then(|()| authorities(push.ca_certificate.as_deref(), None));
        checks.push(check_reachable("quality system", files, push.target_folder.authority()));
    }
    if let Some(node) = cell.sparkplug() {
        let (ca, own) = node
            .tls
            .as_ref()
            .map_or((None, None), |tls| (Some(tls.ca_certificate.as_path()), tls.client_certificate.as_ref()));
        let password = node.login.as_ref().map(|(_, file)| file.as_path());
        let files = check_secrets(password).and_then(|()| authorities(ca, own));
        checks.push(check_reachable("MQTT broker", files, authority(&node.broker, node.port)));
    }
    checks
}

fn check_secrets(file: Option<&Path>) -> Result<(), TrustError> {
    file.map_or(Ok(()), |file| trust::secret(file).map(drop))
}

fn authorities(file: Option<&Path>, own: Option<&[PathBuf; 2]>) -> Result<(), TrustError> {
    file.map_or(Ok(()), |file| trust::client_config(file, own).map(drop))
}

fn broker_files(broker: &Broker) -> Result<(), TrustError> {
    authorities(broker.ca.as_deref(), None)?;
    match &broker.login {
        BrokerLogin::Anybody => Ok(()),
        // The credentials file begins with a certificate, whose format only the broker checks.
        BrokerLogin::Credentials(file) | BrokerLogin::Password { file, .. } => check_secrets(Some(file)),
    }
}

/// Checks the recipe of the line as a start checks it.
fn check_line_recipe(cell: &Cell, file: &Path) -> ExaminedItem {
    const NAME: &str = "line";
    let checked =
        disk::read_text(file).and_then(|text| Ok(parse_recipe_for_cell(cell, &file.display().to_string(), &text)?));
    match checked {
        Ok(recipe) => ExaminedItem::passed(
            NAME,
            format!("the line requests cycles of panel {}, recipe {}", recipe.panel(), file.display()),
        ),
        Err(fault) => ExaminedItem::failed(
            NAME,
            fault.to_string(),
            "set [line] recipe to a valid recipe of this cell; until then, each start that the line requests is refused",
        ),
    }
}

fn check_reachable(name: &'static str, files: Result<(), TrustError>, address: String) -> ExaminedItem {
    if let Err(problem) = files {
        return ExaminedItem::failed(
            name,
            problem.to_string(),
            "correct this file, or name another file in the cell's file",
        );
    }
    match accept_connection(address.clone(), CONNECT_TIMEOUT) {
        Ok(()) => ExaminedItem::passed(name, format!("{address} accepts connections")),
        Err(problem) => {
            let advice = "check the address in the cell's file, the network, and whether the server runs; the cell \
                          works without this server";
            ExaminedItem::failed(name, format!("{address}: {problem}"), advice)
        }
    }
}

/// Connects to the first of the addresses of `place` that accepts the connection. Each attempt has this time limit;
/// the look-up of the name has the same limit.
///
/// # Errors
/// The reason, as text, if no address accepted the connection.
pub fn accept_connection(place: impl ToSocketAddrs + Send + 'static, within: Duration) -> Result<(), String> {
    let (sender, receiver) = mpsc::channel();
    // A separate thread, because the look-up of a name may last minutes.
    thread::spawn(move || {
        let connect = || {
            let mut last = Error::new(ErrorKind::NotFound, "the host name has no address");
            for address in place.to_socket_addrs()? {
                match TcpStream::connect_timeout(&address, within) {
                    Ok(_) => return Ok(()),
                    Err(error) => last = error,
                }
            }
            Err(last)
        };
        sender.send(connect().map_err(|error: Error| error.to_string()))
    });
    receiver
        .recv_timeout(2 * within)
        .unwrap_or_else(|_| Err(format!("no answer within {} s", 2 * within.as_secs())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    fn found(folder: &Path, table: &str) -> Vec<(bool, String)> {
        let file = folder.join("cell.toml").display().to_string();
        let cell = Cell::check(&file, table).expect("right");
        check_connections(&cell)
            .into_iter()
            .map(|check| (check.is_passed(), format!("{}: {}", check.name, check.found)))
            .collect()
    }

    #[test]
    fn doctor_checks_servers_and_their_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path();
        assert_eq!(found(folder, ""), []);
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("its number").port();
        let office = format!("[office]\nbroker = \"nats://127.0.0.1:{port}\"\ncell = \"a\"\n");
        assert_eq!(found(folder, &office), [(true, format!("office: 127.0.0.1:{port} accepts connections"))]);
        let sparkplug = "[sparkplug]\nbroker = \"localhost\"\ngroup_id = \"g\"\nedge_node_id = \"e\"\nuser = \"u\"\npassword_file = \"none\"\n";
        let told = found(folder, sparkplug);
        assert!(!told[0].0 && told[0].1.ends_with("none: No such file or directory (os error 2)"), "{told:?}");
        drop(listener);
        let push = format!("[push]\nto = \"http://127.0.0.1:{port}/a\"\n");
        let told = found(folder, &push);
        assert!(
            !told[0].0 && told[0].1.starts_with(&format!("quality system: 127.0.0.1:{port}: Connection refused")),
            "{told:?}"
        );
    }

    const RECIPE: &str = "panel = 'p'\n[locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [900, 900, 900]\n\
                          [region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n";

    #[test]
    fn a_line_needs_a_recipe_that_the_cell_can_execute() {
        let folder = tempfile::tempdir().expect("a folder");
        let cell = Cell::check("cell.toml", "").expect("right");
        let check = |file: &Path| check_line_recipe(&cell, file);
        let missing = check(&folder.path().join("none.toml"));
        assert!(!missing.is_passed() && missing.found.contains("none.toml: No such file"), "{}", missing.found);
        let file = folder.path().join("line.toml");
        let write = |text: &str| std::fs::write(&file, text).expect("written");
        write("[scanner]\nkind = \"simulated\"\n");
        assert!(!check(&file).is_passed());
        write(RECIPE);
        assert!(check(&file).is_passed(), "{:?}", check(&file));
        // Without a limit in the cell's file, the feed limit is 250 mm/s.
        write(&format!("{RECIPE}[path]\nfeed_mm_s = 251\n"));
        let unfit = check(&file);
        assert!(!unfit.is_passed() && unfit.found.contains("path.feed_mm_s"), "{unfit:?}");
    }
}

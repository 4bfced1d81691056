//! Tests the transfer of signed records to a quality system: a test server receives them, with all possible failures of
//! the transfer.

use super::commands::json;
use super::service::{Service, taught};
use panelprep::daemon::{PushParts, PushSender, PushStatus};
use panelprep::setup::testing::write_cell;
use panelprep::signing::CellKey;
use panelprep::store::{CycleStart, Store};
use panelprep::verdict::Verdict;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

/// Time limit of the tests, long enough for a busy machine.
const TIMEOUT: Duration = Duration::from_secs(120);

/// The behaviour of the test server on a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Does {
    Takes,
    /// The server closes the connection in the middle of a request.
    Cuts,
    /// The server stores the file, but its response is lost.
    LosesAnswer,
    /// The server accepts the file and closes the connection without a response.
    Closes,
    Answers(&'static str),
}

#[derive(Default)]
struct ReceivedRequests {
    files: BTreeMap<String, Vec<u8>>,
    /// The names of the files in the order of the requests.
    asked: Vec<String>,
    authorizations: Vec<Option<String>>,
}

/// A server whose behaviour on its Nth request is given by `does`.
struct Server {
    port: u16,
    taken: Arc<Mutex<ReceivedRequests>>,
}

impl Server {
    fn start(tls: Option<Arc<rustls::ServerConfig>>, does: impl Fn(usize) -> Does + Send + Sync + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("its number").port();
        let taken = Arc::new(Mutex::new(ReceivedRequests::default()));
        let (shared, does) = (taken.clone(), Arc::new(does));
        thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                let (shared, does, tls) = (shared.clone(), does.clone(), tls.clone());
                thread::spawn(move || match tls {
                    None => serve(&stream, &shared, &*does),
                    Some(config) => {
                        let session = rustls::ServerConnection::new(config).expect("right");
                        serve(rustls::StreamOwned::new(session, stream), &shared, &*does);
                    }
                });
            }
        });
        Server { port, taken }
    }

    fn taken(&self) -> std::sync::MutexGuard<'_, ReceivedRequests> {
        self.taken.lock().expect("whole")
    }

    fn wait_for(&self, name: &str) {
        let since = Instant::now();
        while !self.taken().files.contains_key(name) {
            assert!(since.elapsed() < TIMEOUT, "{name} never came: {:?}", self.taken().asked);
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Writes the files that the server received.
    fn write(&self, folder: &Path) {
        for (name, bytes) in &self.taken().files {
            let file = folder.join(name);
            std::fs::create_dir_all(file.parent().expect("a folder")).expect("made");
            std::fs::write(file, bytes).expect("written");
        }
    }
}

/// Serves requests until the connection ends.
fn serve(stream: impl Read + Write, taken: &Mutex<ReceivedRequests>, does: &dyn Fn(usize) -> Does) {
    let mut stream = BufReader::new(stream);
    loop {
        let mut head = Vec::new();
        loop {
            let mut line = String::new();
            if stream.read_line(&mut line).unwrap_or(0) == 0 {
                return;
            }
            if line.trim().is_empty() {
                break;
            }
            head.push(line.trim().to_owned());
        }
        let header = |name: &str| {
            head.iter().find_map(|line| line.split_once(": ").filter(|(key, _)| key.eq_ignore_ascii_case(name)))
        };
        let name = head[0].strip_prefix("PUT /cell-1/").and_then(|rest| rest.strip_suffix(" HTTP/1.1"));
        let name = name.unwrap_or_else(|| panic!("{head:?}")).to_owned();
        let length: usize = header("content-length").expect("it is reported").1.parse().expect("a number");
        let does = {
            let mut taken = taken.lock().expect("whole");
            taken.asked.push(name.clone());
            taken.authorizations.push(header("authorization").map(|(_, value)| value.to_owned()));
            does(taken.asked.len())
        };
        let mut body = vec![0; if does == Does::Cuts { length / 2 } else { length }];
        if stream.read_exact(&mut body).is_err() || does == Does::Cuts {
            return;
        }
        let answer = match does {
            Does::Answers(answer) => answer,
            _ => "201 Created\r\n",
        };
        if !matches!(does, Does::Answers(_)) {
            taken.lock().expect("whole").files.insert(name, body);
        }
        let (head, words) = answer.split_once('|').unwrap_or((answer, ""));
        let answer = format!("HTTP/1.1 {head}content-length: {}\r\n\r\n{words}", words.len());
        if does == Does::LosesAnswer
            || stream.get_mut().write_all(answer.as_bytes()).is_err()
            || does == Does::Closes
        {
            return;
        }
    }
}

/// A cycle's record with its page, pictures and recipe, and later a person's signature, reach the server. The server
/// cuts connections, loses responses, closes connections and refuses in turn. Meanwhile the service is killed, and
/// continues at the file that it had reached. At the end the server's files pass the verification.
#[test]
fn the_service_puts_each_signed_record() {
    let server = Server::start(None, |number| match number % 7 {
        1 => Does::Cuts,
        2 => Does::LosesAnswer,
        4 => Does::Closes,
        5 => Does::Answers("503 Service Unavailable\r\n|back soon\n"),
        _ => Does::Takes,
    });
    let folder = taught("clean");
    let folder = folder.path();
    let file = folder.join("cell/cell.toml");
    let text = std::fs::read_to_string(&file).expect("a cell");
    std::fs::write(&file, format!("{text}\n[push]\nto = 'http://127.0.0.1:{}/cell-1/'\n", server.port))
        .expect("written");
    let service = Service::start(folder);
    service.reset();
    service.done("start --recipe cell/recipe.toml --wait");
    server.wait_for("cycle-1.sig");
    service.kill_and_wait();
    let service = Service::start(folder);
    server.wait_for("cycle-1.json");
    let sign = "record sign 1 --cell cell/cell.toml --name Grace --meaning released";
    assert_eq!(json(folder, sign).0, 0);
    server.wait_for("cycle-1-signature-2.json");
    assert!(service.log().contains("back soon"), "{}", service.log());
    drop(service);

    let (exit, output) = json(folder, "record export 1 --cell cell/cell.toml --out exported");
    assert_eq!(exit, 0, "{output}");
    server.write(&folder.join("pushed"));
    let (exit, output) = json(folder, "record verify pushed --public-key exported/public-key.pem");
    assert_eq!((exit, output["verdict"].as_str()), (0, Some("pass")), "{output}");
    let exported = std::fs::read_dir(folder.join("exported/files")).expect("files").count();
    let taken = server.taken();
    assert_eq!(taken.files.keys().filter(|name| name.starts_with("files/")).count(), exported, "all of them");
    for name in ["cycle-1.json", "cycle-1-signature-2.sig"] {
        assert_eq!(taken.files[name], std::fs::read(folder.join("exported").join(name)).expect("a file"), "{name}");
    }
    assert!(taken.files["cycle-1.pdf"].starts_with(b"%PDF"));
    assert!(taken.authorizations.iter().all(Option::is_none));
    let first = |name: &str| taken.asked.iter().position(|asked| asked == name).expect("it came");
    let last_file = taken.files.keys().filter(|name| name.starts_with("files/")).map(|name| first(name)).max();
    assert!(
        last_file < Some(first("cycle-1.sig")) && first("cycle-1.sig") < first("cycle-1.json"),
        "{:?}",
        taken.asked
    );
}

fn signed_cycle(store: &mut Store) {
    let start = CycleStart {
        panel: "wing".to_owned(),
        taught_version: "0011223344556677".to_owned(),
        recipe_text: "panel = \"wing\"\n".to_owned(),
        file_texts: vec![],
        recording: None,
        is_air_run: false,
    };
    let id = store.begin_cycle(&start).expect("begun");
    store.conclude(id, Verdict::Pass, &[]).expect("over");
    store.sign_cycle(&CellKey::from_random_bytes(&[7; 32]), id).expect("signed");
}

/// A server with TLS that requires a token. An untrusted server, a wrong token and a redirecting address are reported,
/// and no record is lost. A store that was restored to an earlier state is sent again, and another address receives all
/// records.
#[test]
fn a_server_is_trusted_by_its_certificate_and_knows_the_cell_by_its_token() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let own = rcgen::generate_simple_self_signed(vec!["localhost".to_owned()]).expect("a certificate");
    let other = rcgen::generate_simple_self_signed(vec!["localhost".to_owned()]).expect("a certificate");
    let key = PrivateKeyDer::Pkcs8(PrivatePkcs8KeyDer::from(own.signing_key.serialize_der()));
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = rustls::ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .expect("right")
        .with_no_client_auth()
        .with_single_cert(vec![CertificateDer::from(own.cert.der().to_vec())], key)
        .expect("it belongs to it");
    let step = Arc::new(Mutex::new(Does::Answers("401 Unauthorized\r\n|no such token")));
    let does = step.clone();
    let server = Server::start(Some(Arc::new(config)), move |_| *does.lock().expect("whole"));
    std::fs::write(folder.join("ca.pem"), other.cert.pem()).expect("written");
    std::fs::write(folder.join("token"), "a-token\n").expect("written");
    let mut store = Store::create(&folder.join("store")).expect("a store");
    signed_cycle(&mut store);
    signed_cycle(&mut store);

    let text = format!(
        "[push]\nto = 'https://localhost:{}/cell-1'\nca_certificate = 'ca.pem'\ntoken_file = 'token'\n",
        server.port
    );
    let files = write_cell(folder, &text, &[]);
    let push = files.cell.push().expect("it is there").clone();
    let status = PushStatus::default();
    let start = |push| {
        PushSender::start(PushParts { push, files: files.clone(), status: status.clone() }).expect("a thread")
    };
    let reported = |words: &str| {
        let since = Instant::now();
        loop {
            let reasons = status.reasons(0, i64::MAX / 2);
            if reasons.iter().any(|reason| reason.message.contains(words)) {
                return;
            }
            assert!(since.elapsed() < TIMEOUT, "{words}: {reasons:?}");
            thread::sleep(Duration::from_millis(20));
        }
    };
    let sender = start(push.clone());
    reported("2 signed records have not reached the quality system");
    reported("invalid peer certificate");
    assert!(server.taken().asked.is_empty(), "nothing is reported to a server that is not trusted");
    std::fs::write(folder.join("ca.pem"), own.cert.pem()).expect("written");
    reported("the server responded 401 Unauthorized: no such token");
    *step.lock().expect("whole") = Does::Answers("307 Temporary Redirect\r\nlocation: https://elsewhere/x\r\n|");
    reported(
        "the server redirects to https://elsewhere/x; write the address that accepts records as `to` in [push]",
    );
    *step.lock().expect("whole") = Does::Takes;
    server.wait_for("cycle-2.json");
    assert!(server.taken().authorizations.iter().all(|sent| sent.as_deref() == Some("Bearer a-token")));
    let progress = folder.join("store/push.json");
    let since = Instant::now();
    let text = loop {
        let text = std::fs::read_to_string(&progress).unwrap_or_default();
        if text.contains("\"number\":2") {
            break text;
        }
        assert!(since.elapsed() < TIMEOUT, "{text}");
        thread::sleep(Duration::from_millis(20));
    };
    drop(sender);

    // A sender that is started again sends no file twice. If the store was restored to an earlier state and has other
    // records, they are sent again.
    drop(store);
    let asked = server.taken().asked.len();
    let sender = start(push.clone());
    thread::sleep(Duration::from_millis(1_500));
    assert_eq!(server.taken().asked.len(), asked, "nothing is put twice without a reason");
    drop(sender);
    let went_back = tempfile::tempdir().expect("a folder");
    let mut store = Store::create(&went_back.path().join("store")).expect("a store");
    std::fs::write(went_back.path().join("store/push.json"), text).expect("written");
    signed_cycle(&mut store);
    server.taken().files.clear();
    let parts = PushParts { push, files: write_cell(went_back.path(), "", &[]), status };
    let _sender = PushSender::start(parts).expect("a thread");
    server.wait_for("cycle-1.json");
}

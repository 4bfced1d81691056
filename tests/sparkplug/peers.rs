//! A broker and host applications for the tests: Debian's mosquitto, and Python packages in separate environments below
//! `target/`.

use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// Time limit of the tests, long enough for a busy machine.
const TIMEOUT: Duration = Duration::from_secs(120);
/// Name of the user that the broker accepts.
pub const USER: &str = "cell";
pub const PASSWORD: &str = "a long password";

/// Returns whether these programs and environments are installed; otherwise prints that the test was not run.
pub fn are_there(environments: &[&str]) -> bool {
    let answers = |program: &str, argument: &str| {
        Command::new(program).arg(argument).stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
    };
    let mut missing = vec![];
    if !answers("mosquitto", "-h") || !answers("mosquitto_passwd", "-h") {
        missing.push("the broker mosquitto (Debian package mosquitto)".to_owned());
    }
    let without = environments.iter().filter(|name| !python(name).is_file());
    missing.extend(without.map(|name| format!("Python's {name} (make sparkplug-peers)")));
    if missing.is_empty() {
        return true;
    }
    eprintln!("not run: {} is missing, so no host application looked at the cell", missing.join(" and "));
    false
}

fn python(environment: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("target/sparkplug").join(environment).join("bin/python3")
}

pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("its address").port()
}

/// A broker that is running; it is killed when the test ends.
pub struct Broker {
    child: Child,
    folder: PathBuf,
    /// Port without TLS; `tls_port` is the port with TLS.
    pub port: u16,
    pub tls_port: u16,
}

impl Drop for Broker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Broker {
    /// Starts a broker with one user and TLS. Its certificate is created here; the certificate of the authority is
    /// `ca.pem` in the folder.
    pub fn start(folder: &Path) -> Self {
        let [port, tls_port] = [free_port(), free_port()];
        certificates(folder);
        fs::write(folder.join("password"), format!("{PASSWORD}\n")).expect("written");
        let users = folder.join("users");
        let made = Command::new("mosquitto_passwd").arg("-b").arg("-c").arg(&users).args([USER, PASSWORD]).status();
        assert!(made.expect("it starts").success());
        let at = |name: &str| folder.join(name).display().to_string();
        // The broker does not switch to another user, because it must read files in the folder of this test.
        let root = if rustix::process::getuid().is_root() { "user root\n" } else { "" };
        let text = format!(
            "{root}allow_anonymous false\npassword_file {}\nlistener {port} 127.0.0.1\nlistener {tls_port} 127.0.0.1\n\
             cafile {}\ncertfile {}\nkeyfile {}\n",
            users.display(),
            at("ca.pem"),
            at("broker.pem"),
            at("broker.key")
        );
        fs::write(folder.join("mosquitto.conf"), text).expect("written");
        Broker { child: run(folder, port), folder: folder.to_owned(), port, tls_port }
    }

    /// Kills the broker, as a power failure does, and starts it again after this time.
    pub fn restart(&mut self, without_for: Duration) {
        self.child.kill().expect("killed");
        self.child.wait().expect("gone");
        std::thread::sleep(without_for);
        self.child = run(&self.folder, self.port);
    }
}

fn run(folder: &Path, port: u16) -> Child {
    let log = fs::OpenOptions::new().create(true).append(true).open(folder.join("mosquitto.log")).expect("a log");
    let conf = folder.join("mosquitto.conf");
    let child = Command::new("mosquitto").arg("-v").arg("-c").arg(conf).stdout(Stdio::null()).stderr(log).spawn();
    let child = child.expect("it starts");
    let since = Instant::now();
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(
            since.elapsed() < TIMEOUT,
            "{}",
            fs::read_to_string(folder.join("mosquitto.log")).unwrap_or_default()
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    child
}

/// Creates a certificate authority, and a certificate for the broker on this computer.
fn certificates(folder: &Path) {
    let authority_key = rcgen::KeyPair::generate().expect("a key");
    let mut authority = rcgen::CertificateParams::new(vec![]).expect("parameters");
    authority.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
    authority.distinguished_name.push(rcgen::DnType::CommonName, "the plant");
    let certificate = authority.self_signed(&authority_key).expect("signed");
    let issuer = rcgen::Issuer::new(authority, authority_key);
    let key = rcgen::KeyPair::generate().expect("a key");
    let broker = rcgen::CertificateParams::new(vec!["localhost".to_owned()]).expect("parameters");
    let broker = broker.signed_by(&key, &issuer).expect("signed");
    for (name, text) in
        [("ca.pem", certificate.pem()), ("broker.pem", broker.pem()), ("broker.key", key.serialize_pem())]
    {
        fs::write(folder.join(name), text).expect("written");
    }
}

/// A host application in Python; it is killed when the test ends.
pub struct Host {
    child: Child,
    stdin: ChildStdin,
    lines: Receiver<String>,
    /// All its messages.
    pub heard: Vec<Value>,
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Host {
    /// Starts the host application, and waits until it is connected.
    pub fn start(environment: &str, script: &str, arguments: &[&str]) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sparkplug").join(script);
        let mut child = Command::new(python(environment))
            .arg(script)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("Python starts");
        let (stdin, stdout) = (child.stdin.take().expect("its input"), child.stdout.take().expect("its words"));
        let (tell, lines) = channel();
        std::thread::spawn(move || {
            BufReader::new(stdout).lines().map_while(Result::ok).try_for_each(|line| tell.send(line))
        });
        let mut host = Host { child, stdin, lines, heard: vec![] };
        host.until("it is connected", |message| message["kind"] == "connected");
        host
    }

    pub fn does(&mut self, what: &str) {
        self.stdin.write_all(format!("{what}\n").as_bytes()).expect("it reads");
    }

    /// Returns the messages of the host up to now.
    pub fn so_far(&mut self) -> &[Value] {
        while let Ok(line) = self.lines.try_recv() {
            self.keep(&line);
        }
        &self.heard
    }

    /// Waits for a message for which `is_it` is true; all arriving messages are stored.
    pub fn until(&mut self, what: &str, is_it: impl Fn(&Value) -> bool) -> Value {
        loop {
            match self.lines.recv_timeout(TIMEOUT) {
                Ok(line) => self.keep(&line),
                Err(error) => panic!("{what} never came: {error}; {:#?}", self.heard),
            }
            let newest = &self.heard[self.heard.len() - 1];
            if is_it(newest) {
                return newest.clone();
            }
        }
    }

    fn keep(&mut self, line: &str) {
        let message: Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        assert_ne!(message["kind"], "undecodable", "{message}");
        self.heard.push(message);
    }
}

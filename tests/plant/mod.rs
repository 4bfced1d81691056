//! The servers of an office server for tests: Debian's nats-server and PostgreSQL, each in a separate folder and on a
//! separate port. If one is not installed, the caller is informed and reports that its test did not run.

use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::{Duration, Instant};

/// Time limit for a server to answer: a database that was killed repeatedly on a busy machine needs some time.
const TIMEOUT: Duration = Duration::from_secs(180);

/// Ports below the range that the system uses for outgoing connections, so that a killed server can use its port again.
const PORTS: std::ops::Range<u16> = 20_000..32_000;

/// Returns a port that is free at this moment.
pub fn free_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    // Other test processes begin at another port.
    let begin = (std::process::id() % 397) as u16 * 30;
    let is_free = |port: &u16| TcpListener::bind(("127.0.0.1", *port)).is_ok();
    let ports = std::iter::repeat_with(|| {
        let step = NEXT.fetch_add(1, Ordering::Relaxed).wrapping_add(begin);
        PORTS.start + step % (PORTS.end - PORTS.start)
    });
    ports.take(usize::from(PORTS.end - PORTS.start)).find(is_free).expect("a port")
}

/// A server that is killed when the test ends.
pub struct Server {
    child: Option<Child>,
    start: Box<dyn Fn() -> Child + Send>,
    port: u16,
}

impl Drop for Server {
    fn drop(&mut self) {
        self.kill();
    }
}

impl Server {
    fn new(port: u16, start: impl Fn() -> Child + Send + 'static) -> Self {
        let mut server = Server { child: None, start: Box::new(start), port };
        server.start();
        server
    }

    /// Starts the server and waits until its port answers.
    pub fn start(&mut self) {
        self.begin();
        let since = Instant::now();
        while TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(since.elapsed() < TIMEOUT, "the server on port {} does not answer", self.port);
            // PostgreSQL ends if processes of a killed server still exist; it is then started again.
            if self.child.as_mut().is_some_and(|child| child.try_wait().is_ok_and(|ended| ended.is_some())) {
                self.begin();
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Starts the server without waiting.
    pub fn begin(&mut self) {
        self.kill();
        self.child = Some((self.start)());
    }

    /// Kills the server without a shutdown, as in a power failure.
    pub fn kill(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Returns the name of `nats-server` on this machine; `None` if it is not installed.
pub fn nats_server() -> Option<&'static str> {
    Command::new("nats-server").arg("--version").output().ok().map(|_| "nats-server")
}

/// Starts a broker with JetStream that stores its streams in this folder.
pub fn broker(folder: &Path, port: u16) -> Server {
    let folder = folder.join("nats");
    Server::new(port, move || {
        Command::new("nats-server")
            .args(["-js", "-a", "127.0.0.1", "-p", &port.to_string(), "-sd"])
            .arg(&folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("nats-server starts")
    })
}

/// Returns the folder of PostgreSQL's programs; `None` if it is not installed.
pub fn postgres_programs() -> Option<PathBuf> {
    let versions = fs::read_dir("/usr/lib/postgresql").ok()?;
    let mut folders: Vec<PathBuf> = versions.filter_map(|entry| Some(entry.ok()?.path().join("bin"))).collect();
    folders.sort();
    folders.into_iter().rev().find(|folder| folder.join("postgres").is_file())
}

/// Returns a command that runs as a user that PostgreSQL accepts, because PostgreSQL refuses to run as root.
fn as_user(program: &Path) -> Command {
    if !rustix::process::geteuid().is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command.args(["--reuid=postgres", "--regid=postgres", "--clear-groups", "--"]).arg(program);
    command
}

/// Opens the log of a server for appending, so that a person can find the reason why it does not answer.
fn open_log(log: &Path) -> fs::File {
    fs::OpenOptions::new().create(true).append(true).open(log).expect("a log")
}

/// Starts a database server with the database and the user `panelprep`, in this folder.
pub fn database(programs: &Path, folder: &Path, port: u16) -> Server {
    let data = folder.join("postgres");
    fs::create_dir_all(&data).expect("a folder");
    if rustix::process::geteuid().is_root() {
        // The other user needs access to the parent folder.
        let open = |path: &Path| fs::set_permissions(path, std::os::unix::fs::PermissionsExt::from_mode(0o755));
        open(folder).expect("opened");
        let given = Command::new("chown").arg("postgres").arg(&data).status().expect("chown");
        assert!(given.success());
    }
    let data_text = data.display().to_string();
    if !data.join("PG_VERSION").exists() {
        let made = as_user(&programs.join("initdb"))
            .args(["-D", &data_text, "-U", "panelprep", "--auth=trust", "-E", "UTF8", "--no-sync"])
            .stdout(Stdio::null())
            .status();
        assert!(made.expect("initdb").success());
    }
    let (programs, started, log) = (programs.to_owned(), programs.to_owned(), folder.join("postgres.log"));
    let server = Server::new(port, move || {
        // Processes of a killed server do not belong to the new server; PostgreSQL checks by itself whether it may
        // start.
        as_user(&started.join("postgres"))
            .args(["-D", &data_text, "-p", &port.to_string(), "-k", "", "-c", "listen_addresses=127.0.0.1"])
            .stdout(Stdio::null())
            .stderr(open_log(&log))
            .spawn()
            .expect("postgres starts")
    });
    let since = Instant::now();
    loop {
        let arguments = ["-h", "127.0.0.1", "-p", &port.to_string(), "-U", "panelprep", "panelprep"];
        let made = Command::new(programs.join("createdb")).args(arguments).stderr(Stdio::null()).status();
        if made.expect("createdb").success() {
            return server;
        }
        assert!(since.elapsed() < TIMEOUT, "the database cannot be made");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Writes the settings of the archive with these ports into this folder.
pub fn archive_settings(folder: &Path, broker_port: u16, database_port: u16) -> PathBuf {
    let file = folder.join("archive.toml");
    let text = format!(
        "files = \"files\"\n[broker]\naddress = \"nats://127.0.0.1:{broker_port}\"\nwaiting_gb = 1\n[database]\nport = {database_port}\n"
    );
    fs::write(&file, text).expect("written");
    file
}

//! A computer on which the package is installed: its files as `Cargo.toml` lists them, in a folder that replaces `/`,
//! and stand-ins for the system programs that the manual names. A stand-in refuses a package, unit or group that does
//! not exist.

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;

/// System folders that a command may name.
const OF_THE_SYSTEM: [&str; 4] = ["/etc/", "/usr/share/", "/var/", "/run/"];

/// The computer.
pub struct Computer {
    pub root: PathBuf,
    /// The folder in which the person works; `exported` contains the exported environment variables.
    pub works_in: PathBuf,
    pub exported: Vec<(String, String)>,
}

impl Computer {
    /// Creates a computer with the package's files.
    pub fn new(root: &Path) -> Self {
        let home = Path::new(env!("CARGO_MANIFEST_DIR"));
        let table: toml::Table =
            fs::read_to_string(home.join("Cargo.toml")).expect("it is there").parse().expect("TOML");
        let assets = table["package"]["metadata"]["deb"]["assets"].as_array().expect("the package's files");
        for asset in assets {
            let (from, to) = (asset[0].as_str().expect("a name"), asset[1].as_str().expect("a name"));
            if let Some(folder) = from.strip_suffix("/*").filter(|folder| folder.starts_with("config/")) {
                copy_files(&home.join(folder), &root.join(to), "");
            } else if let Some(ending) = from.strip_prefix("config/*") {
                copy_files(&home.join("config"), &root.join(to), ending);
            } else if from.starts_with("target/release/") {
                fs::create_dir_all(root.join(to)).expect("a folder");
                symlink(env!("CARGO_BIN_EXE_panelprep"), root.join(to).join("panelprep")).expect("a link");
            } else if !from.starts_with("target/") {
                let name =
                    if to.ends_with('/') { Path::new(from).file_name().expect("a name") } else { "".as_ref() };
                let target = if name.is_empty() { root.join(to) } else { root.join(to).join(name) };
                fs::create_dir_all(target.parent().expect("a folder")).expect("a folder");
                fs::copy(home.join(from), target).expect("copied");
            }
        }
        for folder in ["etc/panelprep", "etc/sysctl.d", "var/lib/panelprep", "var/tmp", "bin"] {
            fs::create_dir_all(root.join(folder)).expect("a folder");
        }
        let computer = Computer { root: root.to_owned(), works_in: root.to_owned(), exported: Vec::new() };
        computer.stand_ins();
        computer
    }

    /// Returns the text with the folders of this computer, the address of its controller, and shorter waiting times.
    pub fn adapted_text(&self, text: &str) -> String {
        let root = self.root.display().to_string();
        let folders = OF_THE_SYSTEM.iter().fold(text.to_owned(), |text, folder| {
            [" ", "=", "\""].iter().fold(text, |text, before| {
                text.replace(&format!("{before}{folder}"), &format!("{before}{root}{folder}"))
            })
        });
        folders.replace("172.31.1.147", "127.0.0.1").replace("--count 20 --every-s 4", "--count 12 --every-s 0")
    }

    /// Returns a shell command for a line, as a person types it.
    pub fn shell_command(&self, line: &str) -> Command {
        let mut command = Command::new("sh");
        let path = format!("{0}/bin:{0}/usr/bin:{1}", self.root.display(), env!("PATH"));
        command.args(["-c", line]).current_dir(&self.works_in).env("PATH", path);
        command.envs(self.exported.iter().map(|(name, value)| (name, value)));
        command
    }

    fn stand_ins(&self) {
        let unit =
            fs::read_to_string(self.root.join("usr/lib/systemd/system/panelprep.service")).expect("the unit");
        let starts = unit.lines().find_map(|line| line.strip_prefix("ExecStart=/usr/bin/")).expect("it starts");
        let starts = self.adapted_text(starts);
        let root = self.root.display();
        let group = fs::read_to_string(self.root.join("usr/lib/sysusers.d/panelprep.conf")).expect("its users");
        assert!(group.lines().any(|line| line.starts_with("u panelprep ")), "the package makes the group");
        let package = format!("./panelprep_{}-1_amd64.deb", env!("CARGO_PKG_VERSION"));
        for (name, script) in [
            (
                "sudo",
                "while :; do case \"$1\" in -u) shift 2 ;; -s) exit 0 ;; *) break ;; esac; done\nexec \"$@\""
                    .to_owned(),
            ),
            ("apt-get", format!("[ \"$1\" = install ] && [ \"$2\" = {package} ]")),
            ("usermod", "[ \"$1 $2\" = '--append --groups' ]".to_owned()),
            ("chown", "[ \"$1 $2\" = '-R panelprep:panelprep' ] && [ -d \"$3\" ] && [ -d \"$4\" ]".to_owned()),
            ("sysctl", "[ \"$1\" = --system ]".to_owned()),
            ("ip", "[ \"$*\" = '-brief address' ]".to_owned()),
            ("ping", "[ \"$1 $2\" = '-c 3' ]".to_owned()),
            ("journalctl", format!("[ \"$1 $2\" = '--unit panelprep' ] && cat {root}/service.log")),
            ("systemctl", systemctl(&root.to_string(), &starts)),
        ] {
            let file = self.root.join("bin").join(name);
            fs::write(&file, format!("#!/bin/sh\n{script}\n")).expect("written");
            fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).expect("made executable");
        }
    }
}

/// Returns a script that starts the command line of the unit, waits until the service answers, and ends it by SIGTERM.
fn systemctl(root: &str, starts: &str) -> String {
    format!(
        "[ \"$1\" = daemon-reload ] && exit 0\n\
         [ \"$1\" = enable ] && [ \"$2\" = --now ] && shift && shift && set -- start \"$@\"\n\
         [ \"$2\" = panelprep ] || {{ echo \"Unit $2.service not found.\" >&2; exit 5; }}\n\
         running() {{ [ -e {root}/pid ] && kill -0 $(cat {root}/pid) 2>/dev/null; }}\n\
         stop() {{ running || return 0; kill $(cat {root}/pid); while running; do sleep 0.05; done; }}\n\
         start() {{\n\
           {starts} >>{root}/service.log 2>&1 & echo $! >{root}/pid\n\
           for n in $(seq 1200); do panelprep ctl state >/dev/null 2>&1 && return 0; running || return 1; sleep 0.1; done; return 1\n\
         }}\n\
         case \"$1\" in\n\
           start) running || start ;;\n\
           stop) stop ;;\n\
           restart) stop; start ;;\n\
           status) running ;;\n\
           *) exit 1 ;;\n\
         esac"
    )
}

/// Copies the files of a folder whose names end with this text.
fn copy_files(from: &Path, to: &Path, ending: &str) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).unwrap_or_else(|error| panic!("{}: {error}", from.display())) {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if path.is_file() && name.ends_with(ending) {
            fs::copy(&path, to.join(name)).expect("copied");
        }
    }
}

impl Drop for Computer {
    fn drop(&mut self) {
        let _ = self.shell_command("systemctl stop panelprep").status();
    }
}

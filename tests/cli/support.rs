//! An empty folder to run the program in, and a small scene.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use tempfile::TempDir;

/// What one call of the program left behind.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    call: String,
}

impl Answer {
    fn new(call: String, output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("the program prints UTF-8");
        let code = output.status.code().unwrap_or_else(|| panic!("{call}: killed, {}", output.status));
        Self { code, stdout: text(output.stdout), stderr: text(output.stderr), call }
    }

    #[track_caller]
    pub(crate) fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, code, "{}\nstdout: {}\nstderr: {}", self.call, self.stdout, self.stderr);
        // A panic has exit code 101, but one in a worker thread might hide.
        assert!(!self.stderr.contains("panicked"), "{}: {}", self.call, self.stderr);
        self
    }

    /// Succeeds with nothing but results on standard output.
    #[track_caller]
    pub(crate) fn done(self) -> Self {
        self.expect(0)
    }

    /// Refused: exit code 2, nothing on standard output, and a message on standard error with all of `parts`.
    #[track_caller]
    pub(crate) fn refused(self, parts: &[&str]) -> Self {
        let answer = self.expect(2);
        assert_eq!(answer.stdout, "", "{}", answer.call);
        answer.says(parts)
    }

    #[track_caller]
    pub(crate) fn says(self, parts: &[&str]) -> Self {
        for part in parts {
            assert!(self.stderr.contains(part), "{}: '{}' lacks '{part}'", self.call, self.stderr);
        }
        self
    }

    #[track_caller]
    pub(crate) fn prints(self, parts: &[&str]) -> Self {
        for part in parts {
            assert!(self.stdout.contains(part), "{}: '{}' lacks '{part}'", self.call, self.stdout);
        }
        self
    }

    #[track_caller]
    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{}: {error}: {}", self.call, self.stdout))
    }
}

/// A folder of its own, removed with the test.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// With `cube.toml` and its run in `run/`.
    pub(crate) fn with_run() -> Self {
        let folder = Self::new();
        folder.write("cube.toml", CUBE);
        folder.yawara(&["run", "cube.toml", "-o", "run"]).done();
        folder
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("a file in a folder")).expect("a folder");
        std::fs::write(path, text).expect("a file");
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Runs the program here.
    pub(crate) fn yawara(&self, arguments: &[&str]) -> Answer {
        let output = Command::new(PROGRAM).args(arguments).current_dir(self.0.path()).output().expect("the program");
        Answer::new(arguments.join(" "), output)
    }

    /// Runs a line of shell here, in which `$Y` is the program.
    pub(crate) fn shell(&self, line: &str) -> Answer {
        let output = Command::new("sh")
            .args(["-c", line])
            .env("Y", PROGRAM)
            .current_dir(self.0.path())
            .output()
            .expect("a shell");
        Answer::new(line.to_owned(), output)
    }

    /// Every file below a folder with its bytes, by its path from there; folders as paths that end in `/`.
    pub(crate) fn tree(&self, name: &str) -> BTreeMap<String, Vec<u8>> {
        fn walk(folder: &Path, prefix: &str, found: &mut BTreeMap<String, Vec<u8>>) {
            for entry in std::fs::read_dir(folder).expect("a folder") {
                let entry = entry.expect("an entry");
                let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
                if entry.path().is_dir() {
                    walk(&entry.path(), &format!("{name}/"), found);
                    found.insert(format!("{name}/"), Vec::new());
                } else {
                    found.insert(name, std::fs::read(entry.path()).expect("a file"));
                }
            }
        }
        let mut found = BTreeMap::new();
        walk(&self.path(name), "", &mut found);
        found
    }

    /// Everything here: what a refused command must leave as it was.
    pub(crate) fn everything(&self) -> BTreeMap<String, Vec<u8>> {
        self.tree("")
    }
}

pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_yawara");

/// A file of this repository.
pub(crate) fn fixture(name: &str) -> String {
    format!("{}/fixtures/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// 1000 particles, cut in part and pushed, 40 steps and 5 frames.
pub(crate) const CUBE: &str = r#"
[volume]
phantom = "cube"
spacing = 6.0

[lattice]
model = "paper"

[[organ]]
name = "cube"
label = "cube"
stiffness = 7.5
damping = 1e-3
mass = 2.3e-4

[time]
steps = 40
dt = 5e-4
frames = 4

[[fix]]
name = "table"
region = { half_space = { point = [0, 0, -24], normal = [0, 0, -1] } }

[[cut]]
name = "half"
blade = [[-40, 0.4, 0], [40, 0.4, 0]]
path = [[0, 0, 40], [0, 0, 0]]
from = 0.0
to = 0.005

[[push]]
name = "hand"
region = { box = { min = [-31, 1, 15], max = [31, 31, 31] } }
force = [0, 1.5, 0]
from = 0.005
"#;

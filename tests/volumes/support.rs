//! Where the real data lies, and small things several tests need.

use std::fmt::Debug;
use std::path::{Path, PathBuf};

/// A file or folder of the shared data, or `None` (said loudly) when it is not on this machine.
pub(crate) fn shared_data(name: &str) -> Option<PathBuf> {
    let root = match std::env::var_os("YAWARA_DATA") {
        Some(root) => PathBuf::from(root),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
    };
    let path = root.join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: {} is not there; set YAWARA_DATA to the folder that holds {name}", path.display());
    None
}

/// The name of an enum variant, from its debug form.
pub(crate) fn variant(error: &impl Debug) -> String {
    format!("{error:?}").chars().take_while(char::is_ascii_alphanumeric).collect()
}

/// Fails with the message when a part of it is missing.
pub(crate) fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "\"{part}\" is not in: {message}");
    }
}

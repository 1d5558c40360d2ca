//! How a document lies in files: one GLB, or JSON (`.gltf`) with its buffer beside it (`.bin`).

use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::{CHUNK_BIN, CHUNK_JSON, MAGIC, VERSION};
use crate::io::atomic;
use crate::io::syncing_file::SyncingFile;

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Container {
    Glb,
    /// JSON, and a buffer of the same name with the extension `bin`.
    Separate,
}

impl Container {
    /// What the extension asks for: JSON for `.gltf`, else GLB.
    pub(super) fn of(path: &Path) -> Self {
        let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gltf"));
        if json { Self::Separate } else { Self::Glb }
    }

    /// What the JSON says of where the buffer is.
    pub(super) fn buffer_uri(self, path: &Path) -> Option<String> {
        let name = path.with_extension("bin").file_name()?.as_encoded_bytes().to_vec();
        (self == Self::Separate).then(|| percent_encode(&name))
    }

    /// Writes JSON and a buffer of `bytes` bytes, which `write` writes. A buffer of its own appears before the JSON that names it.
    pub(super) fn write(
        self,
        path: &Path,
        json: &[u8],
        bytes: u64,
        write: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>,
    ) -> io::Result<()> {
        if self == Self::Separate {
            atomic::write_file(&path.with_extension("bin"), |out| write(out))?;
            return atomic::write_file(path, |out| out.write_all(json));
        }
        let (json_length, bin_length) = (json.len().next_multiple_of(4), bytes.next_multiple_of(4));
        let total = 12 + 8 + json_length as u64 + 8 + bin_length;
        let word = |length: u64| u32::try_from(length).map_err(|_| io::Error::other("a GLB of more than 4 GiB"));
        let (total, json_word, bin_word) = (word(total)?, word(json_length as u64)?, word(bin_length)?);
        atomic::write_file(path, |out: &mut BufWriter<SyncingFile>| {
            for word in [MAGIC, VERSION, total, json_word, CHUNK_JSON] {
                out.write_all(&word.to_le_bytes())?;
            }
            out.write_all(json)?;
            out.write_all(&b"   "[..json_length - json.len()])?;
            out.write_all(&bin_word.to_le_bytes())?;
            out.write_all(&CHUNK_BIN.to_le_bytes())?;
            write(out)?;
            out.write_all(&[0; 3][..(bin_length - bytes) as usize])
        })
    }
}

/// A file name as part of a URI (RFC 3986): all but unreserved characters as `%XX`.
fn percent_encode(name: &[u8]) -> String {
    let plain = |byte: &u8| byte.is_ascii_alphanumeric() || b"-._~".contains(byte);
    name.iter().map(|byte| if plain(byte) { char::from(*byte).to_string() } else { format!("%{byte:02X}") }).collect()
}

/// The file name that a URI stands for, when it names a file in the same folder.
pub(super) fn file_beside(uri: &str) -> Option<String> {
    let mut name = Vec::new();
    let mut bytes = uri.bytes();
    while let Some(byte) = bytes.next() {
        let mut digit = || bytes.next().and_then(|digit| char::from(digit).to_digit(16));
        name.push(if byte == b'%' { (16 * digit()? + digit()?) as u8 } else { byte });
    }
    let name = String::from_utf8(name).ok()?;
    let plain = !name.is_empty() && name != ".." && !name.contains(['/', '\\', ':', '\0']);
    plain.then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_survive_the_uri() {
        for name in ["liver.bin", "my liver 100%.bin", "fígado#1?.bin"] {
            let uri = percent_encode(name.as_bytes());
            assert!(uri.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._~%".contains(&byte)), "{uri}");
            assert_eq!(file_beside(&uri).as_deref(), Some(name));
        }
        for uri in
            ["", "data:application/octet-stream;base64,AAAA", "http://a/b.bin", "../b.bin", "a%2Fb.bin", "a%2", ".."]
        {
            assert_eq!(file_beside(uri), None, "{uri}");
        }
    }
}

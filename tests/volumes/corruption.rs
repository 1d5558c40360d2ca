//! Damage anywhere in a file: an error or a volume, never a panic, never memory beyond what the file could fill.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use yawara::io::nifti::{read_ct, read_info, read_labels};

use crate::builder::{Nifti, gzip};

/// Growth of the address space that no small file can explain [kB]; a reserved size taken from a damaged header would be
/// far larger (one byte of a 64-bit dimension is worth up to 2^63 voxels).
const MAX_GROWTH: u64 = 1 << 20;

/// Peak address space of this process [kB], where the system tells.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmPeak:")?.trim().strip_suffix("kB")?.trim().parse().ok())
}

/// Sound files of every kind: version, byte order, plain and gzip; with sform and with qform.
fn sound_files() -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    for two in [false, true] {
        for big in [false, true] {
            let mut nifti = Nifti { big, ..Nifti::new([4, 3, 2]) };
            if two {
                nifti = nifti.two();
            }
            if big {
                (nifti.qform_code, nifti.sform_code, nifti.quatern) = (1, 0, [0.1, 0.2, 0.3]);
            }
            let name = format!("v{}-{}", 1 + u8::from(two), if big { "big" } else { "little" });
            files.push((format!("{name}.nii"), nifti.file()));
            files.push((format!("{name}.nii.gz"), gzip(&nifti.file())));
        }
    }
    files
}

/// True when the voxels came out; then header and labels are tried as well.
fn survives(path: &Path) -> bool {
    match read_ct(path) {
        Ok((volume, found)) => {
            assert_eq!(volume.as_slice().len(), found.shape().len());
            assert!(volume.as_slice().iter().all(|value| value.is_finite()));
            let header = read_info(path).unwrap();
            assert_eq!(header.grid, found.grid);
            if let Ok((labels, _)) = read_labels(path) {
                assert_eq!(labels.as_slice().len(), volume.as_slice().len());
            }
            true
        }
        Err(error) => {
            assert!(error.to_string().contains(path.file_name().unwrap().to_str().unwrap()));
            false
        }
    }
}

/// Changes one byte of an open file: far quicker than writing the file again.
fn put(file: &mut File, at: usize, byte: u8) {
    file.seek(SeekFrom::Start(at as u64)).unwrap();
    file.write_all(&[byte]).unwrap();
}

#[test]
fn no_truncation_is_read_as_a_volume() {
    let folder = tempfile::tempdir().unwrap();
    let mut cases = 0;
    for (name, bytes) in sound_files() {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        assert!(survives(&path), "{}", path.display());
        let file = File::options().write(true).open(&path).unwrap();
        for length in (0..bytes.len()).rev() {
            file.set_len(length as u64).unwrap();
            assert!(!survives(&path), "{} cut to {length} bytes", path.display());
            cases += 1;
        }
    }
    assert!(cases > 2500, "{cases}");
}

#[test]
fn no_damaged_byte_does_harm() {
    let before = peak();
    let folder = tempfile::tempdir().unwrap();
    let (mut cases, mut read) = (0, 0);
    for (name, bytes) in sound_files() {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        let mut file = File::options().write(true).open(&path).unwrap();
        for (at, byte) in bytes.iter().enumerate() {
            for damage in [0x01, 0x40, 0xff] {
                put(&mut file, at, byte ^ damage);
                read += u32::from(survives(&path));
                cases += 1;
            }
            put(&mut file, at, *byte);
        }
    }
    assert!(cases > 7500, "{cases}");
    assert!(read > 1000, "most bytes of a header mean nothing to us, but only {read} of {cases} were read");
    match (before, peak()) {
        (Some(before), Some(after)) => assert!(after - before < MAX_GROWTH, "{} kB more", after - before),
        _ => eprintln!("SKIPPED: the peak of memory is not known on this system"),
    }
}

#[test]
fn damaged_gzip_voxels_are_never_returned() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nii.gz");
    let bytes = gzip(&Nifti::new([4, 3, 2]).file());
    std::fs::write(&path, &bytes).unwrap();
    let (sound, _) = read_ct(&path).unwrap();
    let mut file = File::options().write(true).open(&path).unwrap();
    // From the compressed data on: the gzip header holds time and system, which mean nothing.
    for (at, byte) in bytes.iter().enumerate().skip(10) {
        for bit in 0..8 {
            put(&mut file, at, byte ^ (1 << bit));
            if let Ok((volume, _)) = read_ct(&path) {
                assert_eq!(volume, sound, "byte {at}, bit {bit}");
            }
        }
        put(&mut file, at, *byte);
    }
}

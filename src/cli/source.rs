//! What a path given on the command line holds, so that a command can say what it wants instead.

use std::path::Path;

use anyhow::bail;

use crate::io::mesh_format::MeshFormat;
use crate::io::nifti::{Datatype, VolumeInfo, read_labels};
use crate::volume::LabelVolume;

/// What a path holds, by what kind of entry it is and by its extension; whether it really does, its reader will tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    Run,
    Scene,
    Mesh(MeshFormat),
    Volume,
}

impl Source {
    /// What is at a path.
    ///
    /// # Errors
    /// If there is nothing.
    pub(super) fn of(path: &Path) -> anyhow::Result<Self> {
        if let Err(error) = path.metadata() {
            if error.kind() == std::io::ErrorKind::NotFound {
                bail!("{}: no such file or folder; check the path", path.display());
            }
            bail!("{}: could not be opened: {error}", path.display());
        }
        if path.is_dir() {
            return Ok(Self::Run);
        }
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
            return Ok(Self::Scene);
        }
        Ok(MeshFormat::from_path(path).map_or(Self::Volume, Self::Mesh))
    }

    /// Refuses a path that holds something else than a command wants, with what to do about it.
    pub(super) fn refuse(self, path: &Path, wanted: &str) -> anyhow::Error {
        let path = path.display();
        let (found, next) = match self {
            Self::Run => (
                "a folder",
                "for a run folder see `yawara info`, `mesh`, `render`, `slice`, `volume` and `check`".to_owned(),
            ),
            Self::Scene => ("a scene", format!("`yawara run {path}` makes a run of it")),
            Self::Mesh(_) => {
                ("a mesh", format!("see `yawara info {path}`, `yawara check {path}` or `yawara render {path}`"))
            }
            Self::Volume => {
                ("not one by its name", "name a volume as volume.image or volume.labels of a scene".to_owned())
            }
        };
        anyhow::anyhow!("{path}: expected {wanted}, but this is {found}; {next}")
    }
}

/// Most labels of a label map: an image without sign or scale has more different values.
const MOST_LABELS: usize = 512;

/// The volume as a label map, if it looks like one: bytes or words without sign and scale, with few different values.
pub(super) fn label_map(path: &Path, header: &VolumeInfo) -> anyhow::Result<Option<LabelVolume>> {
    if header.scaling.is_some() || !matches!(header.datatype, Datatype::U8 | Datatype::U16) {
        return Ok(None);
    }
    let (labels, _) = read_labels(path)?;
    Ok((labels.label_summaries().len() <= MOST_LABELS).then_some(labels))
}

/// Refuses a path that does not end in `.png`.
pub(super) fn expect_png(path: &Path) -> anyhow::Result<()> {
    if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("png")) {
        bail!("{}: pictures are written as PNG; give a name that ends in .png", path.display());
    }
    Ok(())
}

//! Where pictures go: one PNG, numbered PNGs, or one animated PNG.

use std::path::{Path, PathBuf};

use anyhow::bail;

use crate::io::apng::Delays;
use crate::io::mesh_format::FramePattern;

/// The files that the frames asked for become.
pub(super) enum Pictures {
    One(PathBuf),
    Numbered(FramePattern),
    Animation(PathBuf),
}

impl Pictures {
    /// Path of the picture of a frame, in a run whose last frame is `last`.
    pub(super) fn path(&self, frame: usize, last: usize) -> PathBuf {
        match self {
            Self::One(path) | Self::Animation(path) => path.clone(),
            Self::Numbered(pattern) => pattern.path(frame, last),
        }
    }

    /// What a path asks for, when so many frames are drawn.
    pub(super) fn of(path: &Path, frames: usize) -> anyhow::Result<Self> {
        let animated = is_animation(path)?;
        let pattern = FramePattern::parse(path)?;
        let shown = path.display();
        match (pattern, animated) {
            (Some(_), true) => bail!(
                "{shown}: an animated PNG holds all frames in one file; leave {{frame}} out of its name, or end the name in .png \
                 for a file per frame"
            ),
            (Some(pattern), false) => Ok(Self::Numbered(pattern)),
            (None, true) if frames < 2 => {
                bail!("{shown}: an animated PNG holds several frames; add --frame all, or end the name in .png")
            }
            (None, true) => Ok(Self::Animation(path.to_path_buf())),
            (None, false) if frames < 2 => Ok(Self::One(path.to_path_buf())),
            (None, false) => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                bail!(
                    "{shown}: {frames} frames do not fit into one picture; put {{frame}} into its name, such as {stem}_{{frame}}.png, or \
                     end it in .apng for an animation"
                )
            }
        }
    }
}

/// Whether a path is that of an animated PNG; refuses what is neither that nor a PNG.
pub(super) fn is_animation(path: &Path) -> anyhow::Result<bool> {
    let ends_in = |wanted: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted));
    if !ends_in("png") && !ends_in("apng") {
        bail!(
            "{}: pictures are written as PNG; give a name that ends in .png, or in .apng for an animation",
            path.display()
        );
    }
    Ok(ends_in("apng"))
}

/// How long each frame is shown.
pub(super) fn delays(path: &Path, times: &[f64], slow: f64) -> anyhow::Result<Delays> {
    if !(slow.is_finite() && slow > 0.0) {
        bail!("--slow is {slow}, expected a factor above 0, such as 10 for a tenth of the speed");
    }
    match Delays::between(times, slow) {
        Some(delays) => Ok(delays),
        None => bail!(
            "{}: frames from {} to {} s, {slow} times slower, cannot be shown one after the other: each must be later than the one before, \
             by at most 65535 s; take another --slow",
            path.display(),
            times.first().copied().unwrap_or_default(),
            times.last().copied().unwrap_or_default()
        ),
    }
}

//! `yawara phantom`: an embedded phantom as NIfTI files.

use anyhow::bail;

use super::args::{KindChoice, PhantomArguments};
use super::exit::Outcome;
use super::messages::{Messages, out};
use crate::io::atomic::write_file;
use crate::io::nifti::{CtEncoding, write_ct, write_labels};
use crate::phantom;
use crate::scene::resolved::PhantomKind;

pub(super) fn phantom(arguments: &PhantomArguments, _: &Messages) -> anyhow::Result<Outcome> {
    let folder = &arguments.output;
    if folder.exists() && !folder.is_dir() {
        bail!("{}: is a file; give a folder to write to", folder.display());
    }
    let kind = match arguments.kind {
        KindChoice::Abdomen => PhantomKind::Abdomen,
        KindChoice::Cube => PhantomKind::Cube,
        KindChoice::Beam => PhantomKind::Beam,
    };
    let made = phantom::make(kind, arguments.spacing, arguments.seed)?;
    let image = folder.join("ct.nii.gz");
    let labels = folder.join("labels.nii.gz");
    let names = folder.join("labels.tsv");
    write_ct(&image, &made.image, CtEncoding::Int16)?;
    write_labels(&labels, &made.labels)?;
    write_file::<std::io::Error>(&names, |writer| {
        use std::io::Write;
        writeln!(writer, "id\tname")?;
        made.names.iter().try_for_each(|(label, name)| writeln!(writer, "{label}\t{name}"))
    })?;
    out(&format!("{}\n{}\n{}", image.display(), labels.display(), names.display()))?;
    Ok(Outcome::Done)
}

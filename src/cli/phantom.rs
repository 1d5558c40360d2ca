//! `yawara phantom`: an embedded phantom as NIfTI files.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, bail};

use super::args::{KindChoice, PhantomArguments};
use super::exit::Outcome;
use super::messages::out;
use crate::io::atomic::write_file;
use crate::io::nifti::{CtEncoding, write_ct, write_labels};
use crate::phantom::{self, Phantom};
use crate::scene::resolved::PhantomKind;

const IMAGE: &str = "ct.nii.gz";
const LABELS: &str = "labels.nii.gz";
const NAMES: &str = "labels.tsv";

pub(super) fn phantom(arguments: &PhantomArguments) -> anyhow::Result<Outcome> {
    let folder = &arguments.output;
    if folder.exists() && !folder.is_dir() {
        bail!("{}: is a file; give a folder to write to", folder.display());
    }
    let paths = [IMAGE, LABELS, NAMES].map(|name| folder.join(name));
    if let Some(path) = paths.iter().find(|path| !arguments.overwrite && path.exists()) {
        bail!("{}: exists; choose another folder, or replace it (--overwrite)", path.display());
    }
    let kind = match arguments.kind {
        KindChoice::Abdomen => PhantomKind::Abdomen,
        KindChoice::Cube => PhantomKind::Cube,
        KindChoice::Beam => PhantomKind::Beam,
    };
    let made = phantom::make(kind, arguments.spacing, arguments.seed)?;
    if let Err(error) = write(&made, &paths) {
        // Image and labels belong together: rather none than one.
        paths.iter().for_each(|path| drop(std::fs::remove_file(path)));
        return Err(error);
    }
    out(&paths.map(|path| path.display().to_string()).join("\n"))?;
    Ok(Outcome::Done)
}

fn write(made: &Phantom, [image, labels, names]: &[impl AsRef<Path>; 3]) -> anyhow::Result<()> {
    write_ct(image.as_ref(), &made.image, CtEncoding::Int16)?;
    write_labels(labels.as_ref(), &made.labels)?;
    let names = names.as_ref();
    write_file::<std::io::Error>(names, |writer| {
        writeln!(writer, "id\tname")?;
        made.names.iter().try_for_each(|(label, name)| writeln!(writer, "{label}\t{name}"))
    })
    .with_context(|| format!("{}: could not write the names of the labels", names.display()))
}

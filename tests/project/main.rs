//! The project about itself: what its documents say is there.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn folders(path: &Path) -> BTreeSet<String> {
    fs::read_dir(path)
        .unwrap()
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.path().is_dir())
        .map(|entry| entry.file_name().into_string().unwrap())
        .collect()
}

#[test]
fn the_code_map_names_every_folder() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("src/lib.rs")).unwrap();
    let mapped: BTreeSet<String> = text
        .lines()
        .filter_map(|line| line.strip_prefix("//! | [`")?.split_once('`'))
        .map(|(folder, _)| folder.to_owned())
        .collect();
    assert_eq!(mapped, folders(&root.join("src")));
}

#[test]
fn only_the_command_line_prints_or_exits() {
    fn visit(path: &Path, found: &mut Vec<String>, count: &mut usize) {
        for entry in fs::read_dir(path).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                visit(&path, found, count);
                continue;
            }
            *count += 1;
            let text = fs::read_to_string(&path).unwrap();
            // Test modules stand at the end of a file and may print.
            let code = text.split("#[cfg(test)]").next().unwrap();
            for word in ["println!(", "eprintln!(", "print!(", "dbg!(", "process::exit"] {
                if code.contains(word) {
                    found.push(format!("{}: {word}", path.display()));
                }
            }
        }
    }
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let (mut found, mut count) = (Vec::new(), 0);
    for folder in folders(&source).into_iter().filter(|folder| folder != "cli") {
        visit(&source.join(folder), &mut found, &mut count);
    }
    assert!(count > 80, "only {count} files were read");
    assert_eq!(found, Vec::<String>::new());
}

//! Lists the files of `deploy/tuned` and its folders, so that a law's gains are found by name.

use std::{env, fs, io, path::Path};

fn main() -> io::Result<()> {
    let directory = Path::new(&env::var("CARGO_MANIFEST_DIR").expect("set by cargo"))
        .join("../deploy/tuned")
        .canonicalize()?;
    println!("cargo::rerun-if-changed={}", directory.display());
    let entries = listed(&directory, "")?;
    let out = Path::new(&env::var("OUT_DIR").expect("set by cargo")).join("tuned.rs");
    fs::write(out, format!("&[{entries}]"))
}

/// Name and text of every file of `directory` and its folders; `prefix` is before each name.
fn listed(directory: &Path, prefix: &str) -> io::Result<String> {
    let mut entries = String::new();
    for file in fs::read_dir(directory)? {
        let path = file?.path();
        let Some(name) = path.file_stem() else { continue };
        let name = format!("{prefix}{}", name.to_string_lossy());
        if path.is_dir() {
            entries += &listed(&path, &format!("{name}/"))?;
        } else if path.extension().is_some_and(|extension| extension == "toml") {
            entries += &format!("({name:?}, include_str!({path:?})), ");
        }
    }
    Ok(entries)
}

//! Lists the files of `deploy/tuned`, so that a law's tuned gains are found by file name.

use std::{env, fs, io, path::Path};

fn main() -> io::Result<()> {
    let directory = Path::new(&env::var("CARGO_MANIFEST_DIR").expect("set by cargo"))
        .join("../deploy/tuned")
        .canonicalize()?;
    println!("cargo::rerun-if-changed={}", directory.display());
    let mut entries = String::new();
    for file in fs::read_dir(&directory)? {
        let path = file?.path();
        if let (Some(name), Some("toml")) =
            (path.file_stem(), path.extension().and_then(|e| e.to_str()))
        {
            entries += &format!("({:?}, include_str!({path:?})), ", name.to_string_lossy());
        }
    }
    let out = Path::new(&env::var("OUT_DIR").expect("set by cargo")).join("tuned.rs");
    fs::write(out, format!("&[{entries}]"))
}

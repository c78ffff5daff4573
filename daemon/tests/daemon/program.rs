//! The program of this package, run in its own process.

use std::process::Command;

#[test]
fn help_succeeds_and_a_wrong_word_is_a_usage_error() {
    let code = |word| Command::new(env!("CARGO_BIN_EXE_oqtal-daemon")).arg(word).output().unwrap();
    assert_eq!(code("--help").status.code(), Some(0));
    assert_eq!(code("--version").status.code(), Some(0));
    assert_eq!(code("fly").status.code(), Some(64));
}

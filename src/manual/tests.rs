use super::*;
use crate::cli::Cli;
use clap::CommandFactory;

#[test]
fn every_command_has_a_page_and_hidden_ones_have_none() {
    let directory = tempfile::tempdir().unwrap();
    write_pages(Cli::command(), directory.path()).unwrap();
    let exists = |page: &str| directory.path().join(page).exists();
    for command in Cli::command().get_subcommands() {
        let page = format!("oqtal-{}.1", command.get_name());
        assert_eq!(exists(&page), !command.is_hide_set(), "{page}");
    }
    assert!(exists("oqtal.1") && exists("oqtal-daemon-run.1"));
    let page = std::fs::read_to_string(directory.path().join("oqtal-monitor.1")).unwrap();
    assert!(page.contains("no\\-color"), "{page}");
}

#[test]
fn every_shell_completes_commands_and_options() {
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        let mut script = Vec::new();
        clap_complete::generate(shell, &mut Cli::command(), "oqtal", &mut script);
        let script = String::from_utf8(script).unwrap();
        assert!(script.contains("monitor") && script.contains("no-color"), "{shell}");
    }
}

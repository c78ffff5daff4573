//! Reload of the daemon's files in flight.

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::text::LongText;
use oqtal_config::{Config, Setting};
use oqtal_daemon::{LiveSettings, Refusal};

/// Reads the files again; returns whether a setting differs.
fn reload(settings: &mut LiveSettings) -> Result<bool, Refusal> {
    let request = ControlRequestV1::of(OperatorCommand::Reload);
    let mut prepared = settings.prepare(OperatorCommand::Reload, &request)?;
    let differs = !settings.are_unchanged_by(&prepared);
    settings.commit(&mut prepared);
    Ok(differs)
}

/// A line that was added to the file of the daemon, read, and removed again has no effect any more.
#[test]
fn a_reload_returns_to_the_files_as_they_are() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("own.toml");
    let write = |text: &str| std::fs::write(&file, text).unwrap();
    write("trajectory.kind = \"hover\"\n");
    let config = Config::load(std::slice::from_ref(&file), &[]).unwrap();
    let mut settings = LiveSettings::new(&config, std::slice::from_ref(&file));
    write("trajectory.kind = \"hover\"\ntrajectory.height-m = 1.4\n");
    assert!(reload(&mut settings).unwrap());
    assert_eq!(settings.present().trajectory.height_m, 1.4);
    assert!(!reload(&mut settings).unwrap());
    write("trajectory.kind = \"hover\"\n");
    assert!(reload(&mut settings).unwrap());
    assert_eq!(settings.present(), &config);
}

/// A line of the daemon's start that was removed has no effect any more; a flag keeps precedence over the file.
#[test]
fn a_reload_takes_removed_lines_back_and_keeps_flags() {
    let directory = tempfile::tempdir().unwrap();
    let files = [directory.path().join("own.toml")];
    let write = |text: &str| std::fs::write(&files[0], text).unwrap();
    let law = "control.controller = \"oqtal\"\n";
    write(&format!("{law}trajectory.kind = \"hover\"\ntrajectory.height-m = 1.4\n"));
    let flag = Setting::flag("--controller", "control.controller", "pid");
    let config = Config::load(&files, std::slice::from_ref(&flag)).unwrap();
    let mut settings = LiveSettings::new(&config, &files);
    assert!(!reload(&mut settings).unwrap());
    write(&format!("{law}trajectory.kind = \"hover\"\n"));
    assert!(reload(&mut settings).unwrap());
    let present = settings.present();
    assert_eq!(present.control.controller.name(), "pid");
    assert_eq!(present.trajectory.height_m, Config::default().trajectory.height_m);
    write(&format!("{law}vehicle.mass-kg = 0.6\n"));
    let refusal = reload(&mut settings).unwrap_err();
    assert!(refusal.reason.contains("cannot change while the daemon runs"), "{refusal:?}");
}

/// Keys of the simulated vehicle, of its frames and of the poses follow others.
#[test]
fn a_refused_reload_names_the_key_as_the_file_has_it() {
    let directory = tempfile::tempdir().unwrap();
    let files = [directory.path().join("own.toml")];
    let write = |text: &str| std::fs::write(&files[0], text).unwrap();
    write("");
    let settings = LiveSettings::new(&Config::load(&files, &[]).unwrap(), &files);
    for (text, key) in [
        ("vehicle.mass-kg = 0.6\nvehicle.max-thrust-n = 12.0\n", "`vehicle.mass-kg`: "),
        ("plant.mass-kg = 0.6\n", "`plant.mass-kg`: "),
        ("mocap.rate-hz = 100.0\n", "`mocap.rate-hz`: "),
    ] {
        write(text);
        for path in ["", &files[0].display().to_string()] {
            let request = ControlRequestV1::of(OperatorCommand::Reload);
            let request = ControlRequestV1 { text: LongText::new(path), ..request };
            let refusal = settings.prepare(OperatorCommand::Reload, &request).unwrap_err();
            assert!(refusal.reason.contains("cannot change while"), "{refusal:?}");
            assert!(refusal.reason.contains(key), "{text}: {refusal:?}");
            assert!(refusal.reason.contains("own.toml:1: "), "{text}: {refusal:?}");
        }
    }
}

/// A pipe that nobody writes would be waited for, and with it every later request.
#[test]
fn only_regular_files_are_read_in_flight() {
    let directory = tempfile::tempdir().unwrap();
    let pipe = directory.path().join("pipe");
    let (kind, mode) = (rustix::fs::FileType::Fifo, rustix::fs::Mode::RUSR);
    rustix::fs::mknodat(rustix::fs::CWD, &pipe, kind, mode, 0).unwrap();
    let settings = LiveSettings::new(&Config::default(), std::slice::from_ref(&pipe));
    let named = pipe.display().to_string();
    for (command, text) in [
        (OperatorCommand::Reload, named.clone()),
        (OperatorCommand::Reload, String::new()),
        (OperatorCommand::Set, format!("trajectory.waypoints-file={named}")),
    ] {
        let text = LongText::new(&text);
        let request = ControlRequestV1 { text, ..ControlRequestV1::of(command) };
        let refusal = settings.prepare(command, &request).unwrap_err();
        assert!(refusal.reason.contains("not a regular file"), "{refusal:?}");
    }
}

#[test]
fn a_waypoint_file_that_is_set_again_is_read_again() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("points.csv");
    let write = |y: f64| std::fs::write(&file, format!("t,x,y,z\n0,0,0,1\n4,0,{y},1\n")).unwrap();
    let assignment = format!("trajectory.waypoints-file={}", file.display());
    write(0.5);
    let config = Config::from_settings(&[Setting::parse("test", &assignment).unwrap()]).unwrap();
    let mut settings = LiveSettings::new(&config, &[]);
    let text = LongText::new(&assignment);
    let set = ControlRequestV1 { text, ..ControlRequestV1::of(OperatorCommand::Set) };
    let same = settings.prepare(OperatorCommand::Set, &set).unwrap();
    assert!(settings.are_unchanged_by(&same));
    write(-0.5);
    let mut other = settings.prepare(OperatorCommand::Set, &set).unwrap();
    assert!(!settings.are_unchanged_by(&other));
    settings.commit(&mut other);
    let changed = settings.changed();
    assert!(
        changed[1].starts_with("trajectory.waypoints-file="),
        "unlike at the start: {changed:?}"
    );
    let undo = ControlRequestV1::of(OperatorCommand::Undo);
    let mut undo = settings.prepare(OperatorCommand::Undo, &undo).unwrap();
    settings.commit(&mut undo);
    assert!(settings.changed().is_empty());
}

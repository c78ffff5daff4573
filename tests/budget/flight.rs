//! A flight of the pure objects in one process, with every turn of the daemon handed to whoever counts.

use oqtal_bus::code::{Mode, Verb};
use oqtal_bus::conductor::{Conductor, Done};
use oqtal_bus::config::{Config, Setting};
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Party;
use oqtal_daemon::{Cycle, trajectory};
use oqtal_mocap_emu::{Cameras, is_frame};
use oqtal_plant_sim::{Output, Plant};

/// Flies the square under `law` and passes each turn of the daemon, report included, to `count`; returns the ticks flown.
pub fn fly(law: &str, resolve: &str, mut count: impl FnMut(&mut dyn FnMut())) -> u64 {
    let mut settings = vec![Setting::flag("test", "control.controller", law)];
    if law != "pid" {
        settings.push(Setting::flag("test", &format!("control.{law}.resolve"), resolve));
    }
    let config = Config::from_settings(&settings).unwrap();
    let start = Time::VIRTUAL_START;
    let mut plant = Plant::new(&config, start);
    let mut cameras = Cameras::new(&config.mocap, config.clock.seed);
    let mut cycle = Cycle::new(&config, trajectory(&config).unwrap(), start).unwrap();
    cycle.request(start, Verb::Fly);
    let mut conductor = Conductor::new(start, &Party::ALL[..3]);
    let mut frames: Vec<TruthV1> = Vec::new();
    let mut pose: Option<(Header, PoseV1)> = None;
    let mut command: Option<(Header, CommandV1)> = None;
    let (mut frame, mut sequence, mut flown) = (0, 0, 0);
    while let Some((party, now)) = conductor.turn() {
        if now > start + Span::from_seconds(40.0) {
            break;
        }
        let done = match party {
            Party::Plant => {
                plant.advance(now, |output| match output {
                    Output::Truth(truth) if is_frame(&truth) => frames.push(truth),
                    _ => {}
                });
                if let Some((header, command)) = command.take() {
                    plant.receive(now, header, command, 0);
                }
                Done { next: Some(plant.next_event()), published: !frames.is_empty() }
            }
            Party::Mocap => {
                frames.drain(..).for_each(|truth| cameras.capture(&truth));
                let mut published = false;
                while let Some(delivery) = cameras.deliver(now) {
                    frame += 1;
                    let stamps = delivery.stamps_at(now);
                    let header = Header {
                        sequence: frame,
                        pose_sequence: delivery.frame,
                        stamps,
                        ..Header::default()
                    };
                    pose = Some((header, delivery.pose));
                    published = true;
                }
                Done { next: cameras.next_event(), published }
            }
            Party::Daemon => {
                let arrival = pose.take();
                count(&mut || {
                    let Some(tick) = cycle.step(now, arrival.as_ref()) else { return };
                    let stamps =
                        Stamps { computed_at: now, command_published_at: now, ..tick.stamps };
                    sequence += 1;
                    let telemetry = cycle.report(&stamps, sequence);
                    flown += u64::from(telemetry.mode != Mode::Disarmed.code());
                    let header = Header {
                        sequence,
                        pose_sequence: tick.pose_sequence,
                        stamps,
                        ..Header::default()
                    };
                    command = Some((header, tick.command));
                });
                Done { next: Some(cycle.next_event()), published: command.is_some() }
            }
            Party::Recorder => Done::default(),
        };
        conductor.done(party, done);
    }
    flown
}

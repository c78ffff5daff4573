//! Connection to a Crazyflie: a sequence of requests, each repeated until it is answered. Afterwards the vehicle flies by rates
//! or angles as requested, and reports its state without further requests.
//!
//! ```text
//!  Greeting ▸ Version ▸ Reset of logging ▸ Table of log variables ▸ Table of parameters ▸ Parameters ▸ Blocks made, started ▸ Ready
//! ```
//!
//! A vehicle that is restarted has other parameters and no log blocks: when its reports stop, the connection begins again.

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{
    CrtpReply, CrtpRequest, CrtpValue, LogBlock, LogCommand, LogType, ParameterType, TableKind,
};

use super::cache::TableStore;
use super::known::{KnownElement, KnownTable};
use super::names::{
    BATTERY, ESTIMATE, ESTIMATOR, MAX_NAMES, REQUIRED_PARAMETERS, SUPERVISOR, names,
};
use super::search::TableSearch;
use crate::protocol::PeriodicTimer;

/// Time after which a request is repeated.
const REPEAT: Span = Span::from_millis(150);
/// First version of the protocol whose tables are read.
const OLDEST_PROTOCOL: u8 = 4;
/// Number of the block with battery, supervisor and gyroscope, and of that with the estimate \[-\].
pub const STATUS_BLOCK: u8 = 1;
pub const ESTIMATE_BLOCK: u8 = 2;
/// Longest time between two reports of the gyroscope: the daemon compares their integral with poses, and a vehicle turns into a tilt
/// within a tenth of a second.
const GYROSCOPE_PERIOD: Span = Span::from_millis(20);
/// Number of log blocks \[-\].
const BLOCKS: usize = 2;
/// A block exists already: the answer to a request that was repeated. An error of C.
const EXISTS: u8 = 17;
/// Choice of the estimator that takes poses: a Kalman filter.
const KALMAN: f64 = 2.0;

/// Step of the sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Greeting,
    Version,
    ResetLogging,
    Table(TableKind),
    Parameter(usize),
    CreateBlock(usize),
    StartBlock(usize),
    Ready,
    /// The firmware cannot be flown.
    Unusable,
}

/// Options of the connection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConnectionOptions {
    /// Whether roll and pitch are angles, and not rates.
    pub holds_attitude: bool,
    /// Whether poses are sent to the vehicle's estimator.
    pub sends_poses: bool,
    /// Time between two reports; those of the gyroscope are at most [`GYROSCOPE_PERIOD`] apart.
    pub report_period: Span,
}

/// Connection to one vehicle.
#[derive(Debug)]
pub struct CrtpConnection {
    options: ConnectionOptions,
    tables: TableStore,
    step: Step,
    repeat: PeriodicTimer,
    protocol: u8,
    search: TableSearch,
    logging: KnownTable,
    parameters: KnownTable,
}

impl CrtpConnection {
    /// Connection that has not begun; `tables` holds those of earlier connections.
    pub fn new(options: ConnectionOptions, tables: TableStore) -> Self {
        Self {
            options,
            tables,
            step: Step::Greeting,
            repeat: PeriodicTimer::new(REPEAT),
            protocol: 0,
            search: TableSearch::new(TableKind::Logging),
            logging: KnownTable::new(TableKind::Logging, 0),
            parameters: KnownTable::new(TableKind::Parameters, 0),
        }
    }

    /// Begins again.
    pub fn restart(&mut self) {
        self.go_to(Step::Greeting);
    }

    /// Whether the vehicle is set up.
    pub fn is_ready(&self) -> bool {
        self.step == Step::Ready
    }

    /// Whether the vehicle's firmware cannot be flown: its protocol is too old, or it lacks a variable or parameter that a flight needs.
    pub fn is_unusable(&self) -> bool {
        self.step == Step::Unusable
    }

    /// Version of the vehicle's protocol \[-\].
    pub fn protocol(&self) -> u8 {
        self.protocol
    }

    /// The request that is due at `now`, if any.
    pub fn request(&mut self, now: Time) -> Option<CrtpRequest> {
        if let Step::Table(_) = self.step {
            return self.search.request(now);
        }
        let request = self.step_request()?;
        self.repeat.is_due(now, false).then_some(request)
    }

    fn step_request(&self) -> Option<CrtpRequest> {
        match self.step {
            Step::Greeting => Some(CrtpRequest::Source),
            Step::Version => Some(CrtpRequest::ProtocolVersion),
            Step::ResetLogging => Some(CrtpRequest::ResetLogging),
            Step::Parameter(place) => {
                self.parameter(place).map(|(id, value)| CrtpRequest::WriteParameter(id, value))
            }
            Step::CreateBlock(block) => Some(CrtpRequest::CreateBlock(self.block(block))),
            Step::StartBlock(block) => {
                let (id, reports) = (block_id(block), self.options.report_period);
                let has_gyroscope = id == STATUS_BLOCK;
                let period = if has_gyroscope { reports.min(GYROSCOPE_PERIOD) } else { reports };
                let period = u8::try_from((period.nanos() / 10_000_000).clamp(1, 254));
                Some(CrtpRequest::StartBlock { id, period: period.unwrap_or(u8::MAX) })
            }
            Step::Table(_) | Step::Ready | Step::Unusable => None,
        }
    }

    /// Takes a reply.
    pub fn take(&mut self, reply: &CrtpReply) {
        match (self.step, reply) {
            (Step::Greeting, CrtpReply::Source) => self.go_to(Step::Version),
            (Step::Version, CrtpReply::ProtocolVersion(version)) => {
                self.protocol = *version;
                let usable = *version >= OLDEST_PROTOCOL;
                self.go_to(if usable { Step::ResetLogging } else { Step::Unusable });
            }
            (Step::ResetLogging, CrtpReply::Log(LogCommand::Reset, ..)) => {
                self.begin_table(TableKind::Logging);
            }
            (Step::Table(table), _) => self.take_table(table, reply),
            (Step::Parameter(place), CrtpReply::Written(id, value))
                if self.parameter(place) == Some((*id, *value)) =>
            {
                self.next_parameter(place + 1);
            }
            (Step::CreateBlock(block), CrtpReply::Log(LogCommand::Create, id, reason))
                if *id == block_id(block) && [0, EXISTS].contains(reason) =>
            {
                self.go_to(Step::StartBlock(block));
            }
            (Step::StartBlock(block), CrtpReply::Log(LogCommand::Start, id, 0))
                if *id == block_id(block) =>
            {
                self.next_block(block + 1);
            }
            _ => {}
        }
    }

    /// Whether reports of `block` have the variables of this connection. A vehicle that another host has set up, or a bridge before this
    /// one, sends reports of the same number until the logging is reset.
    pub fn is_made(&self, block: u8) -> bool {
        let made = match self.step {
            Step::CreateBlock(next) => next,
            Step::StartBlock(newest) => newest + 1,
            Step::Ready => BLOCKS,
            _ => 0,
        };
        (0..made).any(|index| block_id(index) == block)
    }

    /// Values of a report: places among the log variables, and types.
    pub fn fields(&self, block: u8) -> impl Iterator<Item = (usize, LogType)> + '_ {
        let places = match block {
            STATUS_BLOCK => BATTERY..ESTIMATE,
            ESTIMATE_BLOCK => ESTIMATE..MAX_NAMES,
            _ => 0..0,
        };
        places.filter_map(|place| self.variable(place).map(|(_, kind)| (place, kind)))
    }

    fn go_to(&mut self, step: Step) {
        self.step = step;
        self.repeat.restart();
    }

    fn begin_table(&mut self, table: TableKind) {
        self.search = TableSearch::new(table);
        self.go_to(Step::Table(table));
    }

    fn take_table(&mut self, table: TableKind, reply: &CrtpReply) {
        self.search.take(reply, &mut self.tables);
        let Some(found) = self.search.found().copied() else { return };
        match table {
            TableKind::Logging => {
                self.logging = found;
                // Without the supervisor's state it is unknown whether motors may run.
                match self.variable(SUPERVISOR) {
                    Some(_) => self.begin_table(TableKind::Parameters),
                    None => self.go_to(Step::Unusable),
                }
            }
            TableKind::Parameters => {
                self.parameters = found;
                let required = &found.elements[..REQUIRED_PARAMETERS];
                match required.iter().all(Option::is_some) {
                    true => self.next_parameter(0),
                    false => self.go_to(Step::Unusable),
                }
            }
        }
    }

    fn next_parameter(&mut self, from: usize) {
        let next =
            (from..names(TableKind::Parameters).len()).find(|p| self.parameter(*p).is_some());
        match next {
            Some(place) => self.go_to(Step::Parameter(place)),
            None => self.next_block(0),
        }
    }

    fn next_block(&mut self, from: usize) {
        let next = (from..BLOCKS).find(|block| self.fields(block_id(*block)).next().is_some());
        self.go_to(next.map_or(Step::Ready, Step::CreateBlock));
    }

    /// Number of a parameter and its required value; `None` if the firmware lacks it, or it needs no change.
    fn parameter(&self, place: usize) -> Option<(u16, CrtpValue)> {
        let KnownElement { id, kind } = self.parameters.elements[place]?;
        let wanted = match place {
            0 | 1 => f64::from(u8::from(self.options.holds_attitude)),
            ESTIMATOR if self.options.sends_poses => KALMAN,
            ESTIMATOR => return None,
            _ => 0.0,
        };
        Some((id, CrtpValue::of(ParameterType::from_wire(kind)?, wanted)))
    }

    fn variable(&self, place: usize) -> Option<(u16, LogType)> {
        let KnownElement { id, kind } = self.logging.elements[place]?;
        Some((id, LogType::from_wire(kind)?))
    }

    fn block(&self, block: usize) -> LogBlock {
        let id = block_id(block);
        self.fields(id).fold(LogBlock::new(id), |made, (place, kind)| {
            made.with(kind, self.variable(place).map_or(0, |(id, _)| id))
        })
    }
}

/// Number of block `index`.
fn block_id(index: usize) -> u8 {
    [STATUS_BLOCK, ESTIMATE_BLOCK][index.min(BLOCKS - 1)]
}

//! Change of the law in flight.

use super::{Controller, InputForm};

impl<I: InputForm> Controller<I> {
    /// Continues a flight that `old` controlled: a law of the same kind takes over its integral action.
    pub fn adopt(&mut self, old: &Self) {
        match (self, old) {
            (Self::Pid(law), Self::Pid(old)) => law.adopt(old),
            (Self::Lqr(law), Self::Lqr(old)) => law.adopt(old),
            (Self::Oqtal(law), Self::Oqtal(old)) => law.adopt(old),
            (Self::Geometric(law), Self::Geometric(old)) => law.adopt(old),
            // Another law, or one without integral action.
            _ => {}
        }
    }
}

//! r
use crate::flight::Flight;
use crate::summary::Summary;
/// x
pub fn html(_f: &Flight, _s: &Summary) -> String {
    String::new()
}

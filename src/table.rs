//! r
use crate::summary::Summary;
/// x
pub fn closing(s: &Summary) -> String {
    s.to_json()
}

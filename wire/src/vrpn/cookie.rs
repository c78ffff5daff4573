//! The cookie with which both ends begin.

/// Length of the cookie \[bytes\].
pub const COOKIE_BYTES: usize = 24;

/// Beginning of every cookie.
const MAGIC: &[u8] = b"vrpn: ver. ";

/// Version of VRPN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VrpnVersion {
    /// Major number \[-\]. Ends with different major numbers are incompatible.
    pub major: u8,
    /// Minor number \[-\].
    pub minor: u8,
}

/// Error in a cookie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CookieError {
    /// Bytes that are not a cookie.
    #[error("the other end does not use VRPN")]
    Magic,
    /// Major version other than ours.
    #[error("the other end uses VRPN {0}, expected 7")]
    Version(u8),
}

impl VrpnVersion {
    /// The supported version.
    pub const OURS: Self = Self { major: 7, minor: 38 };

    /// The cookie of this version, without a log of the connection.
    pub fn to_cookie(self) -> [u8; COOKIE_BYTES] {
        let text = format!("vrpn: ver. {:02}.{:02}  0", self.major % 100, self.minor % 100);
        let mut cookie = [0; COOKIE_BYTES];
        for (place, byte) in cookie.iter_mut().zip(text.bytes()) {
            *place = byte;
        }
        cookie
    }

    /// Reads the cookie of the other end.
    ///
    /// # Errors
    /// The bytes are not a cookie, or of another major version.
    pub fn from_cookie(cookie: &[u8; COOKIE_BYTES]) -> Result<Self, CookieError> {
        let numbers = cookie.strip_prefix(MAGIC).and_then(|rest| match rest {
            [a, b, b'.', c, d, ..] => Some((two_digits(*a, *b)?, two_digits(*c, *d)?)),
            _ => None,
        });
        let (major, minor) = numbers.ok_or(CookieError::Magic)?;
        if major != Self::OURS.major {
            return Err(CookieError::Version(major));
        }
        Ok(Self { major, minor })
    }
}

fn two_digits(tens: u8, ones: u8) -> Option<u8> {
    let digit = |byte: u8| byte.is_ascii_digit().then(|| byte - b'0');
    Some(digit(tens)? * 10 + digit(ones)?)
}

//! Names by number, as one peer describes them.

/// Maximum number of names of one peer; further ones are not kept \[-\].
const MAX_NAMES: usize = 2000;

/// Names of senders or types by the numbers of the peer that describes them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NameTable {
    names: Vec<Option<String>>,
}

impl NameTable {
    /// Enters a name. Negative numbers and those above 1999 are left out.
    pub fn set(&mut self, number: i32, name: &str) {
        let index = usize::try_from(number).ok().filter(|index| *index < MAX_NAMES);
        let Some(index) = index else { return };
        if self.names.len() <= index {
            self.names.resize(index + 1, None);
        }
        self.names[index] = Some(name.to_owned());
    }

    /// The name of a number.
    pub fn get(&self, number: i32) -> Option<&str> {
        self.names.get(usize::try_from(number).ok()?)?.as_deref()
    }
}

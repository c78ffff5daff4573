//! Options of a link: `,KEY=VALUE` behind its port, each key once.

/// Options that have not been taken yet.
#[derive(Debug)]
pub(super) struct LinkOptions<'a> {
    entries: Vec<(&'a str, &'a str)>,
}

impl<'a> LinkOptions<'a> {
    /// Splits `text` into what stands before the first comma, and the options.
    pub(super) fn split(text: &'a str) -> Result<(&'a str, Self), String> {
        let mut parts = text.split(',');
        let first = parts.next().unwrap_or_default();
        let mut entries: Vec<(&str, &str)> = Vec::new();
        for part in parts {
            let (key, value) =
                part.split_once('=').ok_or_else(|| format!("`{part}` has no `=`"))?;
            if entries.iter().any(|(known, _)| *known == key) {
                return Err(format!("`{key}` twice"));
            }
            entries.push((key, value));
        }
        Ok((first, Self { entries }))
    }

    /// Takes the value of `key`, if it is given.
    pub(super) fn take(&mut self, key: &str) -> Option<&'a str> {
        let index = self.entries.iter().position(|(known, _)| *known == key)?;
        Some(self.entries.remove(index).1)
    }

    /// Refuses options that nobody took.
    pub(super) fn finish(self) -> Result<(), String> {
        match self.entries.first() {
            Some((key, _)) => Err(format!("unknown option `{key}`")),
            None => Ok(()),
        }
    }
}

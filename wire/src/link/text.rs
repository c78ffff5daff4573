//! Grammar of all links: `KIND:ADDRESS[,KEY=VALUE]…`. The parsers of the kinds take their options; options that remain are refused.

use std::fmt::Display;

/// Error in the text of a link.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{object} `{text}`: {problem}; write {form}")]
pub struct InvalidLink {
    /// Object that the text describes.
    pub object: &'static str,
    /// Invalid text.
    pub text: String,
    /// Part of it that is wrong, and the allowed values.
    pub problem: String,
    /// Form of a link of this kind, or the forms of all kinds.
    pub form: String,
}

/// Text of a link, split into its parts.
#[derive(Clone, Debug)]
pub struct LinkText<'a> {
    /// Word before the first colon; everything before the options if there is no colon.
    pub kind: &'a str,
    /// Text between the first colon and the options; `None` without a colon.
    pub address: Option<&'a str>,
    /// Options that have not been taken yet.
    options: Vec<(&'a str, Option<&'a str>)>,
}

impl<'a> LinkText<'a> {
    /// Splits `text`.
    pub fn split(text: &'a str) -> Self {
        let mut parts = text.split(',');
        let head = parts.next().unwrap_or_default();
        let (kind, address) = match head.split_once(':') {
            Some((kind, address)) => (kind, Some(address)),
            None => (head, None),
        };
        let options = parts.map(|part| match part.split_once('=') {
            Some((key, value)) => (key, Some(value)),
            None => (part, None),
        });
        Self { kind, address, options: options.collect() }
    }

    /// Takes the option `key`: `None` if it is absent, otherwise its value, if it has one.
    fn take_option(&mut self, key: &str) -> Result<Option<Option<&'a str>>, String> {
        let Some(index) = self.options.iter().position(|(known, _)| *known == key) else {
            return Ok(None);
        };
        let (_, value) = self.options.remove(index);
        if self.options.iter().any(|(known, _)| *known == key) {
            return Err(format!("`{key}` twice"));
        }
        Ok(Some(value))
    }

    /// Takes the value of the option `key`, if it is given.
    ///
    /// # Errors
    /// The option has no value, or is given twice.
    pub fn take(&mut self, key: &str) -> Result<Option<&'a str>, String> {
        match self.take_option(key)? {
            Some(None) => Err(format!("`{key}` has no `=`")),
            given => Ok(given.flatten()),
        }
    }

    /// Takes the option `key`, which has no value; returns whether it is given.
    ///
    /// # Errors
    /// The option has a value, or is given twice.
    pub fn take_flag(&mut self, key: &str) -> Result<bool, String> {
        match self.take_option(key)? {
            Some(Some(value)) if !value.is_empty() => Err(format!("`{key}` has no value")),
            given => Ok(given.is_some()),
        }
    }

    /// Takes the values of an option that may be given several times.
    ///
    /// # Errors
    /// One of them has no value.
    pub fn take_all(&mut self, key: &str) -> Result<Vec<&'a str>, String> {
        let (taken, left) =
            std::mem::take(&mut self.options).into_iter().partition(|(known, _)| *known == key);
        self.options = left;
        let taken: Vec<(&str, Option<&str>)> = taken;
        let values = taken.into_iter().map(|(_, value)| value);
        values.map(|value| value.ok_or_else(|| format!("`{key}` has no `=`"))).collect()
    }

    /// Checks that every option has been taken.
    ///
    /// # Errors
    /// The first unknown option.
    pub fn finish(self) -> Result<(), String> {
        match self.options.first() {
            Some((key, _)) => Err(format!("unknown option `{key}` of {}", self.kind)),
            None => Ok(()),
        }
    }
}

/// Kind of link: its name, its form and the parser of its address and options.
pub(super) struct LinkKind<T> {
    /// Word before the colon.
    pub(super) name: &'static str,
    /// Text form, for messages.
    pub(super) form: &'static str,
    /// Parser of the address; takes its options from the text.
    pub(super) parse: fn(&str, &mut LinkText<'_>) -> Result<T, String>,
}

/// Parses `text` as a link of one of `kinds`; `object` is what it describes.
pub(super) fn parse<T>(
    object: &'static str,
    text: &str,
    kinds: &[LinkKind<T>],
) -> Result<T, InvalidLink> {
    let refused = |problem: String, form: String| {
        let text = text.to_owned();
        InvalidLink { object, text, problem, form }
    };
    let all = || kinds.iter().map(|kind| kind.form).collect::<Vec<_>>().join(" or ");
    let mut link = LinkText::split(text);
    let Some(address) = link.address else {
        return Err(refused("no kind before a colon".to_owned(), all()));
    };
    let Some(kind) = kinds.iter().find(|kind| kind.name == link.kind) else {
        return Err(refused(format!("unknown kind `{}`", link.kind), all()));
    };
    let parsed = (kind.parse)(address, &mut link).and_then(|parsed| {
        link.finish()?;
        Ok(parsed)
    });
    parsed.map_err(|problem| refused(problem, kind.form.to_owned()))
}

/// Text of an option; empty for one that is not given.
pub(super) fn option(key: &str, value: Option<impl Display>) -> String {
    value.map_or_else(String::new, |value| format!(",{key}={value}"))
}

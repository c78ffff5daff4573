//! The functions of the workspace with their lengths and numbers of arguments.
//!
//! Functions are found in the token stream, so that those inside macros (`proptest!`) are counted like any other.

use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};

use crate::sources::{Source, sources};

/// A function, with or without a body.
pub struct Function {
    pub path: String,
    pub name: String,
    pub line: usize,
    /// Lines strictly between the braces; 0 for a declaration.
    pub body_lines: usize,
    /// `self` is not counted.
    pub arguments: usize,
}

/// Every function of the workspace.
pub fn all() -> Vec<Function> {
    sources().iter().flat_map(|Source { path, text }| of(path, text)).collect()
}

/// The functions of a file with this text.
pub fn of(path: &str, text: &str) -> Vec<Function> {
    let mut found = Vec::new();
    let tokens: TokenStream = text.parse().unwrap_or_else(|error| panic!("{path}: {error}"));
    collect(path, tokens, &mut found);
    found
}

fn collect(path: &str, tokens: TokenStream, found: &mut Vec<Function>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    for (at, token) in tokens.iter().enumerate() {
        if let TokenTree::Group(group) = token {
            collect(path, group.stream(), found);
        }
        if token.to_string() == "fn" {
            found.extend(function(path, &tokens[at + 1..]));
        }
    }
}

/// The function whose name comes first in `tokens`; `None` for the type `fn(...)`.
fn function(path: &str, tokens: &[TokenTree]) -> Option<Function> {
    let Some(TokenTree::Ident(name)) = tokens.first() else { return None };
    let arguments = tokens.iter().find_map(|token| group(token, Delimiter::Parenthesis))?;
    let head = tokens.iter().take_while(|token| token.to_string() != ";");
    let body = head.into_iter().find_map(|token| group(token, Delimiter::Brace));
    Some(Function {
        path: path.to_owned(),
        name: name.to_string(),
        line: name.span().start().line,
        body_lines: body.map_or(0, lines_between),
        arguments: count_arguments(arguments.stream()),
    })
}

fn group(token: &TokenTree, delimiter: Delimiter) -> Option<&Group> {
    match token {
        TokenTree::Group(group) if group.delimiter() == delimiter => Some(group),
        _ => None,
    }
}

fn lines_between(body: &Group) -> usize {
    let (open, close) = (body.span_open().start().line, body.span_close().end().line);
    (close - open).saturating_sub(1)
}

/// The number of parts between the commas that are outside `<...>`, without `self`.
fn count_arguments(tokens: TokenStream) -> usize {
    let mut parts = vec![Vec::new()];
    let (mut depth, mut before) = (0, '_');
    for token in tokens {
        let mark = if let TokenTree::Punct(punct) = &token { punct.as_char() } else { '_' };
        match mark {
            '<' => depth += 1,
            '>' if before != '-' => depth -= 1,
            ',' if depth == 0 => parts.push(Vec::new()),
            _ => {}
        }
        before = mark;
        if mark != ',' || depth != 0 {
            parts.last_mut().unwrap().push(token.to_string());
        }
    }
    let is_self = |part: &Vec<String>| {
        let before_colon = part.iter().take_while(|token| *token != ":");
        before_colon.into_iter().any(|token| token == "self")
    };
    parts.iter().filter(|part| !part.is_empty() && !is_self(part)).count()
}

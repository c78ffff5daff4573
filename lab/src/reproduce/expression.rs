//! Expressions in the texts of the reproduction.
//!
//! A text has expressions in braces: `{oqtal.effort / pid.effort:2}` is the quotient of two cells with two significant digits.
//! Operands are numbers, cells of the rows that the table names, as `row.column`, and values that the experiment computes.
//!
//! | form | shows |
//! |---|---|
//! | `{name}` | the text of a value; a number with all its digits |
//! | `{expression}` | four significant digits, or a count |
//! | `{expression:2}` | two significant digits |
//! | `{expression:.0}` | no decimals |
//! | `{condition ? this : that}` | one of two texts |
//!
//! Operators: `and`, `< <= > >= ==`, `+ - * /`, parentheses. Functions:
//!
//! | function | value |
//! |---|---|
//! | `min(a, b, …)`, `max(a, b, …)` | the least, the greatest |
//! | `between(a, b, c)` | whether `a <= b <= c` |
//! | `less(a, b)` | how much less `a` is than `b` \[%\], rounded |
//! | `near(row)`, `marked(row)` | number of cells that reproduce a printed figure; number of cells that have one |
//! | `count(column, text)` | number of rows with that text |

use std::collections::BTreeMap;

use oqtal_observe::plot::unit::rounded;

use crate::sheet::{Sheet, SheetCell, SheetRow};

/// A value that an experiment computes for its texts.
#[derive(Clone, Debug)]
pub enum TextValue {
    /// A number \[unit of the sentence\].
    Number(f64),
    /// Words.
    Words(String),
}

impl From<f64> for TextValue {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

impl From<String> for TextValue {
    fn from(words: String) -> Self {
        Self::Words(words)
    }
}

/// Values by their names in the texts.
pub type TextValues = BTreeMap<&'static str, TextValue>;

/// Rows by the names used in expressions: origin, law, and words of the settings or cells.
pub type NamedRows = BTreeMap<String, Vec<String>>;

/// Number with four significant digits, as in the tables; a count is unchanged.
pub fn figure(value: f64) -> String {
    let is_count = value.fract() == 0.0 && value.abs() < 1e4;
    if is_count { format!("{value}") } else { rounded(value, 4) }
}

/// Names that an expression can use.
#[derive(Clone, Copy, Debug)]
pub struct TextScope<'a> {
    /// Table of the rows and columns.
    pub sheet: &'a Sheet,
    /// Rows of the table by their names.
    pub rows: &'a NamedRows,
    /// Values computed by the experiment.
    pub values: &'a TextValues,
}

impl TextScope<'_> {
    /// Replaces each expression in braces by its value.
    pub fn render(&self, text: &str) -> String {
        let mut parts = text.split('{');
        let mut rendered = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            let (expression, rest) = part.split_once('}').expect("a brace is closed");
            rendered += &self.shown(expression);
            rendered += rest;
        }
        rendered
    }

    /// Whether a condition holds.
    pub fn holds(&self, condition: &str) -> bool {
        self.number(condition) == 1.0
    }

    fn shown(&self, expression: &str) -> String {
        if let Some((condition, texts)) = expression.split_once(" ? ") {
            let (yes, no) = texts.split_once(" : ").expect("two texts");
            return if self.holds(condition) { yes } else { no }.to_owned();
        }
        match self.values.get(expression) {
            Some(TextValue::Words(words)) => return words.clone(),
            Some(TextValue::Number(number)) => return number.to_string(),
            None => {}
        }
        match expression.rsplit_once(':') {
            None => figure(self.number(expression)),
            Some((expression, digits)) => {
                let value = self.number(expression);
                match digits.strip_prefix('.') {
                    Some(decimals) => format!("{value:.*}", decimals.parse().unwrap_or(0)),
                    None => rounded(value, digits.parse().expect("a number of digits")),
                }
            }
        }
    }

    fn number(&self, expression: &str) -> f64 {
        let mut parser = Parser { scope: self, rest: expression };
        let value = parser.condition();
        assert!(parser.rest.trim().is_empty(), "`{}` left of `{expression}`", parser.rest);
        value
    }

    /// First row with the origin, the law and the words of `name`; `None` if there is none.
    fn row(&self, name: &str) -> Option<&SheetRow> {
        let Some([origin, law, words @ ..]) = self.rows.get(name).map(Vec::as_slice) else {
            panic!("no row `{name}` of table {}", self.sheet.name)
        };
        let is_cell = |row: &SheetRow, word: &String| {
            row.cells.iter().any(|cell| matches!(cell, SheetCell::Text(text) if text == word))
        };
        let has = |row: &SheetRow, word| row.settings.contains(word) || is_cell(row, word);
        self.sheet.rows.iter().find(|row| {
            row.variant.key() == origin
                && row.controller == *law
                && words.iter().all(|word| has(row, word))
        })
    }

    fn value(&self, name: &str) -> f64 {
        if let Some((row, column)) = name.split_once('.') {
            assert!(
                self.sheet.columns.iter().any(|(key, _)| *key == column),
                "no column `{column}`"
            );
            return self.row(row).map_or(f64::NAN, |row| row.number(&self.sheet.columns, column));
        }
        match self.values.get(name) {
            Some(TextValue::Number(number)) => *number,
            _ => panic!("no value `{name}`"),
        }
    }

    /// Value of a function whose arguments are names.
    fn count(&self, function: &str, arguments: &str) -> f64 {
        if let Some((column, text)) = arguments.split_once(", ") {
            let index = self.sheet.columns.iter().position(|(key, _)| *key == column);
            let index = index.unwrap_or_else(|| panic!("no column `{column}`"));
            return self.sheet.rows.iter().filter(|row| row.cells[index].show() == text).count()
                as f64;
        }
        let columns = self.sheet.columns.len();
        let marks = |row| (0..columns).filter_map(move |column| self.sheet.mark(row, column));
        let marks: Vec<bool> = self.row(arguments).into_iter().flat_map(marks).collect();
        match function {
            "near" => marks.into_iter().filter(|is_near| *is_near).count() as f64,
            _ => marks.len() as f64,
        }
    }
}

/// Value of a function of numbers.
fn call(function: &str, arguments: &[f64]) -> f64 {
    match (function, arguments) {
        ("min", _) => arguments.iter().copied().fold(f64::NAN, f64::min),
        ("max", _) => arguments.iter().copied().fold(f64::NAN, f64::max),
        ("less", [a, b]) => (100.0 * (1.0 - a / b)).round(),
        ("between", [a, b, c]) => f64::from(u8::from(a <= b && b <= c)),
        _ => panic!("no function `{function}` of {} numbers", arguments.len()),
    }
}

type Comparison = fn(&f64, &f64) -> bool;

/// Recursive-descent parser that evaluates while parsing; a truth value is 1 or 0.
struct Parser<'a> {
    scope: &'a TextScope<'a>,
    rest: &'a str,
}

impl Parser<'_> {
    fn take(&mut self, token: &str) -> bool {
        let rest = self.rest.trim_start().strip_prefix(token);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn condition(&mut self) -> f64 {
        let mut all = self.comparison();
        while self.take("and ") {
            all *= self.comparison();
        }
        all
    }

    fn comparison(&mut self) -> f64 {
        let left = self.sum();
        let operators: [(&str, Comparison); 5] =
            [("<=", f64::le), (">=", f64::ge), ("==", f64::eq), ("<", f64::lt), (">", f64::gt)];
        for (token, holds) in operators {
            if self.take(token) {
                return f64::from(u8::from(holds(&left, &self.sum())));
            }
        }
        left
    }

    fn sum(&mut self) -> f64 {
        let mut sum = self.product();
        loop {
            if self.take("+ ") {
                sum += self.product();
            } else if self.take("- ") {
                sum -= self.product();
            } else {
                return sum;
            }
        }
    }

    fn product(&mut self) -> f64 {
        let mut product = self.atom();
        loop {
            if self.take("* ") {
                product *= self.atom();
            } else if self.take("/ ") {
                product /= self.atom();
            } else {
                return product;
            }
        }
    }

    fn atom(&mut self) -> f64 {
        if self.take("(") {
            let value = self.condition();
            assert!(self.take(")"), "a parenthesis is closed");
            return value;
        }
        let text = self.rest.trim_start();
        let is_part = |letter: char| letter.is_alphanumeric() || "._".contains(letter);
        let (word, rest) = text.split_at(text.find(|c| !is_part(c)).unwrap_or(text.len()));
        self.rest = rest;
        if !self.take("(") {
            return word.parse().unwrap_or_else(|_| self.scope.value(word));
        }
        if ["near", "marked", "count"].contains(&word) {
            let (names, rest) = self.rest.split_once(')').expect("a call is closed");
            self.rest = rest;
            return self.scope.count(word, names);
        }
        let mut arguments = vec![self.condition()];
        while self.take(",") {
            arguments.push(self.condition());
        }
        assert!(self.take(")"), "a call is closed");
        call(word, &arguments)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sheet::Variant;

    fn scope_of(test: impl Fn(TextScope<'_>)) {
        let cells = vec![3.0.into(), SheetCell::Count(12)];
        let row =
            SheetRow::new(Variant::AsPrinted, "oqtal", "q 256, 60 Hz hold, centred cells", cells);
        let columns = vec![("effort_norm", ""), ("riccati_solves", "")];
        let sheet = Sheet { columns, rows: vec![row], ..Sheet::default() };
        let named = |law: &str| (law.to_owned(), vec!["as-printed".to_owned(), law.to_owned()]);
        let rows = ["oqtal", "pid"].map(named).into();
        let values = TextValues::from([("words", "a word".to_owned().into()), ("b", 2.0.into())]);
        test(TextScope { sheet: &sheet, rows: &rows, values: &values });
    }

    #[test]
    fn expressions_are_evaluated_by_precedence_and_shown_by_their_form() {
        scope_of(|scope| {
            for (text, expected) in [
                ("{1 + 2 * b - 8 / (1 + 3)}.", "3."),
                ("{oqtal.effort_norm / 7}", "0.4286"),
                ("{oqtal.effort_norm / 7:2} {oqtal.riccati_solves}", "0.43 12"),
                ("{100 * b / 3:.0} %", "67 %"),
                ("{words}, {b < 3 and b > 1 ? yes : no}, {b == 3 ? yes : no}", "a word, yes, no"),
                ("{max(1, b, 0.5)} {min(1, b)} {between(1, less(1, b), 50)}", "2 1 1"),
                ("{pid.effort_norm}", "–"),
            ] {
                assert_eq!(scope.render(text), expected, "{text}");
            }
            assert!(!scope.holds("pid.effort_norm < 1"), "a missing row fulfils no condition");
        });
    }
}

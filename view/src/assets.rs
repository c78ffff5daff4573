//! Files of the page, compiled into the program: nothing is loaded from a network or a disk.

use oqtal_observe::plot::palette;

use crate::response::Response;

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! files {
    ($($name:literal: $kind:expr),* $(,)?) => {
        [$((concat!("/", $name), $kind, include_str!(concat!("../assets/", $name)))),*]
    };
}

const FILES: &[(&str, &str, &str)] = &files! {
    "index.html": HTML,
    "style.css": CSS,
    "main.js": SCRIPT,
    "feed.js": SCRIPT,
    "store.js": SCRIPT,
    "palette.js": SCRIPT,
    "projection.js": SCRIPT,
    "room.js": SCRIPT,
    "charts.js": SCRIPT,
    "panel.js": SCRIPT,
    "player.js": SCRIPT,
    "control.js": SCRIPT,
    "tuning.js": SCRIPT,
};

/// The file at `path`.
pub fn find(path: &str) -> Option<Response> {
    let path = if path == "/" { "/index.html" } else { path };
    if path == "/palette.css" {
        return Some(Response::ok(CSS, palette::css()));
    }
    let (_, kind, text) = FILES.iter().find(|(name, ..)| *name == path)?;
    Some(Response::ok(kind, *text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_refer_to_each_other_and_to_nothing_else() {
        for (name, _, text) in FILES {
            for quote in ["src=\"", "href=\"", "from \""] {
                for rest in text.split(quote).skip(1) {
                    let target = rest.split('"').next().unwrap_or_default();
                    if target == "data:," {
                        continue;
                    }
                    let path = format!("/{}", target.trim_start_matches("./"));
                    assert!(find(&path).is_some(), "{name} refers to {target}");
                }
            }
            for elsewhere in ["http:", "https:", "url(", "@import", "import(", "innerHTML", "eval("]
            {
                assert!(!text.contains(elsewhere), "{name} has {elsewhere}");
            }
        }
    }

    #[test]
    fn files_are_short() {
        for (name, _, text) in FILES {
            assert!(text.lines().count() <= 400, "{name}");
        }
    }
}

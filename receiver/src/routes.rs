//! Which body of the camera system goes where.

/// A body of a camera system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraBody {
    /// Number by which frames name it \[-\].
    pub key: i64,
    /// Name.
    pub name: String,
}

/// The routes of wanted bodies, by the numbers that frames name bodies by.
#[derive(Clone, Debug, Default)]
pub struct RouteTable {
    /// Wanted names, a route each; those of all bodies if none was wanted.
    wanted: Vec<String>,
    takes_all: bool,
    /// Bodies of the camera system, each with its route.
    bodies: Vec<(CameraBody, Option<usize>)>,
    /// Routes of bodies that were named after the start.
    renamed: Vec<(i64, Option<usize>)>,
}

/// Most bodies that may be named after the start \[-\].
const MAX_RENAMED: usize = 256;

impl RouteTable {
    /// Routes of the bodies `wanted`, none of which is known yet. Without any, every body gets a route.
    #[must_use]
    pub fn new(wanted: Vec<String>) -> Self {
        Self {
            takes_all: wanted.is_empty(),
            wanted,
            bodies: Vec::new(),
            renamed: Vec::with_capacity(MAX_RENAMED),
        }
    }

    /// Replaces the bodies.
    pub fn replace(&mut self, bodies: impl IntoIterator<Item = CameraBody>) {
        self.bodies.clear();
        for body in bodies {
            self.insert(body);
        }
    }

    /// Names a body anew, without memory for its name: it counts for its route alone. For the real-time thread.
    pub fn rename(&mut self, key: i64, name: &str) {
        let route = self.wanted.iter().position(|wanted| is_named(wanted, key, name));
        let known = self.renamed.iter().position(|(known, _)| *known == key);
        match known {
            Some(place) => self.renamed[place].1 = route,
            None if self.renamed.len() < MAX_RENAMED => self.renamed.push((key, route)),
            None => {}
        }
    }

    /// Adds a body, or renames it.
    pub fn insert(&mut self, body: CameraBody) {
        self.bodies.retain(|(known, _)| known.key != body.key);
        let names = |wanted: &String| is_named(wanted, body.key, &body.name);
        let mut route = self.wanted.iter().position(names);
        if route.is_none() && self.takes_all {
            self.wanted.push(body.name.clone());
            route = Some(self.wanted.len() - 1);
        }
        self.bodies.push((body, route));
    }

    /// The route of a body; `None` if it is not wanted.
    #[must_use]
    pub fn route(&self, key: i64) -> Option<usize> {
        if let Some((_, route)) = self.renamed.iter().find(|(renamed, _)| *renamed == key) {
            return *route;
        }
        self.bodies.iter().find(|(body, _)| body.key == key).and_then(|(_, route)| *route)
    }

    /// The bodies of the camera system.
    pub fn bodies(&self) -> impl Iterator<Item = &CameraBody> {
        self.bodies.iter().map(|(body, _)| body)
    }

    /// Wanted names, in the order of their routes.
    #[must_use]
    pub fn wanted(&self) -> &[String] {
        &self.wanted
    }

    /// Whether the body of a route is there.
    #[must_use]
    pub fn has(&self, route: usize) -> bool {
        let renamed = self.renamed.iter().map(|(key, _)| *key);
        self.bodies
            .iter()
            .map(|(body, _)| body.key)
            .chain(renamed)
            .any(|key| self.route(key) == Some(route))
    }
}

/// Whether a link wants this body: by its name, or by its number.
fn is_named(wanted: &str, key: i64, name: &str) -> bool {
    wanted == name || wanted.parse::<i64>().is_ok_and(|number| number == key)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(key: i64, name: &str) -> CameraBody {
        CameraBody { key, name: name.to_owned() }
    }

    #[test]
    fn bodies_are_found_by_name_or_number_and_a_renamed_one_is_no_longer_there() {
        let mut table = RouteTable::new(vec!["b".to_owned(), "7".to_owned()]);
        table.replace([body(3, "a"), body(7, "c"), body(9, "b")]);
        assert_eq!([3, 7, 9, 1].map(|key| table.route(key)), [None, Some(1), Some(0), None]);
        table.insert(body(9, "other"));
        assert!(!table.has(0) && table.has(1) && table.route(9).is_none());
        table.rename(4, "b");
        assert!(table.has(0) && table.route(4) == Some(0));
        (100..10_000).for_each(|key| table.rename(key, "x"));
        table.rename(4, "y");
        assert!(!table.has(0) && table.route(4).is_none());
    }

    #[test]
    fn without_a_name_every_body_has_a_route() {
        let mut table = RouteTable::new(Vec::new());
        table.insert(body(0, "a"));
        table.insert(body(5, "b"));
        assert_eq!((table.route(5), table.wanted().len()), (Some(1), 2));
    }
}

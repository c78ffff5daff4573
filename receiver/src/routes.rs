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
}

impl RouteTable {
    /// Routes of the bodies `wanted`, none of which is known yet. Without any, every body gets a route.
    #[must_use]
    pub fn new(wanted: Vec<String>) -> Self {
        Self { takes_all: wanted.is_empty(), wanted, bodies: Vec::new() }
    }

    /// Replaces the bodies; whether anything changed.
    pub fn replace(&mut self, bodies: impl Iterator<Item = CameraBody>) -> bool {
        let before: Vec<CameraBody> = self.bodies.drain(..).map(|(body, _)| body).collect();
        for body in bodies {
            self.insert(body);
        }
        !before.iter().eq(self.bodies())
    }

    /// Adds a body, or renames it.
    pub fn insert(&mut self, body: CameraBody) {
        self.bodies.retain(|(known, _)| known.key != body.key);
        let names = |wanted: &String| {
            *wanted == body.name || wanted.parse::<i64>().is_ok_and(|key| key == body.key)
        };
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
        self.bodies.iter().any(|(_, known)| *known == Some(route))
    }
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
        assert!(table.replace([body(3, "a"), body(7, "c"), body(9, "b")].into_iter()));
        assert_eq!([3, 7, 9, 1].map(|key| table.route(key)), [None, Some(1), Some(0), None]);
        assert!(!table.replace([body(3, "a"), body(7, "c"), body(9, "b")].into_iter()));
        table.insert(body(9, "other"));
        assert!(!table.has(0) && table.has(1) && table.route(9).is_none());
    }

    #[test]
    fn without_a_name_every_body_has_a_route() {
        let mut table = RouteTable::new(Vec::new());
        table.insert(body(0, "a"));
        table.insert(body(5, "b"));
        assert_eq!((table.route(5), table.wanted().len()), (Some(1), 2));
    }
}

//! Which body of the camera system goes where.

/// A body of a camera system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraBody {
    /// Number by which frames name it \[-\].
    pub key: i64,
    /// Name.
    pub name: String,
}

/// Most bodies of a camera system that are kept \[-\]; a list without an end is none of bodies.
const MAX_KNOWN: usize = 2048;

/// The routes of wanted bodies, by the numbers that frames name bodies by.
#[derive(Clone, Debug, Default)]
pub struct RouteTable {
    /// Wanted names, a route each; those of all bodies if none was wanted.
    wanted: Vec<String>,
    takes_all: bool,
    /// Bodies of the camera system.
    bodies: Vec<CameraBody>,
    /// Numbers of the bodies that are wanted, with their routes: one body a route.
    routes: Vec<(i64, usize)>,
}

impl RouteTable {
    /// Routes of the bodies `wanted`, none of which is known yet. Without any, every body gets a route.
    #[must_use]
    pub fn new(wanted: Vec<String>) -> Self {
        let routes = Vec::with_capacity(wanted.len());
        Self { takes_all: wanted.is_empty(), wanted, bodies: Vec::new(), routes }
    }

    /// Replaces the bodies.
    pub fn replace(&mut self, bodies: impl IntoIterator<Item = CameraBody>) {
        self.bodies.clear();
        self.routes.clear();
        for body in bodies.into_iter().take(MAX_KNOWN) {
            self.insert(body);
        }
    }

    /// Adds a body, or renames it.
    pub fn insert(&mut self, body: CameraBody) {
        let known = self.bodies.iter().position(|known| known.key == body.key);
        if known.is_none() && self.bodies.len() >= MAX_KNOWN {
            return;
        }
        if self.takes_all && !self.wanted.contains(&body.name) {
            self.wanted.push(body.name.clone());
        }
        self.rename(body.key, &body.name);
        match known {
            Some(place) => self.bodies[place] = body,
            None => self.bodies.push(body),
        }
    }

    /// Names a body, or names it anew, for its route alone: nothing is allocated.
    pub fn rename(&mut self, key: i64, name: &str) {
        let route = self.wanted.iter().position(|wanted| is_named(wanted, key, name));
        // Of two bodies of one name the last is the one: a server that numbers its bodies anew names them again.
        self.routes.retain(|(known, taken)| *known != key && Some(*taken) != route);
        // There are at most as many as are wanted.
        self.routes.extend(route.map(|route| (key, route)));
    }

    /// The route of a body; `None` if it is not wanted.
    #[must_use]
    pub fn route(&self, key: i64) -> Option<usize> {
        self.routes.iter().find(|(known, _)| *known == key).map(|(_, route)| *route)
    }

    /// The bodies of the camera system, without those that were only renamed.
    pub fn bodies(&self) -> impl Iterator<Item = &CameraBody> {
        self.bodies.iter()
    }

    /// Wanted names, in the order of their routes.
    #[must_use]
    pub fn wanted(&self) -> &[String] {
        &self.wanted
    }

    /// Whether the body of a route is there.
    #[must_use]
    pub fn has(&self, route: usize) -> bool {
        self.routes.iter().any(|(_, known)| *known == route)
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
        assert_eq!(table.bodies().count(), 3);
    }

    #[test]
    fn one_body_has_a_route_however_often_it_is_named() {
        let mut table = RouteTable::new(vec!["b".to_owned()]);
        table.replace([body(3, "a"), body(9, "b")]);
        (100..10_000).for_each(|key| table.rename(key, "b"));
        assert_eq!((table.route(9), table.route(100), table.route(9999)), (None, None, Some(0)));
        table.rename(9999, "x");
        assert!(!table.has(0));
    }

    #[test]
    fn without_a_name_every_body_has_a_route() {
        let mut table = RouteTable::new(Vec::new());
        table.insert(body(0, "a"));
        table.insert(body(5, "b"));
        assert_eq!((table.route(5), table.wanted().len()), (Some(1), 2));
    }

    #[test]
    fn a_list_without_an_end_is_cut_off() {
        let mut table = RouteTable::new(vec!["b5".to_owned()]);
        table.replace((0..).map(|key| body(key, &format!("b{key}"))));
        assert_eq!((table.bodies().count(), table.route(5)), (MAX_KNOWN, Some(0)));
    }
}

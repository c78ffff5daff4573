//! Routes from the bodies of the camera system to instances.

use oqtal_wire::text::printable;

/// A body of a camera system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraBody {
    /// Number by which frames name it \[-\].
    pub key: i64,
    /// Name.
    pub name: String,
}

/// Most bodies of a camera system that are kept \[-\]; a longer list is cut off.
const MAX_KNOWN: usize = 2048;

/// A body that has the name of a route, which another body has already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefusedBody {
    /// Number by which frames name it \[-\].
    pub key: i64,
    /// The route.
    pub route: usize,
}

/// The routes of wanted bodies, by the numbers that identify bodies in frames.
#[derive(Clone, Debug, Default)]
pub struct RouteTable {
    /// Wanted names, a route each; those of all bodies if none was wanted.
    wanted: Vec<String>,
    takes_all: bool,
    /// Whether a wanted name may be the number of a body.
    takes_numbers: bool,
    /// Bodies of the camera system.
    bodies: Vec<CameraBody>,
    /// Numbers of the bodies that are wanted, with their routes: one body a route, one route a body.
    routes: Vec<(i64, usize)>,
    refused: Option<RefusedBody>,
    /// The body with the name of a route; it gets the route when the present body of the route is renamed.
    waiting: Option<RefusedBody>,
    /// The refused body that was last reported.
    last_reported: Option<RefusedBody>,
}

impl RouteTable {
    /// Routes of the bodies `wanted`, none of which is known yet. Without any, every body gets a route.
    pub fn new(wanted: Vec<String>) -> Self {
        let routes = Vec::with_capacity(wanted.len());
        Self { takes_all: wanted.is_empty(), wanted, routes, ..Self::default() }
    }

    /// The same routes, which also take the body whose number is wanted, if none has that name.
    pub fn with_numbers(self) -> Self {
        Self { takes_numbers: true, ..self }
    }

    /// Replaces the bodies.
    pub fn replace(&mut self, bodies: impl IntoIterator<Item = CameraBody>) {
        self.bodies.clear();
        self.routes.clear();
        (self.refused, self.waiting) = (None, None);
        for body in bodies.into_iter().take(MAX_KNOWN) {
            self.insert(body);
        }
        for route in (0..self.wanted.len()).filter(|_| self.takes_numbers) {
            let key = self.wanted[route].parse::<i64>().ok().filter(|_| !self.has(route));
            if let Some(body) = key.and_then(|key| self.bodies.iter().find(|b| b.key == key))
                && self.route(body.key).is_none()
            {
                self.routes.push((body.key, route));
            }
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

    /// Names or renames a body, for its route only; does not allocate. If two bodies have the same name, the first has the route until it
    /// is renamed.
    pub fn rename(&mut self, key: i64, name: &str) {
        let route = self.wanted.iter().position(|wanted| wanted == name);
        self.waiting = self.waiting.filter(|waiting| waiting.key != key);
        self.routes.retain(|(known, taken)| *known != key || Some(*taken) == route);
        if let Some(RefusedBody { key, route }) = self.waiting.filter(|one| !self.has(one.route)) {
            self.routes.push((key, route));
            self.waiting = None;
        }
        let Some(route) = route else { return };
        match self.routes.iter().find(|(_, taken)| *taken == route) {
            Some((known, _)) if *known == key => {}
            Some(_) => {
                self.waiting = Some(RefusedBody { key, route });
                self.refused = self.waiting;
            }
            // There are at most as many as are wanted.
            None => self.routes.push((key, route)),
        }
    }

    /// The body that was refused last, unless it was already reported.
    pub fn take_refused(&mut self) -> Option<RefusedBody> {
        let refused = self.refused.take().filter(|refused| self.last_reported != Some(*refused))?;
        self.last_reported = Some(refused);
        self.last_reported
    }

    /// The route of a body; `None` if it is not wanted.
    pub fn route(&self, key: i64) -> Option<usize> {
        self.routes.iter().find(|(known, _)| *known == key).map(|(_, route)| *route)
    }

    /// The bodies of the camera system, without those that were only renamed.
    pub fn bodies(&self) -> impl Iterator<Item = &CameraBody> {
        self.bodies.iter()
    }

    /// The bodies of the camera system with names that can be printed.
    pub fn listed(&self) -> Vec<CameraBody> {
        let listed = |body: &CameraBody| CameraBody { name: printable(&body.name), ..*body };
        self.bodies.iter().map(listed).collect()
    }

    /// Wanted names, in the order of their routes.
    pub fn wanted(&self) -> &[String] {
        &self.wanted
    }

    /// Whether the body of a route is there.
    pub fn has(&self, route: usize) -> bool {
        self.routes.iter().any(|(_, known)| *known == route)
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
        let mut table = RouteTable::new(vec!["b".to_owned(), "7".to_owned()]).with_numbers();
        table.replace([body(3, "a"), body(7, "c"), body(9, "b")]);
        assert_eq!([3, 7, 9, 1].map(|key| table.route(key)), [None, Some(1), Some(0), None]);
        table.insert(body(9, "other"));
        assert!(!table.has(0) && table.has(1) && table.route(9).is_none());
        assert_eq!(table.bodies().count(), 3);
    }

    #[test]
    fn a_name_takes_precedence_over_a_number_and_only_some_protocols_have_numbers() {
        let wanted = || RouteTable::new(vec!["7".to_owned()]);
        let bodies = || [body(7, "c"), body(9, "7")];
        for mut table in [wanted(), wanted().with_numbers()] {
            table.replace(bodies());
            assert_eq!((table.route(7), table.route(9)), (None, Some(0)));
            assert_eq!(table.take_refused(), None);
        }
        let mut names = wanted();
        names.replace([body(7, "c")]);
        assert!(!names.has(0));
        // A body has one route, also if it is wanted by its name and by its number.
        let mut both = RouteTable::new(vec!["7".to_owned(), "c".to_owned()]).with_numbers();
        both.replace([body(7, "c")]);
        assert_eq!((both.has(0), both.route(7)), (false, Some(1)));
    }

    #[test]
    fn bodies_that_exchange_their_names_one_after_the_other_are_found_by_the_new_ones() {
        let mut table = RouteTable::new(vec!["b".to_owned()]);
        table.replace([body(1, "b"), body(2, "other")]);
        table.rename(2, "b");
        table.rename(1, "other");
        assert_eq!((table.route(1), table.route(2)), (None, Some(0)));
        table.rename(2, "other");
        table.rename(1, "b");
        assert_eq!((table.route(1), table.route(2)), (Some(0), None));
    }

    #[test]
    fn of_two_bodies_of_one_name_the_second_is_refused() {
        let mut table = RouteTable::new(vec!["b".to_owned()]);
        table.replace([body(3, "a"), body(9, "b"), body(12, "b")]);
        assert_eq!((table.route(9), table.route(12)), (Some(0), None));
        assert_eq!(table.take_refused(), Some(RefusedBody { key: 12, route: 0 }));
        assert_eq!(table.take_refused(), None);
        (100..10_000).for_each(|key| table.rename(key, "b"));
        assert_eq!((table.route(9), table.route(9999)), (Some(0), None));
        table.rename(9, "x");
        table.rename(9999, "b");
        assert_eq!((table.route(9), table.route(9999)), (None, Some(0)));
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

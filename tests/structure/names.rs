//! Names of structs, enums, traits and type aliases that are visible to other files.

use std::collections::BTreeMap;

use syn::visit::Visit;
use syn::{Attribute, Ident, ItemEnum, ItemMod, ItemStruct, ItemTrait, ItemType, Visibility};

use crate::common::sources::{Source, sources};

/// Names with more than one definition.
pub fn repeated() -> Vec<String> {
    let repeated = definitions().into_iter().filter(|(_, paths)| paths.len() > 1);
    repeated.map(|(name, paths)| format!("{name}: {}", paths.join(", "))).collect()
}

/// Places of definition by name.
fn definitions() -> BTreeMap<String, Vec<String>> {
    let mut found = Definitions::default();
    for Source { path, text } in sources().into_iter().filter(|file| in_a_library(&file.path)) {
        let file = syn::parse_file(&text).unwrap_or_else(|error| panic!("{path}: {error}"));
        found.path = path;
        found.visit_file(&file);
    }
    found.names
}

/// Whether a file is compiled into a library or a program, not into a test.
pub fn in_a_library(path: &str) -> bool {
    path.starts_with("src/") || path.contains("/src/")
}

/// Whether an item exists only in tests.
pub fn is_test(attributes: &[Attribute]) -> bool {
    let test = |attribute: &Attribute| {
        let is_cfg = attribute.path().is_ident("cfg");
        is_cfg && attribute.parse_args::<Ident>().is_ok_and(|argument| argument == "test")
    };
    attributes.iter().any(test)
}

#[derive(Default)]
struct Definitions {
    path: String,
    names: BTreeMap<String, Vec<String>>,
}

impl Definitions {
    fn add(&mut self, visibility: &Visibility, name: &Ident) {
        if !matches!(visibility, Visibility::Inherited) {
            self.names.entry(name.to_string()).or_default().push(self.path.clone());
        }
    }
}

impl<'ast> Visit<'ast> for Definitions {
    fn visit_item_mod(&mut self, item: &'ast ItemMod) {
        if !is_test(&item.attrs) {
            syn::visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_struct(&mut self, item: &'ast ItemStruct) {
        self.add(&item.vis, &item.ident);
    }

    fn visit_item_enum(&mut self, item: &'ast ItemEnum) {
        self.add(&item.vis, &item.ident);
    }

    fn visit_item_trait(&mut self, item: &'ast ItemTrait) {
        self.add(&item.vis, &item.ident);
    }

    fn visit_item_type(&mut self, item: &'ast ItemType) {
        self.add(&item.vis, &item.ident);
    }
}

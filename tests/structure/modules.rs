//! Modules of a crate, and the file that defines the item at a path.

use std::collections::{BTreeMap, BTreeSet};

use syn::{Expr, Item, ItemMod, ItemUse, Lit, Meta, UseTree};

use crate::common::sources::{read, root};

/// A module: a file, or a part of a file.
pub struct Module {
    /// Path segments below the crate's root; empty for the root.
    pub path: Vec<String>,
    pub file: String,
    pub items: Vec<Item>,
    /// Names of types, functions, constants and macros defined in the module itself.
    defined: BTreeSet<String>,
    /// Names imported by `use`, with their paths as written.
    pub imported: BTreeMap<String, Vec<String>>,
    /// Paths of `use path::*`.
    pub globs: Vec<Vec<String>>,
}

/// Modules of a crate by path.
pub struct Tree(BTreeMap<Vec<String>, Module>);

/// Whether a file is the root of a library, program, test, benchmark or example of the crate in `folder`. Where `tests/main.rs`
/// exists, the other files of `tests` are its modules unless the manifest names them.
pub fn is_root(folder: &str, path: &str) -> bool {
    let folder_path = root().join(folder);
    let inner = path.strip_prefix(folder).unwrap_or(path).trim_start_matches('/');
    match inner.split_once('/') {
        Some(("src", file)) => file == "lib.rs" || file == "main.rs",
        Some(("tests", _)) if folder_path.join("tests/main.rs").exists() => {
            let manifest = std::fs::read_to_string(folder_path.join("Cargo.toml")).unwrap();
            manifest.contains(&format!("path = \"{inner}\""))
        }
        Some((_, file)) => match file.split_once('/') {
            Some((_, file)) => file == "main.rs",
            None => true,
        },
        None => false,
    }
}

impl Tree {
    /// The modules of the crate whose root is `file`.
    pub fn read(file: &str) -> Self {
        let mut tree = Self(BTreeMap::new());
        tree.add_file(Vec::new(), file, true);
        tree
    }

    pub fn modules(&self) -> impl Iterator<Item = &Module> {
        self.0.values()
    }

    /// The file that defines the item at `path`, as seen from the module `from`; `None` for a module and for other crates.
    pub fn defining_file(&self, from: &[String], path: &[String]) -> Option<&str> {
        self.resolve(from, path, 8)
    }

    fn resolve(&self, from: &[String], path: &[String], depth: u8) -> Option<&str> {
        let depth = depth.checked_sub(1)?;
        let mut at = from.to_vec();
        for (index, segment) in path.iter().enumerate() {
            match segment.as_str() {
                "crate" => at.clear(),
                "self" => {}
                "super" => drop(at.pop()?),
                _ => {
                    at.push(segment.clone());
                    if self.0.contains_key(&at) {
                        continue;
                    }
                    at.pop();
                    return self.item(&at, &path[index..], depth);
                }
            }
        }
        None
    }

    /// The file that defines the item at `rest`, whose first segment is not a child of the module `at`.
    fn item(&self, at: &[String], rest: &[String], depth: u8) -> Option<&str> {
        let module = &self.0[at];
        let name = &rest[0];
        if module.defined.contains(name) {
            return Some(&module.file);
        }
        if let Some(path) = module.imported.get(name).filter(|path| path[0] != *name) {
            let whole: Vec<String> = path.iter().chain(&rest[1..]).cloned().collect();
            return self.resolve(at, &whole, depth);
        }
        module.globs.iter().find_map(|glob| {
            let whole: Vec<String> = glob.iter().chain(rest).cloned().collect();
            self.resolve(at, &whole, depth)
        })
    }

    fn add_file(&mut self, path: Vec<String>, file: &str, owns_folder: bool) {
        let parsed = syn::parse_file(&read(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
        let (folder, name) = file.rsplit_once('/').expect("a file in a folder");
        let stem = name.trim_end_matches(".rs");
        let folder = if owns_folder { folder.to_owned() } else { format!("{folder}/{stem}") };
        self.add(path, (file, &folder), parsed.items);
    }

    /// Adds a module and its children, whose files are in `folder`.
    fn add(&mut self, path: Vec<String>, (file, folder): (&str, &str), items: Vec<Item>) {
        for item in &items {
            if let Item::Mod(child) = item {
                self.add_child(&path, (file, folder), child);
            }
        }
        let mut module = Module {
            path: path.clone(),
            file: file.to_owned(),
            defined: items.iter().filter_map(name_of).collect(),
            items,
            imported: BTreeMap::new(),
            globs: Vec::new(),
        };
        module.read_imports();
        self.0.insert(path, module);
    }

    fn add_child(&mut self, path: &[String], (file, folder): (&str, &str), child: &ItemMod) {
        let name = child.ident.to_string();
        let below: Vec<String> = path.iter().chain([&name]).cloned().collect();
        if let Some((_, items)) = &child.content {
            return self.add(below, (file, &format!("{folder}/{name}")), items.clone());
        }
        let folder_of_file = file.rsplit_once('/').map_or("", |(folder, _)| folder);
        let (by_path, by_name) = (path_attribute(child), format!("{folder}/{name}.rs"));
        if let Some(given) = by_path {
            self.add_file(below, &format!("{folder_of_file}/{given}"), true);
        } else if root().join(&by_name).is_file() {
            self.add_file(below, &by_name, false);
        } else {
            self.add_file(below, &format!("{folder}/{name}/mod.rs"), true);
        }
    }
}

impl Module {
    fn read_imports(&mut self) {
        let uses: Vec<ItemUse> = self.items.iter().filter_map(as_use).cloned().collect();
        for item in uses {
            for (path, alias) in leaves(&item.tree) {
                match alias {
                    Some(alias) => drop(self.imported.insert(alias, path)),
                    None => self.globs.push(path),
                }
            }
        }
    }
}

fn as_use(item: &Item) -> Option<&ItemUse> {
    if let Item::Use(item) = item { Some(item) } else { None }
}

/// Paths of a `use`, each with its local name; without a name for `*`.
pub fn leaves(tree: &UseTree) -> Vec<(Vec<String>, Option<String>)> {
    match tree {
        UseTree::Path(path) => {
            let mut below = leaves(&path.tree);
            for (segments, name) in &mut below {
                segments.insert(0, path.ident.to_string());
                // `use a::b::{self}` imports the name `b`.
                if segments.len() > 1 && segments.last().is_some_and(|last| last == "self") {
                    segments.pop();
                    *name = name.take().filter(|name| name != "self").or(segments.last().cloned());
                }
            }
            below
        }
        UseTree::Name(name) => vec![(vec![name.ident.to_string()], Some(name.ident.to_string()))],
        UseTree::Rename(name) => {
            vec![(vec![name.ident.to_string()], Some(name.rename.to_string()))]
        }
        UseTree::Glob(_) => vec![(Vec::new(), None)],
        UseTree::Group(group) => group.items.iter().flat_map(leaves).collect(),
    }
}

fn name_of(item: &Item) -> Option<String> {
    let ident = match item {
        Item::Const(item) => &item.ident,
        Item::Enum(item) => &item.ident,
        Item::Fn(item) => &item.sig.ident,
        Item::Macro(item) => item.ident.as_ref()?,
        Item::Static(item) => &item.ident,
        Item::Struct(item) => &item.ident,
        Item::Trait(item) => &item.ident,
        Item::Type(item) => &item.ident,
        Item::Union(item) => &item.ident,
        _ => return None,
    };
    Some(ident.to_string())
}

/// The file in `#[path = "..."]`.
fn path_attribute(child: &ItemMod) -> Option<String> {
    child.attrs.iter().find_map(|attribute| {
        let Meta::NameValue(pair) = &attribute.meta else { return None };
        let Expr::Lit(literal) = &pair.value else { return None };
        match &literal.lit {
            Lit::Str(text) if pair.path.is_ident("path") => Some(text.value()),
            _ => None,
        }
    })
}

//! Circles of files, in which each file uses items defined in the next one.

use std::collections::{BTreeMap, BTreeSet};

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::Visit;
use syn::{ItemMod, ItemUse};

use super::modules::{Module, Tree, leaves};

/// Files used by a file, each with one of the paths that use it.
type Edges = BTreeMap<String, BTreeMap<String, String>>;

/// Circles of the crate with the root file `root`: one line each, with its edges.
pub fn find(root: &str) -> Vec<String> {
    let tree = Tree::read(root);
    let mut edges = Edges::new();
    for module in tree.modules() {
        let mut uses =
            Uses { tree: &tree, module, edges: edges.entry(module.file.clone()).or_default() };
        module.items.iter().for_each(|item| uses.visit_item(item));
    }
    let reach: BTreeMap<&String, BTreeSet<&String>> =
        edges.keys().map(|file| (file, reachable(&edges, file))).collect();
    let mut seen = BTreeSet::new();
    let mut circles = Vec::new();
    for (file, targets) in &reach {
        if targets.contains(*file) && !seen.contains(*file) {
            let circle: BTreeSet<&String> =
                targets.iter().copied().filter(|target| reach[*target].contains(*file)).collect();
            seen.extend(circle.iter().copied());
            circles.push(describe(&edges, &circle));
        }
    }
    circles
}

fn reachable<'a>(edges: &'a Edges, from: &str) -> BTreeSet<&'a String> {
    let mut found = BTreeSet::new();
    let mut todo: Vec<&String> = edges[from].keys().collect();
    while let Some(file) = todo.pop() {
        if found.insert(file) {
            todo.extend(edges[file].keys());
        }
    }
    found
}

fn describe(edges: &Edges, circle: &BTreeSet<&String>) -> String {
    let mut lines = vec![format!("{} files", circle.len())];
    for from in circle {
        for (to, path) in edges[*from].iter().filter(|(to, _)| circle.contains(to)) {
            lines.push(format!("    {from} → {to} by {path}"));
        }
    }
    lines.join("\n")
}

struct Uses<'a> {
    tree: &'a Tree,
    module: &'a Module,
    edges: &'a mut BTreeMap<String, String>,
}

impl Uses<'_> {
    fn add(&mut self, path: &[String]) {
        if let Some(file) = self.tree.defining_file(&self.module.path, path)
            && file != self.module.file
        {
            self.edges.entry(file.to_owned()).or_insert_with(|| path.join("::"));
        }
    }

    /// Adds the paths inside a macro's arguments.
    fn add_tokens(&mut self, tokens: TokenStream) {
        let mut path = Vec::new();
        let mut colons = 0;
        for token in tokens {
            match &token {
                TokenTree::Punct(punct) if punct.as_char() == ':' => colons += 1,
                TokenTree::Ident(ident) if colons == 2 => {
                    colons = 0;
                    path.push(ident.to_string());
                }
                _ => {
                    self.add_path(&path);
                    colons = 0;
                    path = if let TokenTree::Ident(ident) = &token {
                        vec![ident.to_string()]
                    } else {
                        Vec::new()
                    };
                }
            }
            if let TokenTree::Group(group) = token {
                self.add_tokens(group.stream());
            }
        }
        self.add_path(&path);
    }

    /// A single name is local, or resolved by its `use`.
    fn add_path(&mut self, path: &[String]) {
        if path.len() > 1 {
            self.add(path);
        }
    }
}

impl<'ast> Visit<'ast> for Uses<'_> {
    // Modules inside a file are separate modules of the tree.
    fn visit_item_mod(&mut self, _: &'ast ItemMod) {}

    fn visit_item_use(&mut self, item: &'ast ItemUse) {
        // An item that is only re-exported is used by the importers of the re-export.
        if matches!(item.vis, syn::Visibility::Inherited) {
            for (path, _) in leaves(&item.tree) {
                self.add(&path);
            }
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let segments: Vec<String> =
            path.segments.iter().map(|part| part.ident.to_string()).collect();
        self.add_path(&segments);
        syn::visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, item: &'ast syn::Macro) {
        self.add_tokens(item.tokens.clone());
    }
}

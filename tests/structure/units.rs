//! Units of public numbers: in brackets in the documentation, as in `\[m, world\]`, or at the end of the name, as in `mass_kg`.

use syn::visit::Visit;
use syn::{
    Attribute, Expr, Field, Ident, ItemConst, ItemEnum, ItemMod, ItemStruct, Lit, Meta, Type,
    Visibility,
};

use super::names::{in_a_library, is_test};
use crate::common::sources::{Source, sources};

/// Units at the end of a name. A name may also state that its number has no dimension.
const ENDINGS: &[&str] = &[
    "m",
    "mm",
    "um",
    "s",
    "ms",
    "us",
    "ns",
    "hz",
    "kg",
    "n",
    "nm",
    "rad",
    "deg",
    "v",
    "a",
    "ah",
    "ohm",
    "s2",
    "m2",
    "percent",
    "bytes",
    "kib",
    "probability",
    "fraction",
    "ratio",
];

/// Public floating-point fields and constants without a unit.
pub fn missing() -> Vec<String> {
    let mut found = Missing::default();
    for Source { path, text } in sources().into_iter().filter(|file| in_a_library(&file.path)) {
        let file = syn::parse_file(&text).unwrap_or_else(|error| panic!("{path}: {error}"));
        found.path = path;
        found.visit_file(&file);
    }
    found.violations
}

#[derive(Default)]
struct Missing {
    path: String,
    violations: Vec<String>,
}

impl Missing {
    /// Checks public fields of a struct or of an enum's variant.
    fn check<'a>(
        &mut self,
        owner: &Ident,
        attributes: &[Attribute],
        fields: impl Iterator<Item = &'a Field>,
    ) {
        for field in fields {
            let name = field.ident.as_ref().map_or_else(|| "0".to_owned(), ToString::to_string);
            // The number of a tuple may be documented at the tuple.
            let by_owner = field.ident.is_none() && has_unit_in_doc(attributes);
            let has_unit = has_unit_in_doc(&field.attrs) || ends_in_unit(&name) || by_owner;
            if is_float(&field.ty) && !has_unit {
                let line = owner.span().start().line;
                self.violations.push(format!("{}:{line}: {owner}.{name}", self.path));
            }
        }
    }
}

impl<'ast> Visit<'ast> for Missing {
    fn visit_item_mod(&mut self, item: &'ast ItemMod) {
        if !is_test(&item.attrs) {
            syn::visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_struct(&mut self, item: &'ast ItemStruct) {
        if is_public(&item.vis) {
            let public = item.fields.iter().filter(|field| is_public(&field.vis));
            self.check(&item.ident, &item.attrs, public);
        }
    }

    fn visit_item_enum(&mut self, item: &'ast ItemEnum) {
        if is_public(&item.vis) {
            for variant in &item.variants {
                self.check(&variant.ident, &variant.attrs, variant.fields.iter());
            }
        }
    }

    fn visit_item_const(&mut self, item: &'ast ItemConst) {
        let name = item.ident.to_string().to_lowercase();
        let has_unit = has_unit_in_doc(&item.attrs) || ends_in_unit(&name);
        if is_public(&item.vis) && is_float(&item.ty) && !has_unit {
            let line = item.ident.span().start().line;
            self.violations.push(format!("{}:{line}: {}", self.path, item.ident));
        }
    }
}

fn is_public(visibility: &Visibility) -> bool {
    !matches!(visibility, Visibility::Inherited)
}

/// Whether a type contains floating-point numbers: `f64`, an array, an option or a matrix of them.
fn is_float(ty: &Type) -> bool {
    struct Float(bool);
    impl<'ast> Visit<'ast> for Float {
        fn visit_ident(&mut self, ident: &'ast Ident) {
            self.0 |= ident == "f64" || ident == "f32";
        }
        // A function on numbers is not a number.
        fn visit_type_fn_ptr(&mut self, _: &'ast syn::TypeFnPtr) {}
        fn visit_parenthesized_generic_arguments(
            &mut self,
            _: &'ast syn::ParenthesizedGenericArguments,
        ) {
        }
    }
    let mut float = Float(false);
    float.visit_type(ty);
    float.0
}

fn ends_in_unit(name: &str) -> bool {
    name.rsplit_once('_').is_some_and(|(_, end)| ENDINGS.contains(&end))
}

/// Whether the documentation has escaped brackets, which rustdoc requires around text that is not a link.
fn has_unit_in_doc(attributes: &[Attribute]) -> bool {
    let text: String = attributes.iter().filter_map(doc_line).collect();
    text.split_once("\\[").is_some_and(|(_, rest)| rest.contains(']'))
}

fn doc_line(attribute: &Attribute) -> Option<String> {
    let Meta::NameValue(pair) = &attribute.meta else { return None };
    let Expr::Lit(literal) = &pair.value else { return None };
    match &literal.lit {
        Lit::Str(text) if pair.path.is_ident("doc") => Some(text.value()),
        _ => None,
    }
}

//! Macros that define structures and messages: fields, documentation, table and encoding from one source.

/// A structure, and the table of its fields. A field is `name: type ["unit"]`; the unit becomes part of its documentation.
/// A last field without unit holds another structure and is not in the table.
macro_rules! structure {
    ($(#[$meta:meta])* $name:ident {
        $($(#[doc = $doc:literal])* $field:ident: $type:ty [$unit:literal],)*
        $(; $(#[doc = $inner_doc:literal])* $inner:ident: $inner_type:ty,)?
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        #[repr(C)]
        pub struct $name {
            $($(#[doc = $doc])* #[doc = concat!("\\[", $unit, "\\]")] pub $field: $type,)*
            $($(#[doc = $inner_doc])* pub $inner: $inner_type,)?
        }

        impl $name {
            const TABLE: &'static [Field] = &[$(Field {
                name: stringify!($field),
                type_name: stringify!($type),
                element: <$type as Value>::ELEMENT,
                length: <$type as Value>::LENGTH,
                unit: $unit,
                doc: concat!($($doc),*).trim_ascii(),
            },)*];
        }
    };
}

/// A message body. Its schema includes the header before it.
macro_rules! message {
    ($(#[$meta:meta])* $name:ident = $wire:literal {
        $($(#[doc = $doc:literal])* $field:ident: $type:ty [$unit:literal],)*
    }) => {
        structure! { $(#[$meta])* $name { $($(#[doc = $doc])* $field: $type [$unit],)* } }

        impl Message for $name {
            const SCHEMA: u64 = schema(HEADER_SCHEMA, $wire, Self::TABLE);
            const FIELDS: &'static [Field] = Self::TABLE;
            const SIZE: usize = total_size(Self::TABLE);

            fn encode(&self, bytes: &mut [u8]) {
                let rest = bytes;
                $(let rest = self.$field.put(rest);)*
                let _ = rest;
            }

            fn decode(mut bytes: &[u8]) -> Self {
                Self { $($field: <$type as Value>::take(&mut bytes),)* }
            }
        }
    };
}

pub(super) use {message, structure};

//! Structures that cross a process boundary, with a description of their layout for programs in other languages.

/// Declares a structure in C's layout, and describes its fields.
macro_rules! wire_struct {
    (
        $(#[doc = $doc:literal])+
        #[derive($($derive:ident),+)]
        pub struct $name:ident { $($(#[doc = $field_doc:literal])+ pub $field:ident: $kind:ty,)+ }
    ) => {
        $(#[doc = $doc])+
        #[derive($($derive),+)]
        #[repr(C)]
        pub struct $name { $($(#[doc = $field_doc])+ pub $field: $kind,)+ }

        impl $crate::layout::Described for $name {
            const KIND: $crate::layout::Kind = $crate::layout::Kind::Struct(&$crate::layout::StructLayout {
                name: stringify!($name),
                doc: concat!($($doc),+),
                size: size_of::<$name>(),
                alignment: align_of::<$name>(),
                fields: &[$($crate::layout::Field {
                    name: stringify!($field),
                    doc: concat!($($field_doc),+),
                    offset: core::mem::offset_of!($name, $field),
                    kind: <$kind as $crate::layout::Described>::KIND,
                }),+],
            });
        }
    };
}
pub(crate) use wire_struct;

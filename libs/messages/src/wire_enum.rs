//! Enumerations that cross a process boundary as a `u32` code.

/// Declares an enumeration with a fixed code and a name for each variant.
///
/// On the wire the enumeration is a bare `u32`, so that a receiver can reject a damaged message: reading an invalid
/// discriminant straight into a Rust enum would be undefined behaviour.
macro_rules! wire_enum {
    ($(#[$meta:meta])* $name:ident { $($(#[$vmeta:meta])* $variant:ident = $code:literal, $text:literal;)+ }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u32)]
        pub enum $name { $($(#[$vmeta])* $variant = $code,)+ }

        impl $name {
            /// Every variant, in the order of its code.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// Its variants, as data.
            pub const LAYOUT: $crate::layout::EnumLayout = $crate::layout::EnumLayout {
                name: stringify!($name),
                variants: &[$((stringify!($variant), $text, $code)),+],
            };

            /// The code on the wire.
            #[must_use]
            pub const fn code(self) -> u32 { self as u32 }

            /// The variant of a code; `None` if there is none.
            #[must_use]
            pub const fn from_code(code: u32) -> Option<Self> {
                match code { $($code => Some(Self::$variant),)+ _ => None }
            }

            /// The name used in logs and on the terminal.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $text,)+ }
            }

            /// The variant of a name; `None` if there is none.
            #[must_use]
            pub fn from_name(name: &str) -> Option<Self> {
                match name { $($text => Some(Self::$variant),)+ _ => None }
            }
        }

        impl ::core::fmt::Display for $name {
            fn fmt(&self, f: &mut ::core::fmt::Formatter<'_>) -> ::core::fmt::Result { f.pad(self.name()) }
        }
    };
}
pub(crate) use wire_enum;

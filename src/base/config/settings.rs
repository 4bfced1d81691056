//! Defines a table's settings with one line for each key: name, kind, range, default and meaning. The checked
//! struct, its accessors and its reader are made from these lines, so that they cannot differ.

/// Declares a checked table. Fields are private: a value of the struct has passed every range.
///
/// ```text
/// settings! {
///     /// What the table is for.
///     pub struct Locate {
///         /// Largest shift of the panel's centre, mm.
///         max_shift_mm: f64, 0.0..=500.0, default 60.0;
///         /// No default: the file must name it.
///         rows: usize, 1..=50, required;
///     }
/// }
/// ```
#[macro_export]
macro_rules! settings {
    ($(#[$doc:meta])* pub struct $name:ident {
        $($(#[$key_doc:meta])* $key:ident: $kind:ty, $limits:expr, $word:ident $($default:expr)?;)*
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name { $($key: $kind,)* }

        impl $name {
            $($(#[$key_doc])* pub fn $key(&self) -> $kind { $crate::config::copy_value(&self.$key) })*

            /// Reads this table's keys; `None` if one of them has a problem, which is then noted.
            pub fn parse(section: &$crate::config::Section<'_, '_>) -> Option<Self> {
                $(let $key = section.parse::<$kind>(
                    stringify!($key), $limits, $crate::config::settings!(@$word $($default)?));)*
                section.finish();
                Some($name { $($key: $key?,)* })
            }
        }
    };
    (@required) => { None };
    (@default $value:expr) => { Some($value) };
}

/// Returns a copy, whether or not the type is `Copy`; used by the accessors that the macro makes.
pub fn copy_value<T: Clone>(value: &T) -> T {
    value.clone()
}

pub use crate::settings;

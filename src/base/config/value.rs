//! One value of a file: its type, its range, and the description of its valid values.
//!
//! [`set_value`] changes a value in a file's text and keeps the comments.

use std::ops::RangeInclusive;
use toml::de::DeValue;
use toml_edit::{Item, TableLike, Value};

/// A type of value that can be read from a file and checked against limits.
pub trait Setting: Sized {
    /// The limits for values of this kind.
    type Limits;

    /// Reads the value. The error contains the value that was found and the valid values.
    fn parse(value: &DeValue<'_>, limits: &Self::Limits) -> Result<Self, String>;
}

/// Describes a value of the file briefly, for a message.
pub(super) fn describe_value(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{text}\""),
        DeValue::Integer(number) => number.as_str().to_owned(),
        DeValue::Float(number) => number.as_str().to_owned(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(_) => "a date".to_owned(),
        DeValue::Array(list) => format!("a list of {}", list.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

/// Returns a value as a number; `None` if the value is not a number. NaN and infinite numbers are returned unchanged.
fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix()).ok().map(|n| n as f64),
        DeValue::Float(number) => number.as_str().parse().ok(),
        _ => None,
    }
}

impl Setting for f64 {
    type Limits = RangeInclusive<f64>;

    fn parse(value: &DeValue<'_>, limits: &Self::Limits) -> Result<Self, String> {
        // A NaN is outside of every range, because `contains` compares.
        number(value).filter(|number| limits.contains(number)).ok_or_else(|| {
            format!("found {}, valid: a number from {} to {}", describe_value(value), limits.start(), limits.end())
        })
    }
}

macro_rules! whole_numbers {
    ($($kind:ty),*) => {$(
        impl Setting for $kind {
            type Limits = RangeInclusive<$kind>;

            fn parse(value: &DeValue<'_>, limits: &Self::Limits) -> Result<Self, String> {
                let whole = match value {
                    DeValue::Integer(number) => <$kind>::from_str_radix(number.as_str(), number.radix()).ok(),
                    _ => None,
                };
                whole.filter(|number| limits.contains(number)).ok_or_else(|| {
                    let (low, high) = (limits.start(), limits.end());
                    format!("found {}, valid: a whole number from {low} to {high}", describe_value(value))
                })
            }
        }
    )*};
}

whole_numbers!(usize, u16);

impl Setting for bool {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        value.as_bool().ok_or_else(|| format!("found {}, valid: true or false", describe_value(value)))
    }
}

impl Setting for String {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        value
            .as_str()
            .filter(|text| !text.trim().is_empty())
            .map(str::to_owned)
            .ok_or_else(|| format!("found {}, valid: a text that is not empty", describe_value(value)))
    }
}

impl<T: Setting, const N: usize> Setting for [T; N] {
    type Limits = T::Limits;

    fn parse(value: &DeValue<'_>, limits: &Self::Limits) -> Result<Self, String> {
        let items = value.as_array().map(|list| list.len());
        let list = value.as_array().filter(|list| list.len() == N);
        let list = list.ok_or_else(|| {
            // If the list has twice the expected length, a decimal comma has probably split each number in two.
            let comma = if N > 1 && items == Some(2 * N) { "; a number has a decimal point, no comma" } else { "" };
            format!("found {}, valid: a list of {N} items{comma}", describe_value(value))
        })?;
        let item = |(index, item): (usize, &toml::Spanned<DeValue<'_>>)| {
            T::parse(item.get_ref(), limits).map_err(|message| format!("item {}: {message}", index + 1))
        };
        let items: Result<Vec<T>, String> = list.iter().enumerate().map(item).collect();
        items?.try_into().map_err(|_| format!("valid: a list of {N} items"))
    }
}

/// A list with any number of items.
impl<T: Setting> Setting for Vec<T> {
    type Limits = T::Limits;

    fn parse(value: &DeValue<'_>, limits: &Self::Limits) -> Result<Self, String> {
        let list = value.as_array().ok_or_else(|| format!("found {}, valid: a list", describe_value(value)))?;
        let item = |(index, item): (usize, &toml::Spanned<DeValue<'_>>)| {
            T::parse(item.get_ref(), limits).map_err(|message| format!("item {}: {message}", index + 1))
        };
        list.iter().enumerate().map(item).collect()
    }
}

/// An optional key; its value is `None` if the key is absent.
impl<T: Setting> Setting for Option<T> {
    type Limits = T::Limits;

    fn parse(value: &DeValue<'_>, limits: &Self::Limits) -> Result<Self, String> {
        T::parse(value, limits).map(Some)
    }
}

/// An enumeration whose values are written as keywords.
pub trait Choice: Sized + Copy + 'static {
    /// Each keyword with the value that it stands for.
    const KEYWORDS: &'static [(&'static str, Self)];
}

impl<C: Choice> Setting for C {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let words = C::KEYWORDS.iter().map(|(word, _)| *word).collect();
        let written = <&'static str>::parse(value, &words)?;
        let choice = C::KEYWORDS.iter().find(|(word, _)| *word == written).map(|(_, choice)| *choice);
        choice.ok_or_else(|| format!("found {written}"))
    }
}

/// A text that must be one of the keywords in `limits`.
impl Setting for &'static str {
    type Limits = Vec<&'static str>;

    fn parse(value: &DeValue<'_>, words: &Self::Limits) -> Result<Self, String> {
        let word = |text| words.iter().copied().find(|word| *word == text);
        value.as_str().and_then(word).ok_or_else(|| {
            let quoted: Vec<String> = words.iter().map(|word| format!("\"{word}\"")).collect();
            format!("found {}, valid: {}", describe_value(value), quoted.join(" or "))
        })
    }
}

/// Sets a value of a table. An existing value is replaced; its position in the file and its comment are kept.
pub fn set_value(table: &mut dyn TableLike, key: &str, value: impl Into<Value>) {
    let mut value = value.into();
    match table.get_mut(key) {
        Some(before) => {
            if let Some(before) = before.as_value() {
                *value.decor_mut() = before.decor().clone();
            }
            *before = Item::Value(value);
        }
        None => drop(table.insert(key, Item::Value(value))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use toml_edit::DocumentMut;

    #[test]
    fn a_value_is_set_and_its_comment_kept() {
        let mut document: DocumentMut = "# all\nrows = 4 # four\n".parse().expect("TOML");
        set_value(document.as_table_mut(), "rows", 5);
        set_value(document.as_table_mut(), "columns", 6);
        assert_eq!(document.to_string(), "# all\nrows = 5 # four\ncolumns = 6\n");
    }
}

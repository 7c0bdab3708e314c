//! Names and lists of a fixed size without heap, for log content of any length.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::ops::Deref;

/// Most bytes of a name.
const BYTES: usize = 31;

/// Name, cut to 31 bytes.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub struct Label {
    bytes: [u8; BYTES],
    length: u8,
}

impl Label {
    /// Copies the name, or as many whole characters of it as fit.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let length = name.floor_char_boundary(BYTES);
        let mut bytes = [0; BYTES];
        bytes[..length].copy_from_slice(&name.as_bytes()[..length]);
        Self { bytes, length: length as u8 }
    }

    /// Returns the name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..usize::from(self.length)]).unwrap_or_default()
    }
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl fmt::Debug for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl Serialize for Label {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

impl<'de> Deserialize<'de> for Label {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(|name| Self::new(&name))
    }
}

/// List of up to `N` items that reads as a slice.
#[derive(Clone, Copy, PartialEq)]
pub struct FixedList<T, const N: usize> {
    /// Items from `length` on are default, so that equal lists have equal arrays.
    items: [T; N],
    length: usize,
}

impl<T: Copy + Default, const N: usize> Default for FixedList<T, N> {
    fn default() -> Self {
        Self { items: [T::default(); N], length: 0 }
    }
}

impl<T, const N: usize> FixedList<T, N> {
    /// Adds an item if the list is not full.
    fn push(&mut self, item: T) {
        if let Some(next) = self.items.get_mut(self.length) {
            *next = item;
            self.length += 1;
        }
    }

    /// Returns the first item that `matches`, or else a new item at the end; `None` if the list is full.
    pub(super) fn entry(&mut self, matches: impl FnMut(&T) -> bool, new: impl FnOnce() -> T) -> Option<&mut T> {
        let index = self.iter().position(matches).unwrap_or_else(|| {
            let index = self.length;
            self.push(new());
            index
        });
        self.items.get_mut(index)
    }
}

impl<T, const N: usize> Deref for FixedList<T, N> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.items[..self.length]
    }
}

/// Collects the first `N` items.
impl<T: Copy + Default, const N: usize> FromIterator<T> for FixedList<T, N> {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Self {
        let mut list = Self::default();
        items.into_iter().take(N).for_each(|item| list.push(item));
        list
    }
}

impl<T: fmt::Debug, const N: usize> fmt::Debug for FixedList<T, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<T: Serialize, const N: usize> Serialize for FixedList<T, N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.iter())
    }
}

impl<'de, T: Deserialize<'de> + Copy + Default, const N: usize> Deserialize<'de> for FixedList<T, N> {
    /// Leaves out what does not fit.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut list = Self::default();
        Vec::deserialize(deserializer)?.into_iter().for_each(|item| list.push(item));
        Ok(list)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_long_name_is_cut_between_characters() {
        assert_eq!(Label::new("shank").as_str(), "shank");
        // 30 bytes, then a character of two bytes.
        let long = format!("{}é", "a".repeat(30));
        assert_eq!(Label::new(&long).as_str(), "a".repeat(30));
        assert_eq!(Label::new(&long), Label::new(&"a".repeat(30)));
    }

    #[test]
    fn list_full_finds_items_and_adds_none() {
        let mut list: FixedList<u32, 2> = [1, 2, 3].into_iter().collect();
        assert_eq!(*list, [1, 2]);
        assert_eq!(list.entry(|&item| item == 2, || 9), Some(&mut 2));
        assert_eq!(list.entry(|&item| item == 7, || 7), None);
        let mut list = FixedList::<u32, 2>::default();
        assert_eq!(list.entry(|&item| item == 7, || 7), Some(&mut 7));
        assert_eq!(list.len(), 1);
    }
}

//! Names and lists in place: what a log may hold of any length takes a fixed room here, and no heap.

use serde::{Serialize, Serializer};
use std::fmt;
use std::ops::Deref;

/// Most bytes of a name that are kept.
const BYTES: usize = 31;

/// A name, cut to 31 bytes.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub struct Label {
    bytes: [u8; BYTES],
    length: u8,
}

impl Label {
    /// The name, or as many whole characters of it as there is room for.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let length = name.floor_char_boundary(BYTES);
        let mut bytes = [0; BYTES];
        bytes[..length].copy_from_slice(&name.as_bytes()[..length]);
        Self { bytes, length: length as u8 }
    }

    /// As text.
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

/// Up to `N` items; a slice for whoever reads it.
#[derive(Clone, Copy, PartialEq)]
pub struct List<T, const N: usize> {
    /// Those from `length` on are default, so that equal lists are equal as a whole.
    items: [T; N],
    length: usize,
}

impl<T: Copy + Default, const N: usize> Default for List<T, N> {
    fn default() -> Self {
        Self { items: [T::default(); N], length: 0 }
    }
}

impl<T, const N: usize> List<T, N> {
    /// Adds an item, if there is room.
    fn push(&mut self, item: T) {
        if let Some(place) = self.items.get_mut(self.length) {
            *place = item;
            self.length += 1;
        }
    }

    /// The first item that `is` the one, or else a new one at the end; `None` if there is no room for it.
    pub(super) fn entry(&mut self, is: impl FnMut(&T) -> bool, new: impl FnOnce() -> T) -> Option<&mut T> {
        let place = self.iter().position(is).unwrap_or_else(|| {
            let place = self.length;
            self.push(new());
            place
        });
        self.items.get_mut(place)
    }
}

impl<T, const N: usize> Deref for List<T, N> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.items[..self.length]
    }
}

/// Keeps the first `N`.
impl<T: Copy + Default, const N: usize> FromIterator<T> for List<T, N> {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Self {
        let mut list = Self::default();
        items.into_iter().take(N).for_each(|item| list.push(item));
        list
    }
}

impl<T: fmt::Debug, const N: usize> fmt::Debug for List<T, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<T: Serialize, const N: usize> Serialize for List<T, N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.iter())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_cut_between_characters() {
        assert_eq!(Label::new("shank").as_str(), "shank");
        // 30 bytes, then one character of two.
        let long = format!("{}é", "a".repeat(30));
        assert_eq!(Label::new(&long).as_str(), "a".repeat(30));
        assert_eq!(Label::new(&long), Label::new(&"a".repeat(30)));
    }

    #[test]
    fn a_full_list_takes_no_more_and_finds_what_it_has() {
        let mut list: List<u32, 2> = [1, 2, 3].into_iter().collect();
        assert_eq!(*list, [1, 2]);
        assert_eq!(list.entry(|&item| item == 2, || 9), Some(&mut 2));
        assert_eq!(list.entry(|&item| item == 7, || 7), None);
        let mut list = List::<u32, 2>::default();
        assert_eq!(list.entry(|&item| item == 7, || 7), Some(&mut 7));
        assert_eq!(list.len(), 1);
    }
}

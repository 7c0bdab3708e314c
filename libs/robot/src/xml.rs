//! Elements of a URDF, with the line of each for messages.

use crate::error::RobotError;
use roxmltree::Node;

/// Largest size of a length or an inertia; beyond it products overflow, and no robot is that large.
const LARGEST: f64 = 1e9;

/// An element of a file.
#[derive(Clone, Copy)]
pub(crate) struct Element<'d> {
    node: Node<'d, 'd>,
    file: &'d str,
}

impl<'d> Element<'d> {
    pub(crate) fn new(node: Node<'d, 'd>, file: &'d str) -> Self {
        Self { node, file }
    }

    /// Name of the element.
    pub(crate) fn tag(&self) -> &'d str {
        self.node.tag_name().name()
    }

    /// File and line, for messages.
    pub(crate) fn place(&self) -> String {
        let line = self.node.document().text_pos_at(self.node.range().start).row;
        format!("{}:{line}", self.file)
    }

    pub(crate) fn attribute(&self, name: &str) -> Option<&'d str> {
        self.node.attribute(name)
    }

    /// Elements in this one, in the order of the file.
    pub(crate) fn children(self, tag: &'static str) -> impl Iterator<Item = Self> {
        self.node.children().filter(move |node| node.is_element() && node.tag_name().name() == tag).map(move |node| self.at(node))
    }

    /// The first element of a name in this one.
    pub(crate) fn child(self, tag: &'static str) -> Option<Self> {
        self.children(tag).next()
    }

    /// The first element of any name in this one.
    pub(crate) fn first(self) -> Option<Self> {
        self.node.children().find(Node::is_element).map(|node| self.at(node))
    }

    fn at(self, node: Node<'d, 'd>) -> Self {
        Self { node, file: self.file }
    }

    /// The name of a link or joint.
    pub(crate) fn name(&self) -> Result<&'d str, RobotError> {
        self.required("name")
    }

    /// An attribute that every such element has.
    pub(crate) fn required(&self, attribute: &'static str) -> Result<&'d str, RobotError> {
        self.attribute(attribute).ok_or_else(|| self.unreadable(format!("<{}> has no attribute '{attribute}'", self.tag())))
    }

    /// The error of an element that cannot be read.
    pub(crate) fn unreadable(&self, reason: String) -> RobotError {
        RobotError::Parse { file: self.place(), reason }
    }

    /// A number; `None` if the attribute is missing.
    pub(crate) fn number(&self, attribute: &'static str, place: impl Fn() -> String) -> Result<Option<f64>, RobotError> {
        let Some(text) = self.attribute(attribute) else { return Ok(None) };
        match text.trim().parse() {
            Ok(number) => Ok(Some(number)),
            Err(_) => Err(self.word(text, "a number", place())),
        }
    }

    /// Three numbers; `None` if the attribute is missing.
    pub(crate) fn triple(&self, attribute: &'static str, place: impl Fn() -> String) -> Result<Option<[f64; 3]>, RobotError> {
        let Some(text) = self.attribute(attribute) else { return Ok(None) };
        let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        match numbers.ok().and_then(|numbers| <[f64; 3]>::try_from(numbers).ok()) {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(self.word(text, "three numbers", place())),
        }
    }

    fn word(&self, found: &str, expected: &'static str, place: String) -> RobotError {
        RobotError::Number { file: self.place(), place, found: found.to_owned(), expected }
    }

    /// Checks that a number is finite.
    pub(crate) fn finite(&self, found: f64, place: impl FnOnce() -> String) -> Result<(), RobotError> {
        if found.is_finite() {
            return Ok(());
        }
        Err(RobotError::NotFinite { file: self.place(), place: place(), found })
    }

    /// Checks that the size of a number is plausible.
    pub(crate) fn bounded(&self, found: f64, place: impl Fn() -> String) -> Result<(), RobotError> {
        self.finite(found, &place)?;
        if found.abs() <= LARGEST {
            return Ok(());
        }
        Err(RobotError::TooLarge { file: self.place(), place: place(), found, most: LARGEST })
    }

    /// Checks that a number is zero or more.
    pub(crate) fn not_negative(&self, found: f64, place: impl Fn() -> String) -> Result<(), RobotError> {
        self.bounded(found, &place)?;
        if found >= 0.0 {
            return Ok(());
        }
        Err(RobotError::Negative { file: self.place(), place: place(), found })
    }

    /// Checks that a number is above zero.
    pub(crate) fn positive(&self, found: f64, place: impl Fn() -> String) -> Result<(), RobotError> {
        self.bounded(found, &place)?;
        if found > 0.0 {
            return Ok(());
        }
        Err(RobotError::NotPositive { file: self.place(), place: place(), found })
    }
}

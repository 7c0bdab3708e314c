//! Checked tree of links of a URDF: names resolved, one parent per link, no loop.

use crate::error::RobotError;
use crate::xml::Element;
use roxmltree::Document;
use std::collections::HashMap;

/// Largest number of links of which an error lists all names; of more it lists the nearest.
const LISTED_NAMES: usize = 12;
/// Number of nearest names that an error lists.
const NEAR_NAMES: usize = 5;

/// A link: its name, and its element.
pub(crate) struct Link<'d> {
    pub(crate) name: &'d str,
    pub(crate) element: Element<'d>,
}

/// A joint. What only matters in the chain is read there.
pub(crate) struct Joint<'d> {
    pub(crate) name: &'d str,
    /// Its type, as written.
    pub(crate) kind: &'d str,
    pub(crate) child: &'d str,
    pub(crate) element: Element<'d>,
}

/// Links and joints by index, in the order of the file.
pub(crate) struct UrdfTree<'d> {
    file: &'d str,
    links: Vec<Link<'d>>,
    joints: Vec<Joint<'d>>,
    /// Parent and child link of each joint.
    ends: Vec<(usize, usize)>,
    /// The joint above each link.
    above: Vec<Option<usize>>,
    /// The joints below each link.
    below: Vec<Vec<usize>>,
    /// Joints that connect no two links, as errors: they are left out, unless the chain is not found without them.
    unconnected: Vec<RobotError>,
}

/// Reads the XML of a URDF; `file` is its name in messages.
pub(crate) fn parse<'d>(text: &'d str, file: &str) -> Result<Document<'d>, RobotError> {
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..roxmltree::ParsingOptions::default() };
    Document::parse_with_options(text, options)
        .map_err(|error| RobotError::Parse { file: format!("{file}:{}", error.pos().row), reason: error.to_string() })
}

/// Links of a description at which a chain may begin and end: those that no joint moves, and those that carry no joint.
///
/// # Errors
/// [`RobotError`] if the description cannot be read.
pub fn ends(text: &str, file: &str) -> Result<(Vec<String>, Vec<String>), RobotError> {
    let document = parse(text, file)?;
    let tree = UrdfTree::read(&document, file)?;
    let names = |free: &dyn Fn(usize) -> bool| {
        (0..tree.links.len()).filter(|&link| free(link)).map(|link| tree.links[link].name.to_owned()).collect()
    };
    Ok((names(&|link| tree.above[link].is_none()), names(&|link| tree.below[link].is_empty())))
}

impl<'d> UrdfTree<'d> {
    /// Checks names and links of a URDF; `file` is its name in messages.
    pub(crate) fn read(document: &'d Document<'d>, file: &'d str) -> Result<Self, RobotError> {
        let root = Element::new(document.root_element(), file);
        if root.tag() != "robot" {
            return Err(root.unreadable(format!("the root element is <{}>", root.tag())));
        }
        let links = root.children("link").map(|element| Ok(Link { name: element.name()?, element }));
        let links = links.collect::<Result<Vec<_>, RobotError>>()?;
        let end = |element: Element<'d>, tag: &'static str| {
            let missing = || element.unreadable(format!("<joint> has no <{tag}>"));
            element.child(tag).ok_or_else(missing)?.required("link")
        };
        let indices = unique("link", links.iter().map(|link| (link.name, link.element)))?;
        let joint = |element: Element<'d>| {
            let (name, kind) = (element.name()?, element.required("type")?);
            let index_of = |at: &'static str| {
                let link = end(element, at)?;
                let dangling = || RobotError::DanglingJoint {
                    file: element.place(),
                    joint: name.to_owned(),
                    end: at,
                    link: link.to_owned(),
                    expected: names_like(&links, link),
                };
                indices.get(link).copied().ok_or_else(dangling)
            };
            let ends = (index_of("parent")?, index_of("child")?);
            Ok((Joint { name, kind, child: links[ends.1].name, element }, ends))
        };
        let (mut joints, mut ends, mut unconnected) = (Vec::new(), Vec::new(), Vec::new());
        for read in root.children("joint").map(joint) {
            match read {
                Ok((joint, between)) => {
                    joints.push(joint);
                    ends.push(between);
                }
                Err(error) => unconnected.push(error),
            }
        }
        unique("joint", joints.iter().map(|joint| (joint.name, joint.element)))?;

        let mut above: Vec<Option<usize>> = vec![None; links.len()];
        let mut below = vec![Vec::new(); links.len()];
        for (index, (joint, &(parent, child))) in joints.iter().zip(&ends).enumerate() {
            if let Some(first) = above[child] {
                return Err(RobotError::TwoParents {
                    file: joint.element.place(),
                    link: joint.child.to_owned(),
                    first: joints[first].name.to_owned(),
                    second: joint.name.to_owned(),
                });
            }
            above[child] = Some(index);
            below[parent].push(index);
        }
        let tree = Self { file, links, joints, ends, above, below, unconnected };
        tree.check_acyclic()?;
        Ok(tree)
    }

    /// Warnings of the joints that are left out since they connect no two links.
    pub(crate) fn warnings(&self) -> Vec<String> {
        self.unconnected.iter().map(|error| format!("{error} (the joint is left out: the chain does not need it)")).collect()
    }

    /// Name of the source, for messages.
    pub(crate) fn file(&self) -> &'d str {
        self.file
    }

    /// A link by its index.
    pub(crate) fn link(&self, index: usize) -> &Link<'d> {
        &self.links[index]
    }

    /// A joint by its index.
    pub(crate) fn joint(&self, index: usize) -> &Joint<'d> {
        &self.joints[index]
    }

    /// The link that a joint moves.
    pub(crate) fn child(&self, joint: usize) -> usize {
        self.ends[joint].1
    }

    /// The joints below a link, in the order of the file.
    pub(crate) fn below(&self, link: usize) -> &[usize] {
        &self.below[link]
    }

    /// Index of a link by name; `role` is for the error.
    pub(crate) fn find(&self, role: &'static str, name: &str) -> Result<usize, RobotError> {
        self.links.iter().position(|link| link.name == name).ok_or_else(|| RobotError::UnknownLink {
            file: self.file.to_owned(),
            role,
            name: name.to_owned(),
            expected: names_like(&self.links, name),
        })
    }

    /// The joints from base to tip, in this order.
    pub(crate) fn path(&self, base: usize, tip: usize) -> Result<Vec<usize>, RobotError> {
        let mut joints = Vec::new();
        let mut ancestors = vec![format!("'{}'", self.link(tip).name)];
        let mut link = tip;
        while link != base {
            let Some(joint) = self.above[link] else {
                if let Some(error) = self.unconnected.first() {
                    return Err(error.clone());
                }
                return Err(RobotError::NotBelow {
                    file: self.file.to_owned(),
                    base: self.link(base).name.to_owned(),
                    tip: self.link(tip).name.to_owned(),
                    ancestors: ancestors.join(", "),
                });
            };
            joints.push(joint);
            link = self.ends[joint].0;
            ancestors.push(format!("'{}'", self.link(link).name));
        }
        joints.reverse();
        Ok(joints)
    }

    /// Checks that no link is its own ancestor.
    fn check_acyclic(&self) -> Result<(), RobotError> {
        for start in 0..self.links.len() {
            let mut link = start;
            let mut steps = 0;
            while let Some(joint) = self.above[link] {
                link = self.ends[joint].0;
                steps += 1;
                if steps > self.links.len() {
                    return Err(RobotError::Cycle { file: self.file.to_owned(), link: self.link(link).name.to_owned() });
                }
            }
        }
        Ok(())
    }
}

/// Indices by name; rejects a duplicate name.
fn unique<'d>(
    what: &'static str,
    names: impl Iterator<Item = (&'d str, Element<'d>)>,
) -> Result<HashMap<&'d str, usize>, RobotError> {
    let mut indices = HashMap::new();
    for (index, (name, element)) in names.enumerate() {
        if indices.insert(name, index).is_some() {
            return Err(RobotError::Duplicate { file: element.place(), what, name: name.to_owned() });
        }
    }
    Ok(indices)
}

/// Expected link names for a message: all, or the nearest of many.
fn names_like(links: &[Link<'_>], name: &str) -> String {
    if links.is_empty() {
        return "a file with links, this one has none".to_owned();
    }
    let mut names: Vec<&str> = links.iter().map(|link| link.name).collect();
    let intro = if names.len() <= LISTED_NAMES {
        "one of"
    } else {
        // Stable, so equally near names stay in the order of the file.
        names.sort_by(|a, b| strsim::jaro_winkler(b, name).total_cmp(&strsim::jaro_winkler(a, name)));
        names.truncate(NEAR_NAMES);
        "a link such as"
    };
    let quoted: Vec<String> = names.iter().map(|name| format!("'{name}'")).collect();
    format!("{intro} {}", quoted.join(", "))
}

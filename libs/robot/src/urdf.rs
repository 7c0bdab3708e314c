//! Checked tree of links of a URDF: names resolved, one parent per link, no loop.

use crate::error::RobotError;
use std::collections::HashMap;
use urdf_rs::{Joint, JointType, Link, Robot};

/// Largest number of links of which an error lists all names; of more it lists the nearest.
const LISTED_NAMES: usize = 12;
/// Number of nearest names that an error lists.
const NEAR_NAMES: usize = 5;

/// Links and joints by index, in the order of the file.
pub(crate) struct UrdfTree<'a> {
    file: &'a str,
    robot: Robot,
    /// Parent and child link of each joint.
    ends: Vec<(usize, usize)>,
    /// The joint above each link.
    above: Vec<Option<usize>>,
    /// The joints below each link.
    below: Vec<Vec<usize>>,
}

impl<'a> UrdfTree<'a> {
    /// Reads and checks a URDF; `file` is its name in messages.
    pub(crate) fn read(text: &str, file: &'a str) -> Result<Self, RobotError> {
        let robot = urdf_rs::read_from_string(text)
            .map_err(|error| RobotError::Parse { file: file.to_owned(), reason: error.to_string() })?;
        let links = unique(file, "link", robot.links.iter().map(|link| link.name.as_str()))?;
        unique(file, "joint", robot.joints.iter().map(|joint| joint.name.as_str()))?;

        let mut ends = Vec::with_capacity(robot.joints.len());
        let mut above: Vec<Option<usize>> = vec![None; robot.links.len()];
        let mut below = vec![Vec::new(); robot.links.len()];
        for (index, joint) in robot.joints.iter().enumerate() {
            let index_of = |end: &'static str, link: &str| {
                links.get(link).copied().ok_or_else(|| RobotError::DanglingJoint {
                    file: file.to_owned(),
                    joint: joint.name.clone(),
                    end,
                    link: link.to_owned(),
                    expected: names_like(&robot.links, link),
                })
            };
            let parent = index_of("parent", &joint.parent.link)?;
            let child = index_of("child", &joint.child.link)?;
            if let Some(first) = above[child] {
                return Err(RobotError::TwoParents {
                    file: file.to_owned(),
                    link: joint.child.link.clone(),
                    first: robot.joints[first].name.clone(),
                    second: joint.name.clone(),
                });
            }
            above[child] = Some(index);
            below[parent].push(index);
            ends.push((parent, child));
        }
        let tree = Self { file, robot, ends, above, below };
        tree.check_acyclic()?;
        Ok(tree)
    }

    /// Name of the source, for messages.
    pub(crate) fn file(&self) -> &'a str {
        self.file
    }

    /// A link by its index.
    pub(crate) fn link(&self, index: usize) -> &Link {
        &self.robot.links[index]
    }

    /// A joint by its index.
    pub(crate) fn joint(&self, index: usize) -> &Joint {
        &self.robot.joints[index]
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
        self.robot.links.iter().position(|link| link.name == name).ok_or_else(|| RobotError::UnknownLink {
            file: self.file.to_owned(),
            role,
            name: name.to_owned(),
            expected: names_like(&self.robot.links, name),
        })
    }

    /// The joints from base to tip, in this order.
    pub(crate) fn path(&self, base: usize, tip: usize) -> Result<Vec<usize>, RobotError> {
        let mut joints = Vec::new();
        let mut ancestors = vec![format!("'{}'", self.link(tip).name)];
        let mut link = tip;
        while link != base {
            let Some(joint) = self.above[link] else {
                return Err(RobotError::NotBelow {
                    file: self.file.to_owned(),
                    base: self.link(base).name.clone(),
                    tip: self.link(tip).name.clone(),
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
        for start in 0..self.robot.links.len() {
            let mut link = start;
            let mut steps = 0;
            while let Some(joint) = self.above[link] {
                link = self.ends[joint].0;
                steps += 1;
                if steps > self.robot.links.len() {
                    return Err(RobotError::Cycle { file: self.file.to_owned(), link: self.link(link).name.clone() });
                }
            }
        }
        Ok(())
    }
}

/// Name of a joint type in URDF.
pub(crate) fn type_name(joint_type: &JointType) -> &'static str {
    match joint_type {
        JointType::Revolute => "revolute",
        JointType::Continuous => "continuous",
        JointType::Prismatic => "prismatic",
        JointType::Fixed => "fixed",
        JointType::Floating => "floating",
        JointType::Planar => "planar",
        JointType::Spherical => "spherical",
    }
}

/// Indices by name; rejects a duplicate name.
fn unique<'n>(
    file: &str,
    what: &'static str,
    names: impl Iterator<Item = &'n str>,
) -> Result<HashMap<String, usize>, RobotError> {
    let mut indices = HashMap::new();
    for (index, name) in names.enumerate() {
        if indices.insert(name.to_owned(), index).is_some() {
            return Err(RobotError::Duplicate { file: file.to_owned(), what, name: name.to_owned() });
        }
    }
    Ok(indices)
}

/// Expected link names for a message: all, or the nearest of many.
fn names_like(links: &[Link], name: &str) -> String {
    if links.is_empty() {
        return "a file with links, this one has none".to_owned();
    }
    let mut names: Vec<&str> = links.iter().map(|link| link.name.as_str()).collect();
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

//! Errors of a robot description.

use thiserror::Error;

/// An error of a robot description.
///
/// Every message names the file, the place in it, the found and the expected value, and the correction.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RobotError {
    /// The text is not a URDF: XML that does not parse, a missing element or attribute, a word where a number belongs.
    #[error("{file}: cannot be read as URDF: {reason}; expected <robot> with <link> and <joint> elements: correct the file")]
    Parse {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Message of the URDF reader.
        reason: String,
    },
    /// Base or tip link does not exist.
    #[error("{file}: {role} link '{name}' does not exist; expected {expected}: correct the name")]
    UnknownLink {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// `base` or `tip`.
        role: &'static str,
        /// The requested name.
        name: String,
        /// The names there are, or the nearest of them.
        expected: String,
    },
    /// A joint names a link that is not in the file.
    #[error(
        "{file}: joint '{joint}': its {end} link '{link}' is not in the file; expected {expected}: declare it or correct the name"
    )]
    DanglingJoint {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// `parent` or `child`.
        end: &'static str,
        /// The name it uses.
        link: String,
        /// The names there are, or the nearest of them.
        expected: String,
    },
    /// Two links or two joints have the same name.
    #[error("{file}: there are two {what}s '{name}'; expected every name once: rename one")]
    Duplicate {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// `link` or `joint`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A link is the child of two joints.
    #[error(
        "{file}: link '{link}' is the child of joint '{first}' and of joint '{second}'; expected a tree, one parent a link: remove one joint"
    )]
    TwoParents {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The link.
        link: String,
        /// One joint.
        first: String,
        /// The other.
        second: String,
    },
    /// A link is its own ancestor.
    #[error("{file}: link '{link}' is its own ancestor; expected a tree: remove a joint of this loop")]
    Cycle {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// A link of the loop.
        link: String,
    },
    /// The tip is not a descendant of the base.
    #[error(
        "{file}: tip link '{tip}' is not below base link '{base}'; expected a base among the tip and its ancestors, {ancestors}: choose one of these, or another tip"
    )]
    NotBelow {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Base link.
        base: String,
        /// Tip link.
        tip: String,
        /// Links from the tip to the root.
        ancestors: String,
    },
    /// A joint of a kind that a chain cannot have.
    #[error(
        "{file}: joint '{joint}' on the path from base to tip is {found}; expected revolute, continuous, prismatic or fixed: choose a chain without it"
    )]
    UnsupportedJoint {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// Its type.
        found: String,
    },
    /// A joint that follows another one.
    #[error(
        "{file}: joint '{joint}' on the path from base to tip mimics joint '{mimicked}'; expected independent joints: remove its <mimic>"
    )]
    Mimic {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// The joint it follows.
        mimicked: String,
    },
    /// No joint between base and tip can move.
    #[error("{file}: no joint between '{base}' and '{tip}' can move; expected 1 to {max}: choose links further apart", max = crate::MAX_JOINTS)]
    NoMovableJoint {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Base link.
        base: String,
        /// Tip link.
        tip: String,
    },
    /// Too many joints between base and tip.
    #[error("{file}: {found} joints between '{base}' and '{tip}' can move; expected 1 to {max}: choose links closer together", max = crate::MAX_JOINTS)]
    TooManyJoints {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Base link.
        base: String,
        /// Tip link.
        tip: String,
        /// Number of movable joints.
        found: usize,
    },
    /// A movable joint without a direction.
    #[error("{file}: joint '{joint}' <axis xyz>: found {found:?}; expected a finite vector that is not zero: give the direction")]
    Axis {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// What is written.
        found: [f64; 3],
    },
    /// A movable joint without limits of its position.
    #[error("{file}: {kind} joint '{joint}' has no <limit> with lower and upper; expected {expected}: add it")]
    MissingLimit {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// Its type.
        kind: String,
        /// The attributes it needs.
        expected: &'static str,
    },
    /// The lower limit is above the upper one.
    #[error("{file}: joint '{joint}' <limit>: found lower = {lower} above upper = {upper}; expected lower <= upper: swap them")]
    LimitsReversed {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// Lower limit [rad or m].
        lower: f64,
        /// Upper limit [rad or m].
        upper: f64,
    },
    /// A peak torque that is not above zero.
    #[error(
        "{file}: joint '{joint}' <limit effort>: found {}; expected above zero: give the peak torque (N m) or force (N) of the drive, or set robot.effort_limit_n_m in the scenario",
        found.map_or("none".to_owned(), |found| found.to_string())
    )]
    Effort {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// What is written; `None` if nothing is.
        found: Option<f64>,
    },
    /// A word where a number belongs, or another number of numbers.
    #[error("{file}: {place}: found \"{found}\"; expected {expected}: correct it")]
    Number {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Element and attribute.
        place: String,
        /// What is written.
        found: String,
        /// What belongs there.
        expected: &'static str,
    },
    /// A number so large that products of it overflow.
    #[error("{file}: {place}: found {found}; expected at most {most} in size: correct it")]
    TooLarge {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Element and attribute.
        place: String,
        /// What is written.
        found: f64,
        /// Largest size.
        most: f64,
    },
    /// The mass matrix is singular at a posture.
    #[error(
        "{file}: the mass matrix is singular at the posture {posture:?} (smallest eigenvalue of the scaled matrix {smallest:.1e}), in the motion of joint '{joint}'; expected mass or inertia behind every joint: give the links behind it an <inertial>, or make a joint fixed"
    )]
    Singular {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Joint positions [rad or m].
        posture: Vec<f64>,
        /// The joint that moves least mass there.
        joint: String,
        /// Smallest eigenvalue of the mass matrix, scaled to ones on its diagonal.
        smallest: f64,
    },
    /// A number is NaN or infinite.
    #[error("{file}: {place}: found {found}; expected a finite number: write one")]
    NotFinite {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Element and attribute.
        place: String,
        /// What is written.
        found: f64,
    },
    /// A number that must not be negative.
    #[error("{file}: {place}: found {found}; expected zero or more: correct it")]
    Negative {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Element and attribute.
        place: String,
        /// What is written.
        found: f64,
    },
    /// A shape without extent.
    #[error("{file}: {place}: found {found}; expected above zero: correct it")]
    NotPositive {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// Element and attribute.
        place: String,
        /// What is written.
        found: f64,
    },
    /// A joint moves no mass: the mass matrix would be singular.
    #[error(
        "{file}: joint '{joint}' moves no mass of its own: found 0 kg in link '{link}' and what is fixed to it; expected above zero, or the mass matrix is singular: give one of them an <inertial>, or the joint's rotor in robot.armature_kg_m2, or make the joint fixed"
    )]
    Massless {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// The link it moves.
        link: String,
    },
    /// The last joint rotates a body without moment of inertia about its axis: the mass matrix would be singular.
    #[error(
        "{file}: joint '{joint}', the last one, turns a body whose moment of inertia about its axis is {found} kg m^2; expected above zero, or the mass matrix is singular: correct the <inertia> of link '{link}', or give the joint's rotor in robot.armature_kg_m2"
    )]
    NoInertia {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The joint.
        joint: String,
        /// Its child link.
        link: String,
        /// Moment of inertia about the joint's axis [kg m^2].
        found: f64,
    },
    /// An inertia that no body can have.
    #[error(
        "{file}: link '{link}' <inertia>: found the principal moments {principal:?} kg m^2; expected {expected}: correct it (it is about the centre of mass)"
    )]
    Inertia {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The link.
        link: String,
        /// Principal moments, ascending [kg m^2].
        principal: [f64; 3],
        /// The violated condition.
        expected: &'static str,
    },
    /// A mesh as collision shape.
    #[error(
        "{file}: link '{link}' <collision>: found mesh '{mesh}': {reason}, expected an STL or OBJ file, or a box, sphere, cylinder or capsule"
    )]
    Mesh {
        /// Name of the source, with the line of the element if there is one.
        file: String,
        /// The link.
        link: String,
        /// The mesh's file.
        mesh: String,
        /// Why it was not read.
        reason: String,
    },
    /// A table of the scenario names a joint that the chain does not have.
    #[error("{key}: found joint '{found}', expected one of {known}")]
    UnknownJoint {
        /// Key of the table.
        key: &'static str,
        /// Name found.
        found: String,
        /// Names of the movable joints, base to tip.
        known: String,
    },
    /// A list of the scenario has another length than the chain has joints.
    #[error("{key}: found {found} values, expected {joints}, one for each joint from '{base}' to '{tip}'")]
    PerJoint {
        /// Key of the list.
        key: &'static str,
        /// Its length.
        found: usize,
        /// Number of joints of the chain.
        joints: usize,
        /// Base link.
        base: String,
        /// Tip link.
        tip: String,
    },
}

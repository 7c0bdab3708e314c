//! The rigid-body model of a serial chain: forward and inverse kinematics, Jacobian, mass matrix, inverse dynamics.
//!
//! [`Chain::from_urdf`] reads a [`Chain`] from a URDF by its base and tip link. A chain has 1 to [`MAX_JOINTS`]
//! revolute, continuous or prismatic joints; everything fixed to one of its links becomes part of that link.
//!
//! ```
//! use hapfic_robot::Chain;
//! use nalgebra::Vector3;
//!
//! let urdf = r#"
//!   <robot name="pendulum">
//!     <link name="base"/>
//!     <joint name="swing" type="revolute">
//!       <parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
//!       <limit lower="-3" upper="3" effort="10" velocity="20"/>
//!     </joint>
//!     <link name="rod">
//!       <inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
//!         <inertia ixx="0.1" iyy="0.1" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
//!     </link>
//!     <joint name="end" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="0 0 -1"/></joint>
//!     <link name="tip"/>
//!   </robot>"#;
//! let chain = Chain::from_urdf(urdf, "pendulum.urdf", "base", "tip")?;
//! let gravity = Vector3::new(0.0, 0.0, -9.81);
//!
//! let kin = chain.kinematics(&[0.3]);
//! let torque = chain.gravity_torque(&kin, &gravity);
//! assert!((torque[0] - 2.0 * 9.81 * 0.5 * 0.3_f64.sin()).abs() < 1e-12);
//!
//! let push = Vector3::new(1.0, 0.0, 0.0);
//! let torque = chain.jacobian(&kin).linear_transpose_mul(&push);
//! assert!((torque[0] + 0.3_f64.cos()).abs() < 1e-12);
//! # Ok::<(), hapfic_robot::RobotError>(())
//! ```
//!
//! # Conventions
//! SI units. `q` is an angle [rad], or a displacement [m] for a prismatic joint; a generalised force is a torque [N m],
//! or a force [N]. Poses, axes and vectors are in the world frame unless stated otherwise. A joint vector has
//! [`MAX_JOINTS`] entries, of which the first [`Chain::dof`] are valid. This crate returns zeros in the others and
//! ignores them in arguments.
//!
//! # Inputs
//! The functions of a built chain are pure and do not allocate. They return finite numbers for finite inputs. A NaN or
//! an infinity among the inputs gives NaN, not a plausible number: check the data of other processes first, or use
//! [`Kinematics::is_finite`]. The functions panic if a slice is shorter than [`Chain::dof`].

mod build;
mod chain;
pub mod cholesky;
mod collada;
mod collision;
mod definite;
mod drives;
mod dynamics;
mod error;
mod inertia;
mod jacobian;
mod kinematics;
mod mesh;
mod null_space;
mod parts;
mod reach;
mod settings;
mod tip;
mod urdf;
mod xml;

pub use build::Replacements;
pub use chain::{Chain, Joint, JointKind, JointVector, MAX_JOINTS};
pub use collision::{Collision, Shape};
pub use dynamics::MassMatrix;
pub use error::RobotError;
pub use inertia::RigidInertia;
pub use jacobian::Jacobian;
pub use kinematics::Kinematics;
pub use null_space::TaskRows;
pub use reach::Reach;
pub use tip::Tip;
pub use urdf::ends;

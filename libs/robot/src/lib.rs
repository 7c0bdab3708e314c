//! The rigid-body model of a serial chain: forward kinematics, Jacobian, mass matrix, inverse dynamics.
//!
//! A [`Chain`] is picked out of a URDF by its base and tip link. It has 1 to [`MAX_JOINTS`] revolute, continuous or
//! prismatic joints; everything fixed to one of its links becomes part of that link.
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
//! SI units, radians; `q` is in rad, or in m for a prismatic joint, and a generalised force in N m, or in N. Poses, axes
//! and vectors are in the world frame unless said otherwise. Joint vectors are `[f64; 8]` of which the first
//! [`Chain::dof`] places count; the rest is zero in what this crate returns and ignored in what it takes.
//!
//! # What the functions expect
//! The functions of a built chain are pure and use no heap. They take finite numbers and then return finite numbers; a
//! NaN or an infinity among the inputs comes out as NaN rather than as a plausible number: check what comes from another
//! process before, or ask [`Kinematics::is_finite`]. They panic if a slice is shorter than [`Chain::dof`].

mod build;
mod chain;
mod collision;
mod dynamics;
mod error;
mod inertia;
mod jacobian;
mod kinematics;
mod settings;
mod urdf;

pub use chain::{Chain, Joint, JointKind, JointVector, MAX_JOINTS};
pub use collision::{Collision, Shape};
pub use dynamics::MassMatrix;
pub use error::RobotError;
pub use inertia::RigidInertia;
pub use jacobian::Jacobian;
pub use kinematics::Kinematics;

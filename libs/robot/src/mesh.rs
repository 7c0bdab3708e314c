//! Collision meshes, as their convex hulls.

use crate::error::RobotError;
use crate::xml::Element;
use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest file that is read [byte].
const LARGEST: u64 = 64 << 20;
/// Largest coordinate [m].
const FARTHEST: f64 = 100.0;
/// Volume below which a hull is flat, over the cube of its size.
const FLATTEST: f64 = 1e-6;
/// Most corners of a hull: every distance costs time with each. A rounder hull is replaced by its corners that lie farthest
/// in as many directions.
const MOST_CORNERS: usize = 128;
/// Most points of which a hull is computed: the time grows with the square. More are thinned in the same way before.
const MOST_POINTS: usize = 1024;

/// Middle of a mesh in its own frame, and the corners of its hull seen from there [m].
type Hull = (Vector3<f64>, Arc<[[f64; 3]]>);

/// The hull of a mesh element of a link.
///
/// `urdf` is the file of the description: a mesh is looked for beside it, and that of a package in the folders above.
pub(crate) fn hull(link: &str, mesh: Element<'_>, urdf: &str) -> Result<Hull, RobotError> {
    let name = mesh.attribute("filename").unwrap_or_default();
    let scale_place = || format!("link '{link}' <collision> mesh scale");
    let scale = Vector3::from(mesh.triple("scale", scale_place)?.unwrap_or([1.0; 3]));
    corners(name, urdf, &scale).map_err(|reason| RobotError::Mesh {
        file: mesh.place(),
        link: link.to_owned(),
        mesh: name.to_owned(),
        reason,
    })
}

fn corners(name: &str, urdf: &str, scale: &Vector3<f64>) -> Result<Hull, String> {
    let path = find(name, Path::new(urdf)).ok_or("found no such file")?;
    let kind = path.extension().map(|kind| kind.to_string_lossy().to_lowercase()).unwrap_or_default();
    if !["stl", "obj", "dae"].contains(&kind.as_str()) {
        return Err(format!("found a file of kind '{kind}'"));
    }
    let mut bytes = Vec::new();
    let read = File::open(&path).and_then(|file| file.take(LARGEST + 1).read_to_end(&mut bytes));
    read.map_err(|error| error.to_string())?;
    if bytes.len() as u64 > LARGEST {
        return Err(format!("found more than {LARGEST} bytes"));
    }
    let vertices: Vec<[f64; 3]> = if kind == "dae" {
        crate::collada::points(core::str::from_utf8(&bytes).map_err(|error| error.to_string())?)?
    } else {
        // The materials of an OBJ are other files, and are not read.
        let scene = mesh_loader::Loader::default().load_from_slice_with_reader(&bytes, &path, |_| Ok(Vec::new()));
        let scene = scene.map_err(|error| error.to_string())?;
        scene.meshes.iter().flat_map(|mesh| &mesh.vertices).map(|vertex| vertex.map(f64::from)).collect()
    };
    let points: Vec<Vector> = vertices.iter().map(|[x, y, z]| Vector::new(scale.x * x, scale.y * y, scale.z * z)).collect();
    if let Some(far) = points.iter().find(|point| !point.is_finite() || point.abs().max_element() > FARTHEST) {
        return Err(format!("found a corner at {:.3e} m, expected all within {FARTHEST} m", far.abs().max_element()));
    }
    let few = if points.len() > MOST_POINTS { farthest(&points, MOST_POINTS) } else { points };
    let mut hull = convex(&few)?;
    if hull.len() > MOST_CORNERS {
        hull = convex(&farthest(&hull, MOST_CORNERS))?;
    }
    let (low, high) = hull.iter().fold((hull[0], hull[0]), |(low, high), point| (low.min(*point), high.max(*point)));
    let middle = 0.5 * (low + high);
    let corners = hull.iter().map(|point| (*point - middle).to_array()).collect();
    Ok((Vector3::new(middle.x, middle.y, middle.z), corners))
}

/// Corners of the convex hull, which has a volume.
fn convex(points: &[Vector]) -> Result<Vec<Vector>, String> {
    let (hull, faces) = try_convex_hull(points).map_err(|error| format!("it has no convex hull ({error})"))?;
    let corner = |index: u32| hull[index as usize] - hull[0];
    let volume: f64 = faces.iter().map(|[a, b, c]| corner(*a).dot(corner(*b).cross(corner(*c))) / 6.0).sum();
    let size = hull.iter().map(|point| (*point - hull[0]).length()).fold(0.0, f64::max);
    if volume > FLATTEST * size.powi(3) { Ok(hull) } else { Err("its convex hull has no volume".to_owned()) }
}

/// The points that lie farthest in directions spread evenly over the sphere (a spiral by the golden angle).
fn farthest(points: &[Vector], directions: usize) -> Vec<Vector> {
    let golden = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let mut chosen: Vec<usize> = (0..directions)
        .filter_map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / directions as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let direction = Vector::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vector::Z * z;
            (0..points.len()).max_by(|a, b| points[*a].dot(direction).total_cmp(&points[*b].dot(direction)))
        })
        .collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|index| points[index]).collect()
}

/// The file of a mesh: `file://` and relative names from the description's folder; `package://name/rest` from the first folder
/// above it in which `name/rest` or `rest` is there.
fn find(name: &str, urdf: &Path) -> Option<PathBuf> {
    // An embedded description has no folder, and no meshes.
    let folder = urdf.is_file().then(|| urdf.canonicalize().ok()).flatten()?;
    let folder = folder.parent()?;
    if let Some(rest) = name.strip_prefix("package://").or_else(|| name.strip_prefix("model://")) {
        let inner = rest.split_once('/').map(|(_, inner)| inner);
        return folder.ancestors().find_map(|above| {
            [Some(rest), inner].into_iter().flatten().map(|rest| above.join(rest)).find(|path| path.is_file())
        });
    }
    Some(folder.join(name.strip_prefix("file://").unwrap_or(name))).filter(|path| path.is_file())
}

//! Points of a COLLADA mesh: the vertices of its visual scene, in metres.
//!
//! The unit of the file counts; its `<up_axis>` does not, as in the programs that display robots: a description places its
//! meshes itself. Only positions are read, so materials, normals and textures may be whatever they are.

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};
use roxmltree::{Document, Node};

/// Levels of nodes in nodes, at most: a file may refer to itself.
const DEEPEST: u32 = 32;
/// Points, at most.
const MOST: usize = 10_000_000;

/// The points of all instances of all geometries, in the frame of the file [m].
pub(crate) fn points(text: &str) -> Result<Vec<[f64; 3]>, String> {
    let document = Document::parse(text).map_err(|error| format!("it is no XML ({error})"))?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(format!("found <{}>, expected <COLLADA>", root.tag_name().name()));
    }
    let unit = match child(root, "asset").and_then(|asset| child(asset, "unit")).and_then(|unit| unit.attribute("meter")) {
        Some(text) => number(text)?,
        None => 1.0,
    };
    let reader = Reader { root };
    let mut points = Vec::new();
    let scaled = Matrix4::new_scaling(unit);
    match child(root, "scene").and_then(|scene| child(scene, "instance_visual_scene")) {
        Some(instance) => {
            let scene = reader.by_id(instance.attribute("url"), "visual_scene")?;
            for node in children(scene, "node") {
                reader.node(node, &scaled, DEEPEST, &mut points)?;
            }
        }
        // Without a scene every geometry lies in the frame of the file.
        None => {
            for geometry in root.descendants().filter(|node| node.has_tag_name_any("geometry")) {
                reader.geometry(geometry, &scaled, &mut points)?;
            }
        }
    }
    if points.is_empty() { Err("found no vertices".to_owned()) } else { Ok(points) }
}

/// Names in any of the namespaces that versions of COLLADA have.
trait AnyNamespace {
    fn has_tag_name_any(&self, name: &str) -> bool;
}

impl AnyNamespace for Node<'_, '_> {
    fn has_tag_name_any(&self, name: &str) -> bool {
        self.tag_name().name() == name
    }
}

fn children<'a, 'd: 'a>(node: Node<'a, 'd>, name: &'static str) -> impl Iterator<Item = Node<'a, 'd>> {
    node.children().filter(move |child| child.has_tag_name_any(name))
}

fn child<'a, 'd>(node: Node<'a, 'd>, name: &'static str) -> Option<Node<'a, 'd>> {
    children(node, name).next()
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| format!("found '{}', expected a number", text.trim()))
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split_whitespace().map(number).collect()
}

struct Reader<'a, 'd> {
    root: Node<'a, 'd>,
}

impl<'a, 'd> Reader<'a, 'd> {
    /// The element that a reference within the file names.
    fn by_id(&self, url: Option<&str>, name: &'static str) -> Result<Node<'a, 'd>, String> {
        let id = url.and_then(|url| url.strip_prefix('#')).ok_or_else(|| format!("found a <{name}> outside of the file"))?;
        let mut all = self.root.descendants();
        all.find(|node| node.attribute("id") == Some(id) && (name.is_empty() || node.has_tag_name_any(name)))
            .ok_or_else(|| format!("found no <{name}> '{id}'"))
    }

    fn node(&self, node: Node<'a, 'd>, parent: &Matrix4<f64>, deepest: u32, points: &mut Vec<[f64; 3]>) -> Result<(), String> {
        if deepest == 0 {
            return Err(format!("found more than {DEEPEST} nodes in each other"));
        }
        let mut pose = *parent;
        for element in node.children().filter(Node::is_element) {
            // Transformations count in the order in which they are written.
            if let Some(transform) = transform(element)? {
                pose *= transform;
            }
        }
        for instance in children(node, "instance_geometry") {
            self.geometry(self.by_id(instance.attribute("url"), "geometry")?, &pose, points)?;
        }
        for instance in children(node, "instance_node") {
            self.node(self.by_id(instance.attribute("url"), "node")?, &pose, deepest - 1, points)?;
        }
        for inner in children(node, "node") {
            self.node(inner, &pose, deepest - 1, points)?;
        }
        Ok(())
    }

    fn geometry(&self, geometry: Node<'a, 'd>, pose: &Matrix4<f64>, points: &mut Vec<[f64; 3]>) -> Result<(), String> {
        // Splines have no vertices.
        let Some(mesh) = child(geometry, "mesh") else { return Ok(()) };
        let Some(vertices) = child(mesh, "vertices") else { return Ok(()) };
        let input = children(vertices, "input").find(|input| input.attribute("semantic") == Some("POSITION"));
        let source = self.by_id(input.and_then(|input| input.attribute("source")), "source")?;
        let array = child(source, "float_array").and_then(|array| array.text()).unwrap_or_default();
        let accessor = source.descendants().find(|node| node.has_tag_name_any("accessor"));
        let stride = accessor.and_then(|accessor| accessor.attribute("stride")).map_or(Ok(3.0), number)? as usize;
        if stride < 3 {
            return Err(format!("found positions of {stride} numbers, expected 3"));
        }
        for position in numbers(array)?.chunks_exact(stride) {
            if points.len() == MOST {
                return Err(format!("found more than {MOST} vertices"));
            }
            let point = pose.transform_point(&Point3::new(position[0], position[1], position[2]));
            points.push([point.x, point.y, point.z]);
        }
        Ok(())
    }
}

/// The matrix of a transformation element; `None` for any other element.
fn transform(element: Node<'_, '_>) -> Result<Option<Matrix4<f64>>, String> {
    let name = element.tag_name().name();
    let count = match name {
        "matrix" => 16,
        "translate" | "scale" => 3,
        "rotate" => 4,
        _ => return Ok(None),
    };
    let values = numbers(element.text().unwrap_or_default())?;
    if values.len() != count || values.iter().any(|value| !value.is_finite()) {
        return Err(format!("found <{name}> of {} numbers, expected {count} finite ones", values.len()));
    }
    let vector = || Vector3::new(values[0], values[1], values[2]);
    Ok(Some(match name {
        "matrix" => Matrix4::from_row_slice(&values),
        "translate" => Matrix4::new_translation(&vector()),
        "scale" => Matrix4::new_nonuniform_scaling(&vector()),
        _ => match Unit::try_new(vector(), 1e-12) {
            Some(axis) => Rotation3::from_axis_angle(&axis, values[3].to_radians()).to_homogeneous(),
            None => Matrix4::identity(),
        },
    }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn file(asset: &str, scene: &str) -> String {
        format!(
            "<?xml version=\"1.0\"?><COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\">{asset}\
             <library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array count=\"6\">0 0 0 1 2 3</float_array>\
             <technique_common><accessor source=\"#a\" count=\"2\" stride=\"3\"/></technique_common></source>\
             <vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices></mesh></geometry></library_geometries>{scene}\
             </COLLADA>"
        )
    }

    const SCENE: &str = "<library_visual_scenes><visual_scene id=\"s\"><node><translate>10 0 0</translate>\
        <rotate>0 0 1 90</rotate><node><scale>2 2 2</scale><instance_geometry url=\"#g\"/></node></node>\
        <node><matrix>1 0 0 0  0 1 0 0  0 0 1 5  0 0 0 1</matrix><instance_geometry url=\"#g\"/></node></visual_scene>\
        </library_visual_scenes><scene><instance_visual_scene url=\"#s\"/></scene>";

    #[test]
    fn instances_have_their_poses_and_the_unit() {
        let asset = "<asset><unit meter=\"0.01\" name=\"centimeter\"/><up_axis>Y_UP</up_axis></asset>";
        let found = points(&file(asset, SCENE)).unwrap();
        let expected = [[0.1, 0.0, 0.0], [0.1 - 0.04, 0.02, 0.06], [0.0, 0.0, 0.05], [0.01, 0.02, 0.08]];
        assert_eq!(found.len(), 4);
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
    }

    #[test]
    fn geometry_without_a_scene_is_in_metres() {
        assert_eq!(points(&file("", "")).unwrap(), [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let wrong = |text: &str| points(text).unwrap_err();
        assert!(wrong("<COLLADA").contains("no XML"));
        assert_eq!(wrong("<robot/>"), "found <robot>, expected <COLLADA>");
        assert_eq!(wrong("<COLLADA/>"), "found no vertices");
        assert_eq!(wrong(&file("", &SCENE.replace("#g", "#h"))), "found no <geometry> 'h'");
        assert_eq!(wrong(&file("", &SCENE.replace("10 0 0", "10 0"))), "found <translate> of 2 numbers, expected 3 finite ones");
        assert!(wrong(&file("<asset><unit meter=\"one\"/></asset>", SCENE)).contains("'one'"));
        let endless = "<library_nodes><node id=\"n\"><instance_node url=\"#n\"/></node></library_nodes><library_visual_scenes>\
            <visual_scene id=\"s\"><node><instance_node url=\"#n\"/></node></visual_scene></library_visual_scenes>\
            <scene><instance_visual_scene url=\"#s\"/></scene>";
        assert!(wrong(&file("", endless)).contains("32 nodes"));
    }
}

use super::*;
use panelprep_base::geometry::LengthUnit;

/// Two triangles of a square of 2 × 1.
const TEXT: &str = "solid skin made by hand, unit: mm\n\
    facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 2 0 0\n  vertex 2 1 0\n endloop\nendfacet\n\
    facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 2 1 0\n  vertex 0 1 -0\n endloop\nendfacet\nendsolid skin\n";
const OBJ: &str = "# units: inches\no skin\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvn 0 0 1\nf 1/1/1 2//1 3 -1\n";
const PLY: &str = "ply\nformat ascii 1.0\ncomment unit m\nelement vertex 4\nproperty float x\nproperty float y\n\
    property double z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0 9\n2 0 0 9\n2 1 0 9\n0 1 0 9\n4 0 1 2 3\n";

fn area(mesh: &TriangleMesh) -> f64 {
    let at = |corner: u32| nalgebra::Point3::from(mesh.vertices[corner as usize]);
    mesh.triangles.iter().map(|&[a, b, c]| (at(b) - at(a)).cross(&(at(c) - at(a))).norm() / 2.0).sum()
}

/// The same square in every form: four vertices, two triangles, an area of 2, and the unit that a comment states.
#[test]
fn every_form_gives_the_same_mesh() {
    let text = read_mesh(TEXT.as_bytes()).expect("text STL");
    let binary = read_mesh(&write_stl(&text)).expect("binary STL");
    let obj = read_mesh(OBJ.as_bytes()).expect("OBJ");
    let ply = read_mesh(PLY.as_bytes()).expect("PLY");
    for mesh in [&text, &binary, &obj, &ply] {
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (4, 2));
        assert!((area(mesh) - 2.0).abs() < 1e-12);
    }
    let units = [LengthUnit::Millimetre, LengthUnit::Millimetre, LengthUnit::Inch, LengthUnit::Metre];
    assert_eq!([text.unit, binary.unit, obj.unit, ply.unit], units.map(Some));
    assert_eq!(text.objects[0].name, "skin");
    let binary_ply = binary_ply();
    assert_eq!(read_mesh(&binary_ply).expect("binary PLY").triangles, [[0, 1, 2], [0, 2, 3]]);
}

fn binary_ply() -> Vec<u8> {
    let header = PLY.split("0 0 0 9").next().expect("a header").replace("ascii", "binary_little_endian");
    let mut bytes = header.into_bytes();
    for [x, y] in [[0.0_f32, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]] {
        bytes.extend([x.to_le_bytes(), y.to_le_bytes()].concat());
        bytes.extend(0.0_f64.to_le_bytes());
        bytes.push(9);
    }
    bytes.push(4);
    (0..4_i32).for_each(|corner| bytes.extend(corner.to_le_bytes()));
    bytes
}

/// Two solids that share two vertices stay two objects with vertices of their own.
#[test]
fn solids_stay_apart() {
    let mesh =
        read_mesh(TEXT.replacen("endfacet\n", "endfacet\nendsolid\nsolid rib\n", 1).as_bytes()).expect("two");
    let objects: Vec<_> = mesh.objects().map(|(name, triangles)| (name, triangles.len())).collect();
    assert_eq!((objects, mesh.vertices.len()), (vec![("skin", 1), ("rib", 1)], 6));
}

#[test]
fn each_refusal_names_the_place_and_what_to_do() {
    let binary = write_stl(&read_mesh(TEXT.as_bytes()).expect("good"));
    let changed = |from: &str, to: &str| TEXT.replacen(from, to, 1).into_bytes();
    let infinite = [&binary[..100], &f32::INFINITY.to_le_bytes(), &binary[104..]].concat();
    let ply = |from: &str, to: &str| PLY.replacen(from, to, 1).into_bytes();
    let cut_ply = binary_ply();
    let cases: Vec<(Vec<u8>, &str)> = vec![
        (binary[..binary.len() - 50].to_vec(), "states 2 triangles, which need 184 bytes, but the file has 134"),
        (infinite, "triangle 1: a coordinate is infinite"),
        (changed("vertex 2 0 0", "vertex 2 0"), "line 5: 'vertex 2 0': three finite numbers"),
        (changed("vertex 2 0 0", "vertex 2 0 nan"), "line 5: 'vertex 2 0 nan': three finite numbers"),
        (changed("  vertex 2 0 0\n", ""), "line 6: the facet has 2 vertices"),
        (changed("endsolid skin", ""), "before 'endsolid': it is truncated"),
        (TEXT.split_inclusive('\n').take(9).collect::<String>().into_bytes(), "truncated"),
        (changed(" outer loop\n", ""), "line 3: 'vertex 0 0 0' is not expected here"),
        (b"solid nothing\nendsolid\n".to_vec(), "no triangle"),
        (
            b"ISO-10303-21;\nHEADER;\n".to_vec(),
            "a STEP file, whose surfaces are formulas, not triangles: convert it to STL",
        ),
        (b"a text\nof no kind\n".to_vec(), "not an STL, PLY or OBJ file"),
        (b"".to_vec(), "not an STL, PLY or OBJ file"),
        (OBJ.replace("-1", "5").into_bytes(), "line 8: '5' is not the number of a vertex; valid: 1 to 4"),
        (OBJ.replace("-1", "0").into_bytes(), "line 8: '0' is not the number of a vertex"),
        (OBJ.replace("v 2 1 0", "v 2 1 x").into_bytes(), "line 5: 'v 2 1 x': three finite"),
        (
            OBJ.replace("v 2 0 0", "v 0.2 0.2 0").into_bytes(),
            "line 8: the face of 4 corners is not planar and convex",
        ),
        (OBJ.replace("v 2 1 0", "v 2 1 3").into_bytes(), "line 8: the face of 4 corners is not planar and convex"),
        (
            OBJ.replace("v 2 1 0", "v 2 1 0.6").into_bytes(),
            "line 8: the face of 4 corners is not planar and convex",
        ),
        (OBJ.replace("vn 0 0 1", "# units: cm").into_bytes(), "the file states the unit cm (valid: mm, in, m)"),
        (OBJ.replace("vn 0 0 1", "curv 0 1 1 2").into_bytes(), "line 7: 'curv' is not a statement of a mesh"),
        (OBJ.replace("vn 0 0 1", "# unit mm").into_bytes(), "states two units, in and mm"),
        (OBJ.replace("f 1/1/1 2//1 3 -1\n", "").into_bytes(), "no triangle"),
        (ply("4 0 1 2 3", "4 0 1 2 4"), "line 16: vertex 4 does not exist; the file has 4 vertices"),
        (ply("4 0 1 2 3", "4 0 1 2"), "line 16: a number is missing"),
        (ply("4 0 1 2 3", "4 0 1 2 3 3"), "line 16: more numbers than the header states"),
        (ply("2 1 0 9", "2 inf 0 9"), "line 14: a coordinate is infinite"),
        (ply("face 1", "edge 1"), "the second element is edge, expected 'face'"),
        (ply("vertex_indices", "texcoord"), "the list property 'texcoord' of the faces is not supported"),
        (PLY.to_owned().into_bytes().into_iter().chain(*b"7 7\n").collect(), "4 bytes follow the last face"),
        (cut_ply[..cut_ply.len() - 1].to_vec(), "face 1: the file ends here"),
        (ply("float x", "float u"), "field x: found none"),
    ];
    for (bytes, expected) in cases {
        let found = read_mesh(&bytes).expect_err(expected).to_string();
        assert!(found.contains(expected), "{found}\nshould say: {expected}");
    }
}

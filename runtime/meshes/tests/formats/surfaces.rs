//! Surfaces that are filled, parts that are placed, clouds as tables.

use piola_meshes::{Place, Surface, abaqus, cloud, stl};

/// The twelve triangles of the unit cube, the two of its lid last.
fn cube() -> Vec<[[f64; 3]; 3]> {
    let corner = |k: usize| [k & 1, k >> 1 & 1, k >> 2 & 1].map(|x| x as f64);
    let faces =
        [[0, 2, 3, 1], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6], [4, 5, 7, 6]];
    let halves = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]].map(|t| t.map(corner));
    faces.into_iter().flat_map(halves).collect()
}

pub(crate) fn text_cube() -> String {
    let mut text = "solid a cube\n".to_string();
    for triangle in cube() {
        text += " facet normal 0 0 0\n  outer loop\n";
        for [x, y, z] in triangle {
            text += &format!("   vertex {x} {y} {z:e}\n");
        }
        text += "  endloop\n endfacet\n";
    }
    text + "endsolid a cube\n"
}

pub(crate) fn binary_cube() -> Vec<u8> {
    binary(&cube())
}

fn binary(triangles: &[[[f64; 3]; 3]]) -> Vec<u8> {
    // A header that looks like text, as some programs write it.
    let mut bytes = b"solid ".to_vec();
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        let numbers = triangle.iter().flatten();
        bytes.extend(numbers.flat_map(|x| (*x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

#[test]
fn a_cube_is_filled_with_the_middles_of_its_cells() {
    let read = [stl::read(text_cube().as_bytes()).unwrap(), stl::read(&binary_cube()).unwrap()];
    assert_eq!(read[0], read[1]);
    for n in [1, 3, 10] {
        let filled = read[0].fill(1.0 / n as f64).unwrap().positions;
        assert_eq!(filled.len(), 3 * n * n * n);
        let expected = (0..n * n * n).flat_map(|k| [k / (n * n), k / n % n, k % n]);
        for (x, k) in filled.iter().zip(expected) {
            assert!((x - (k as f64 + 0.5) / n as f64).abs() < 1e-15, "{x}");
        }
    }
    // Of cells that do not fit, those whose middle is inside, the box in the middle of them.
    let filled = read[0].fill(0.4).unwrap().positions;
    assert_eq!(filled.len(), 3 * 27);
    assert!((filled[0] - 0.1).abs() < 1e-15);
}

/// A sphere of triangles between circles of latitude, whose poles are corners.
fn sphere(n: usize) -> Surface {
    let at = |i: usize, j: usize| {
        let polar = std::f64::consts::PI * i as f64 / n as f64;
        let around = std::f64::consts::PI * (j % (2 * n)) as f64 / n as f64;
        // The poles are one point, bit for bit.
        let sin = if i == 0 || i == n { 0.0 } else { libm::sin(polar) };
        [sin * libm::cos(around), sin * libm::sin(around), libm::cos(polar)]
    };
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..2 * n {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    Surface { triangles }
}

#[test]
fn a_sphere_has_its_volume_and_its_hollow() {
    let spacing = 0.05;
    let volume = |surface: &Surface| {
        let points = surface.fill(spacing).unwrap().positions;
        points.len() as f64 / 3.0 * spacing * spacing * spacing
    };
    let whole = sphere(40);
    let ball = 4.0 / 3.0 * std::f64::consts::PI;
    assert!((volume(&whole) / ball - 1.0).abs() < 0.01, "{}", volume(&whole));
    let mut hollow = whole.clone();
    let inner = whole.triangles.iter().map(|t| t.map(|corner| corner.map(|x| 0.5 * x)));
    hollow.triangles.extend(inner);
    assert!((volume(&hollow) / (ball * 0.875) - 1.0).abs() < 0.01, "{}", volume(&hollow));
    // The order of triangles does not matter, nor that a line meets edges and corners.
    let mut turned = hollow.clone();
    turned.triangles.reverse();
    assert_eq!(hollow.fill(spacing).unwrap(), turned.fill(spacing).unwrap());
}

#[test]
fn a_surface_says_what_it_encloses_and_where_it_is_inside_another() {
    let cube = Surface { triangles: cube() };
    assert_eq!(cube.volume(), 1.0);
    let moved = |scale: f64, by: f64| {
        let moved = cube.triangles.iter().map(|t| t.map(|corner| corner.map(|x| scale * x + by)));
        moved.collect::<Vec<_>>()
    };
    // Far away no digit is lost.
    assert_eq!(Surface { triangles: moved(1.0, 4096.0) }.volume(), 1.0);
    let with =
        |more: Vec<[[f64; 3]; 3]>| Surface { triangles: [cube.triangles.clone(), more].concat() };
    let nested = |surface: &Surface| surface.fill(0.1).unwrap().nested;
    assert_eq!(nested(&cube), None);
    let turned = |triangles: Vec<[[f64; 3]; 3]>| {
        triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect::<Vec<_>>()
    };
    // A hollow whose triangles look into it; one that looks outwards; two cubes that overlap.
    assert_eq!(nested(&with(turned(moved(0.5, 0.25)))), None);
    assert!((with(turned(moved(0.5, 0.25))).volume() - 0.875).abs() < 1e-15);
    for overlapping in [moved(0.5, 0.25), moved(1.0, 0.5)] {
        let surface = with(overlapping);
        assert!(surface.volume() > 1.0);
        let [x, y] = nested(&surface).unwrap();
        assert!([x, y].iter().all(|x| (0.25..1.0).contains(x)), "{x} {y}");
    }
    // Beside each other they touch, whichever way the triangles of both are read.
    let beside = moved(1.0, 0.0).into_iter().map(|t| t.map(|[x, y, z]| [x, y, z + 1.0])).collect();
    let touching = with(beside);
    assert_eq!(nested(&touching), None);
    assert_eq!(nested(&Surface { triangles: turned(touching.triangles) }), None);
}

const PARTS: &str = "\
*Heading
** two bricks
*Part, name=Brick
*Node
1, 0, 0, 0
2, 2, 0, 0
3, 2, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 2, 0, 1
7, 2, 1, 1
8, 0, 1, 1
*Element, type=C3D8R, elset=Body
11, 1, 2, 3, 4,
 5, 6, 7, 8
*Nset, nset=Bottom, generate
1, 4, 1
*Nset, nset=Gaps, generate
4, 900, 4
*Surface, name=Top
Body, S2
*Surface, name=Side
11, S6
*Element, type=SPRINGA, elset=Springs
12, 1, 2
*End Part
*Assembly, name=A
*Instance, name=One, part=Brick
*End Instance
*Instance, name=Two, part=Brick
0., 0., 1.
0., 0., 0., 0., 0., 1., 90.
*End Instance
*Nset, nset=Tip, instance=Two
7, 8
*Elset, elset=Whole, instance=One
Body, 12
*Node
1, 9, 9, 9
*Nset, nset=Reference, internal
1
*End Assembly
*Step
*Boundary
Bottom, 1, 3
";

#[test]
fn parts_stand_where_their_instances_put_them() {
    let mesh = abaqus::read(PARTS.as_bytes()).unwrap();
    let points = mesh.points(Place::Cells).unwrap();
    assert_eq!(points.volumes, [2.0, 2.0]);
    let near = |x: &[f64], y: [f64; 3]| x.iter().zip(y).all(|(x, y)| (x - y).abs() < 1e-15);
    assert!(near(&points.positions[..3], [1.0, 0.5, 0.5]), "{:?}", points.positions);
    assert!(near(&points.positions[3..], [-0.5, 1.0, 1.5]), "{:?}", points.positions);
    let members = |name: &str| mesh.members(name, &points);
    assert_eq!(members("Body"), Some(vec![true, true]));
    assert_eq!(members("two.bottom"), Some(vec![false, true]));
    assert_eq!(members("Tip"), Some(vec![false, true]));
    assert_eq!(members("whole"), Some(vec![true, false]));
    let corners = mesh.points(Place::Corners).unwrap();
    let counted = |name: &str| {
        let inside = mesh.members(name, &corners).unwrap();
        let xs = corners.positions.chunks(3).zip(inside).filter(|(_, inside)| *inside);
        xs.map(|(x, _)| x.to_vec()).collect::<Vec<_>>()
    };
    let top = counted("one.top");
    assert!(top.len() == 4 && top.iter().all(|x| x[2] == 1.0), "{top:?}");
    let side = counted("one.side");
    assert!(side.len() == 4 && side.iter().all(|x| x[0] == 0.0), "{side:?}");
    assert_eq!(counted("one.gaps").len(), 2);
    assert_eq!(corners.volumes, [0.25; 16]);
    let tip = mesh.members("Tip", &corners).unwrap();
    let place = tip.iter().position(|inside| *inside).unwrap();
    assert!(near(&corners.positions[3 * place..3 * place + 3], [-1.0, 2.0, 2.0]));
}

#[test]
fn clouds_become_tables_in_place() {
    let text =
        "# made by a program\nheader: x y block_id volume\n 0.5  1e-3 2 0.25\n\n1 2\t1 .5  \n";
    let table = cloud::as_table(text).unwrap();
    assert_eq!(
        table,
        "                   \n        x,y,block_id,volume\n 0.5, 1e-3,2,0.25\n\n1,2,1,.5  \n"
    );
    let peridigm = cloud::as_table("# x y z block_id volume\n0 0 0 1 1\n").unwrap();
    assert_eq!(peridigm, "  x,y,z,block_id,volume\n0,0,0,1,1\n");
    assert!(cloud::is_comma_separated("x,y,volume\n") && cloud::is_comma_separated(""));
    assert!(!cloud::is_comma_separated("# x y, z\n0 0 0\n"));
    let numbers = cloud::read_numbers("header: global_id\n1 4\n# not 9\n2,\n", 4).unwrap();
    assert_eq!(numbers, [0, 3, 1]);
}

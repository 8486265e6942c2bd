//! Meshes that Gmsh wrote, against what Gmsh says of them (`tests/data/make.py`).

// A file has one mistake that is told: its size does not matter.
#![allow(clippy::result_large_err)]

mod broken;
mod surfaces;

use std::path::PathBuf;

use piola_meshes::{Mesh, MeshPoints, Place, abaqus, gmsh};
use serde_json::Value;

pub(crate) fn data(name: &str) -> Vec<u8> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn facts(name: &str) -> Value {
    serde_json::from_slice(&data(&format!("{name}.json"))).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// Volumes and centres of all cells, to `tolerance` of the largest volume and coordinate.
fn check_cells(points: &MeshPoints, facts: &Value, tolerance: f64, name: &str) {
    let cells = facts["cells"].as_array().unwrap();
    assert_eq!(points.volumes.len(), cells.len(), "{name}");
    let largest = cells.iter().map(|c| c["volume"].as_f64().unwrap()).fold(0.0, f64::max);
    let d = points.dimension;
    assert_eq!(d as u64, facts["dimension"].as_u64().unwrap(), "{name}");
    for (k, cell) in cells.iter().enumerate() {
        let volume = cell["volume"].as_f64().unwrap();
        let off = (points.volumes[k] - volume).abs() / largest;
        assert!(off <= tolerance, "{name}, cell {k}: {} and {volume}", points.volumes[k]);
        for (axis, x) in numbers(&cell["centre"])[..d].iter().enumerate() {
            let own = points.positions[k * d + axis];
            assert!((own - x).abs() <= 2.0 * tolerance, "{name}, cell {k}: {own} and {x}");
        }
    }
}

/// Of every group how many points at corners it has: its nodes that are corners of cells.
fn check_groups(mesh: &Mesh, facts: &Value, name: &str) {
    let points = mesh.points(Place::Corners).unwrap();
    let cells = mesh.points(Place::Cells).unwrap();
    let total = |volumes: &[f64]| volumes.iter().sum::<f64>();
    assert!((total(&points.volumes) / total(&cells.volumes) - 1.0).abs() < 1e-14, "{name}");
    let is_first_order = !name.ends_with(['8', '9', '0', '7'])
        && !["tri6", "wedge15", "pyramid13", "pyramid14"].contains(&name)
        || name == "hex8";
    for (group, about) in facts["groups"].as_object().unwrap() {
        let inside = mesh.members(group, &points).unwrap_or_else(|| panic!("{name}: no {group}"));
        let count = inside.iter().filter(|inside| **inside).count();
        let nodes = about["nodes"].as_array().unwrap().len();
        assert!(count > 0 && count <= nodes, "{name}, {group}: {count} of {nodes}");
        if is_first_order {
            assert_eq!(count, nodes, "{name}, {group}");
        }
        let cells_inside = mesh.members(group, &cells).unwrap();
        let count = cells_inside.iter().filter(|inside| **inside).count();
        let is_of_cells =
            about["dimension"] == facts["dimension"] && !["inner", "outer"].contains(&&group[..]);
        assert!(count > 0, "{name}, {group}");
        assert_eq!(count == cells.volumes.len(), is_of_cells, "{name}, {group}: {count}");
    }
    assert_eq!(mesh.members("no such group", &points), None);
}

const KINDS: [&str; 16] = [
    "tet4",
    "tet10",
    "hex8",
    "hex20",
    "hex27",
    "wedge6",
    "wedge15",
    "wedge18",
    "pyramid5",
    "pyramid13",
    "pyramid14",
    "tri3",
    "tri6",
    "quad4",
    "quad8",
    "quad9",
];

#[test]
fn every_kind_has_the_volume_and_centre_that_gmsh_integrates() {
    for name in KINDS {
        let mesh = gmsh::read(&data(&format!("{name}.41a.msh")))
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let facts = facts(name);
        check_cells(&mesh.points(Place::Cells).unwrap(), &facts, 1e-13, name);
        check_groups(&mesh, &facts, name);
    }
}

#[test]
fn both_versions_and_ways_to_write_are_the_same_mesh() {
    for name in ["tet4", "tet10", "hex8", "tri3"] {
        let read = |format: &str| {
            gmsh::read(&data(&format!("{name}.{format}.msh")))
                .unwrap_or_else(|error| panic!("{name}.{format}: {error}"))
        };
        let facts = facts(name);
        for format in ["22a", "22b", "41a", "41b"] {
            let mesh = read(format);
            check_cells(&mesh.points(Place::Cells).unwrap(), &facts, 1e-13, name);
            check_groups(&mesh, &facts, name);
        }
        let positions = |format: &str| read(format).points(Place::Corners).unwrap().positions;
        // Text has sixteen digits, binary all.
        assert!(positions("22a") == positions("41a") && positions("22b") == positions("41b"));
    }
}

#[test]
fn abaqus_has_the_same_cells() {
    for name in
        ["tet4", "tet10", "hex8", "hex20", "wedge6", "wedge15", "tri3", "tri6", "quad4", "quad8"]
    {
        let mesh = abaqus::read(&data(&format!("{name}.inp")))
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let facts = facts(name);
        // Coordinates have fourteen digits there.
        check_cells(&mesh.points(Place::Cells).unwrap(), &facts, 1e-12, name);
    }
    let error = abaqus::read(&data("quad9.inp")).and_then(|mesh| mesh.points(Place::Cells));
    assert!(error.is_err());
}

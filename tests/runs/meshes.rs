//! Bodies from files of other programs: meshes with groups, surfaces that are filled, clouds with blocks.

use std::fs;

use crate::support::frames::{read_pvd, read_vtu};
use crate::support::{SceneFolder, piola, repository, stl_cube, table};

/// The scene of the ring with its mesh.
fn ring(more: &str) -> SceneFolder {
    let folder = SceneFolder::new(&(example("scene.toml") + more));
    folder.file("ring.msh", example("ring.msh"));
    folder
}

fn example(name: &str) -> String {
    fs::read_to_string(repository("examples/ring").join(name)).unwrap()
}

/// Lame: of plane strain with lambda = mu the outside follows by 2/3 where the radii are as 2 to 1.
#[test]
fn a_ring_of_triangles_widens_as_in_the_textbook() {
    for (nodes, horizon, tolerance) in
        [("corners", 2.5, 0.012), ("corners", 2.0, 0.012), ("cells", 3.0, 0.07)]
    {
        let folder = ring("");
        let overrides = [format!("body.nodes={nodes}"), format!("horizon.spacings={horizon}")];
        folder.run(&["--set", &overrides[0], "--set", &overrides[1]]).expect(0);
        let (_, rows) = table(&folder.out().join("probes.csv"));
        let outside = rows.last().unwrap()[1] / 1e-5;
        assert!((outside - 2.0 / 3.0).abs() < tolerance, "{nodes}, {horizon}: {outside}");
        let resolved = fs::read_to_string(folder.out().join("scene.resolved.toml")).unwrap();
        assert!(resolved.contains("bore = { group = \"bore\" }"), "{resolved}");
        let again = SceneFolder::new(&resolved);
        again.file("ring.msh", example("ring.msh"));
        again.run(&[]).expect(0);
        assert_eq!(table(&again.out().join("probes.csv")).1, rows);
    }
}

#[test]
fn frames_show_the_cells_of_a_mesh() {
    let corners = ring("");
    corners.run(&[]).expect(0);
    let list = fs::read_to_string(corners.out().join("run.pvd")).unwrap();
    assert_eq!(read_pvd(&list).unwrap().len(), 3);
    assert!(!list.contains("cells_"));
    let cells = ring("");
    cells.run(&["--set", "body.nodes=cells", "--set", "body.remove=[\"X < 0\"]"]).expect(0);
    let list = read_pvd(&fs::read_to_string(cells.out().join("run.pvd")).unwrap()).unwrap();
    let names: Vec<&str> = list.iter().map(|(_, file)| file.as_str()).collect();
    assert_eq!(names[2..4], ["frames/frame_000001.vtu", "frames/cells_000001.vtu"]);
    let points = read_vtu(&cells.out().join(names[2])).unwrap();
    let n = points.array("volume").unwrap().values.len();
    let parts = fs::read(cells.out().join(names[3])).unwrap();
    let header = String::from_utf8_lossy(&parts[..parts.len().min(4000)]).into_owned();
    assert!(header.contains(&format!("NumberOfCells=\"{n}\"")), "{header}");
    let cell_data = header.split("<CellData>").nth(1).unwrap();
    assert!(cell_data.contains("Name=\"residual\"") && cell_data.contains("Name=\"volume\""));
    assert!(!header.contains(&format!("NumberOfPoints=\"{n}\"")));
}

/// The unit cube as a text STL.
fn cube() -> String {
    stl_cube(0.0, 1.0)
}

const CUBE: &str = "[horizon]\nspacings = 2\n[material]\npotential = \"javili2020\"\n\
    parameters = { C1 = 1.0 }\n[sets]\nleft = \"X < 0.00026\"\nright = \"X > 0.00074\"\n\
    [[prescribe]]\nset = \"left\"\nu = [0, 0, 0]\n[[prescribe]]\nset = \"right\"\n\
    u = [\"1e-4*t\", 0, 0]\n[steps]\nincrements = 1\n";

#[test]
fn a_filled_surface_is_the_lattice_of_its_box() {
    let of = |body: &str| {
        let folder = SceneFolder::new(&format!("[body]\n{body}{CUBE}"));
        folder.file("cube.stl", cube());
        folder
    };
    let surface = of("mesh = \"cube.stl\"\nunit = \"mm\"\nspacing = 1.25e-4\n");
    let lattice = of("box = [[0, 0, 0], [1e-3, 1e-3, 1e-3]]\nspacing = 1.25e-4\n");
    for folder in [&surface, &lattice] {
        folder.run(&[]).expect(0);
    }
    let reactions = |folder: &SceneFolder| table(&folder.out().join("reactions.csv")).1;
    let (a, b) = (reactions(&surface), reactions(&lattice));
    let largest = b.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (x, y) in a.iter().flatten().zip(b.iter().flatten()) {
        assert!((x - y).abs() <= 1e-9 * largest, "{x} {y}");
    }
    // Moduli are those of the lattice.
    let moduli = |folder: &SceneFolder| piola(&["moduli", &folder.scene()]).expect(0).stdout;
    assert_eq!(moduli(&surface), moduli(&lattice));
    // Cells that do not fit have another volume; a cube inside the cube is a hollow, and may not be meant.
    let plan = |folder: &SceneFolder, more: &[&str]| {
        piola(&[&["plan", &folder.scene()][..], more].concat()).expect(0).stderr
    };
    assert!(!plan(&surface, &[]).contains("surface-volume"));
    let coarse = plan(&surface, &["--set", "body.spacing=4e-4"]);
    let words =
        ["[surface-volume]", "1.7280e-9 m^3", "encloses 1.0000e-9 m^3", "smaller `spacing`"];
    assert!(words.iter().all(|word| coarse.contains(word)), "{coarse}");
    surface.file("cube.stl", cube() + &stl_cube(0.25, 0.75));
    let nested = plan(&surface, &[]);
    assert!(nested.contains("[surface-volume]") && nested.contains("goes in twice"), "{nested}");
    let open =
        cube().replacen("facet normal 0 0 0\nouter loop\nvertex 0 0 1", "endsolid\nsolid", 1);
    surface.file("cube.stl", open);
    surface.run(&["--force"]).expect(2);
    let open: Vec<String> = cube().split("facet normal").take(12).map(String::from).collect();
    surface.file("cube.stl", open.join("facet normal") + "endsolid cube\n");
    surface.run(&["--force"]).expect(2).says(&["cube.stl", "not closed", "two triangles"]);
}

/// Eight by four points with two blocks, as PeriLab writes them and as a table between commas.
#[test]
fn clouds_of_other_programs_are_those_of_a_table() {
    let (mut cloud, mut table_of) = ("header: x y block_id volume E\n".to_string(), String::new());
    table_of += "x,y,volume,E\n";
    for k in 0..32 {
        let (x, y) = (f64::from(k / 4) + 0.5, f64::from(k % 4) + 0.5);
        let (block, stiffness) = if k < 16 { (1, 2.0) } else { (2, 3.0) };
        cloud += &format!("{x}  {y}\t{block} 1.0 {stiffness}\n");
        table_of += &format!("{x},{y},1,{stiffness}\n");
    }
    let scene = |points: &str, sets: &str, left: &str| {
        let folder = SceneFolder::new(&format!(
            "[body]\ndimension = 2\npoints = \"{points}\"\n[horizon]\nspacings = 2.1\n\
             [[material]]\nset = \"{left}\"\npotential = \"javili2020\"\nparameters = {{ C1 = 1.0 }}\n\
             [[material]]\nname = \"rest\"\npotential = \"javili2020\"\nparameters = {{ C1 = \"E\" }}\n\
             [sets]\n{sets}\n[[prescribe]]\nset = \"foot\"\nu = [0, 0]\n[[prescribe]]\n\
             set = \"head\"\nu = [\"0.1*t\", 0]\n[steps]\nincrements = 1\n"
        ));
        folder.file("cloud.txt", &cloud);
        folder.file("cloud.csv", &table_of);
        folder.file("foot.txt", "# nodes\n1 2\n3\n4\n");
        folder.run(&[]);
        folder
    };
    let perilab =
        scene("cloud.txt", "foot = { numbers = \"foot.txt\" }\nhead = \"X > 7\"", "block_1");
    let plain = scene("cloud.csv", "foot = \"X < 1\"\nhead = \"X > 7\"\nown = \"X < 4\"", "own");
    let displacements =
        |folder: &SceneFolder| fs::read_to_string(folder.out().join("displacement.csv")).unwrap();
    assert_eq!(displacements(&perilab), displacements(&plain));
    perilab.file("foot.txt", "1 2 33\n");
    perilab
        .run(&["--force"])
        .expect(2)
        .says(&["foot.txt:1:5", "`33` is no number of a point from 1 to 32"]);
    let fewer = cloud.replace("header: x", "header: q");
    perilab.file("cloud.txt", fewer);
    perilab.run(&["--force"]).expect(2).says(&["cloud.txt:1:", "there is no column `x`"]);
    perilab.file("cloud.txt", "1 2 1 1\n");
    perilab.run(&["--force"]).expect(2).says(&[
        "cloud.txt:1:1",
        "names the columns",
        "write `header:",
    ]);
}

#[test]
fn mistakes_about_meshes_name_the_way_out() {
    let told = |overrides: &[&str], says: &[&str]| {
        let folder = ring("");
        let sets: Vec<&str> = overrides.iter().flat_map(|o| ["--set", o]).collect();
        folder.run(&sets).expect(2).says(says);
    };
    told(&["prescribe.0.set=bor"], &["no group `bor`", "did you mean `bore`?"]);
    told(&["prescribe.0.set=clamp"], &["no group `clamp`", "its groups are outside, bore, ring"]);
    told(&["prescribe.0.set=top face"], &["clamp = { group = \"top face\" }"]);
    told(&["body.mesh=none.msh"], &["cannot read", "none.msh"]);
    told(&["body.mesh=ring.vtk"], &["unknown-mesh", ".inp (Abaqus)"]);
    told(&["body.spacing=0.1"], &["`spacing` fills a surface"]);
    told(&["body.unit=kg"], &["write unit = \"mm\""]);
    told(&["body.unit=1e-200"], &["look at `unit`"]);
    let flat = SceneFolder::new(
        "[body]\ndimension = 3\nmesh = \"ring.msh\"\n[horizon]\nspacings = 3\n[material]\n\
         potential = \"javili2020\"\n",
    );
    flat.file("ring.msh", example("ring.msh"));
    piola(&["plan", &flat.scene()]).expect(2).says(&["write dimension = 2"]);
    let lattice = "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n[horizon]\nspacings = 3\n\
        [material]\npotential = \"javili2020\"\n[sets]\nleft = { group = \"left\" }\n";
    SceneFolder::new(lattice).run(&[]).expect(2).says(&["groups are of meshes and clouds"]);
    let both = SceneFolder::new(&lattice.replace("[horizon]", "mesh = \"a.msh\"\n[horizon]"));
    both.run(&[]).expect(2).says(&["`box`", "`mesh`"]);
    let cut = ring("");
    let whole = example("ring.msh");
    cut.file("ring.msh", &whole[..5000]);
    cut.run(&[]).expect(2).says(&["ring.msh:19:6", "826 nodes are announced, and 4608 bytes"]);
    cut.file("ring.msh", &whole[..whole.len() - 5000]);
    cut.run(&["--force"]).expect(2).says(&["ring.msh:", "the file ends where", "it was cut"]);
    cut.file("ring.msh", noise());
    cut.run(&["--force"]).expect(2).says(&["ring.msh", "does not begin with $MeshFormat"]);
}

fn noise() -> Vec<u8> {
    let mut state = 1u32;
    (0..4096)
        .map(|_| {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            (state >> 24) as u8
        })
        .collect()
}

/// The points of a group keep their places where others are removed before them.
#[test]
fn groups_follow_removed_points() {
    let folder = ring("\n[sets]\nrim = { group = \"outside\" }\nfar = \"X^2 + Y^2 > 0.01999^2\"\n");
    folder.run(&["--set", "body.remove=[\"X < 0.001\"]"]).expect(0);
    let (names, rows) = table(&folder.out().join("reactions.csv"));
    let column = |name: &str| {
        let place = names.iter().position(|own| own == name).unwrap();
        rows.iter().map(|row| row[place]).collect::<Vec<f64>>()
    };
    // The outside is free: what is left there is the residual, point by point the same.
    assert_eq!(column("rim_x"), column("far_x"));
    let resolved = fs::read_to_string(folder.out().join("scene.resolved.toml")).unwrap();
    assert!(resolved.contains("rim = { group = \"outside\" }"), "{resolved}");
}

//! Broken files: each has a place and a reason, none ends the program or takes memory that it does not
//! have.

use piola_meshes::{MeshError, Place, abaqus, cloud, gmsh, stl};

use crate::data;
use crate::surfaces::{binary_cube, text_cube};

const FILES: [&str; 10] = [
    "tet4.22a.msh",
    "tet4.22b.msh",
    "tet4.41a.msh",
    "tet4.41b.msh",
    "tri3.22b.msh",
    "hex8.41b.msh",
    "quad8.41a.msh",
    "tet4.inp",
    "hex20.inp",
    "tri3.inp",
];

/// The file read and made into points, by the end of its name.
fn read(name: &str, bytes: &[u8]) -> Result<usize, MeshError> {
    let mesh = match name.ends_with(".inp") {
        true => abaqus::read(bytes)?,
        false => gmsh::read(bytes)?,
    };
    Ok(mesh.points(Place::Cells)?.volumes.len())
}

fn check_told(error: &MeshError, length: usize) {
    let diagnostic = &error.diagnostic;
    assert!(!diagnostic.message.is_empty());
    assert!(diagnostic.span.range().end <= length, "{error}: beyond the file");
}

#[test]
fn files_that_are_cut_are_refused() {
    let mut tried = 0;
    for name in FILES {
        let whole = data(name);
        let n = read(name, &whole).unwrap();
        let end = whole.trim_ascii_end().len();
        for cut in (0..end).step_by(end.div_ceil(61)) {
            match read(name, &whole[..cut]) {
                Err(error) => check_told(&error, cut),
                // An input file has no end of its own: fewer cells, or sets that are shorter.
                Ok(cells) => assert!(name.ends_with(".inp") && cells <= n, "{name} cut at {cut}"),
            }
            tried += 1;
        }
    }
    assert!(tried >= 500, "{tried}");
}

#[test]
fn noise_is_survived() {
    let mut state = 7u64;
    let mut next = |below: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % below
    };
    for name in FILES {
        let whole = data(name);
        for _ in 0..200 {
            let mut noisy = whole.clone();
            for _ in 0..1 + next(4) {
                let place = next(noisy.len());
                noisy[place] = next(256) as u8;
            }
            if let Err(error) = read(name, &noisy) {
                check_told(&error, noisy.len());
            }
        }
        let noise: Vec<u8> = (0..5000).map(|_| next(256) as u8).collect();
        let error = read(name, &noise).unwrap_err();
        check_told(&error, noise.len());
    }
}

/// A text mesh of version 2.2 with one triangle and a replacement in it.
fn check(from: &str, to: &str, line: usize, reason: &str) {
    const WHOLE: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 1 \"sheet\"\n\
        $EndPhysicalNames\n$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n$Elements\n1\n\
        5 2 2 1 1 1 2 3\n$EndElements\n";
    assert!(gmsh::read(WHOLE.as_bytes()).unwrap().points(Place::Cells).is_ok());
    let text = WHOLE.replacen(from, to, 1);
    assert_ne!(text, WHOLE);
    check_line("sheet.msh", &text, line, reason);
}

/// A mistake in a text is named at its line.
fn check_line(name: &str, text: &str, line: usize, reason: &str) {
    let error = read(name, text.as_bytes()).expect_err(text);
    let place = error.diagnostic.span.range().start;
    assert!(error.to_string().contains(reason), "{error}");
    assert_eq!(text[..place].matches('\n').count() + 1, line, "{error}");
}

#[test]
fn mistakes_in_meshes_are_named_at_their_line() {
    check("$MeshFormat", "$NoFormat", 1, "does not begin with $MeshFormat");
    check("2.2 0 8", "4.0 0 8", 2, "version 4.0 of the format is not read; save it as");
    check("2.2 0 8", "2.2 0 4", 2, "numbers have 4 bytes");
    check("2.2 0 8", "2.2 7 8", 2, "text is 0 and binary 1");
    check("2 1 \"sheet\"", "2 1 sheet", 6, "in quotes");
    check(
        "$Nodes\n3\n",
        "$Nodes\n4\n",
        13,
        "the number of a node should stand here, a whole number",
    );
    check("$Nodes\n3\n", "$Nodes\n2\n", 12, "`$EndNodes` should stand here");
    check("$Nodes\n3\n", "$Nodes\n1000000000\n", 9, "1000000000 nodes are announced");
    check("$Nodes\n3\n", "$Nodes\n-3\n", 9, "not `-3`");
    check("2 1 0 0", "2 1 0", 11, "the line ends where a coordinate of a node should stand");
    check("2 1 0 0", "2 1 nan 0", 11, "must be a finite number");
    check("2 1 0 0", "2 1 x 0", 11, "a number, not `x`");
    check("2 1 0 0", "1 1 0 0", 11, "two nodes 1");
    check("3 0 1 0", "3 2 0 0", 16, "element 5 has no area");
    check("3 0 1 0", "3 0 1 1", 16, "a surface in space");
    check("1 1 1 2 3", "1 1 1 2 4", 16, "a node 4, and there is none");
    check(
        "5 2 2 1 1 1 2 3",
        "5 2 2 1 1 1 2",
        16,
        "the line ends where a node of an element should stand",
    );
    check("5 2 2 1 1 1 2 3", "5 21 2 1 1 1 2 3", 16, "elements of type 21 are not read");
    check("5 2 2 1 1 1 2 3", "5 1 2 1 1 1 2", 1, "no cells");
    check("5 2 2 1 1", "5 2 999999999 1 1", 16, "999999999 groups are announced");
    check("$Elements\n1\n", "$Elements\n9999999999999\n", 15, "are announced");
    check("$EndElements\n", "", 17, "ends where `$EndElements` should stand");
    check("$Nodes\n3", "$PartitionedEntities\n$Nodes\n3", 8, "cut into parts");
}

fn check_input(text: &str, line: usize, reason: &str) {
    check_line("part.inp", text, line, reason);
}

#[test]
fn mistakes_in_input_files_are_named_at_their_line() {
    const NODES: &str = "*Node\n1, 0, 0\n2, 1, 0\n3, 0, 1\n";
    let with = |rest: &str| format!("{NODES}{rest}");
    check_input("1, 2, 3\n", 1, "does not begin with a keyword");
    check_input("*Heading\n a bar\n", 3, "has no nodes");
    check_input("*Node\n1, 0, a\n", 2, "a coordinate of a node should stand here, not `a`");
    check_input("*Node\nx, 0, 0\n", 2, "the number of a node should stand here, not `x`");
    check_input("*Node\n1, 0, 0\n1, 1, 0\n", 3, "two nodes 1");
    check_input("*Node, system=C\n1, 0, 0\n", 1, "not rectangular");
    check_input("*Node, input=a.txt\n", 1, "what stands elsewhere");
    check_input("*Include, input=a.inp\n", 1, "what stands elsewhere");
    check_input(&with("*Element\n1, 1, 2, 3\n"), 5, "`*element` has no `type=`");
    check_input(&with("*Element, type=CPS3\n1, 1, 2\n"), 6, "2 nodes instead of 3");
    check_input(&with("*Element, type=CPS3\n1, 1, 2,\n*End\n"), 6, "2 nodes instead of 3");
    check_input(&with("*Element, type=CPS3\n1, 1, 2, 3, 1\n"), 6, "more than 3 nodes");
    check_input(&with("*Element, type=CPS3\n1, 1, 2, 7\n"), 6, "a node 7, and there is none");
    check_input(&with("*Element, type=CPS3\n1, 1, 2, 2\n"), 6, "no area");
    check_input(
        &with("*Element, type=B21\n1, 1, 2\n"),
        7,
        "types B21 are not read; write solids as",
    );
    check_input(
        &with("*Element, type=C3D27\n1, 1, 2\n"),
        5,
        "type C3D27 are not read; write solids",
    );
    let whole = with("*Element, type=CPS3, elset=all\n1, 1, 2, 3\n");
    let with = |rest: &str| format!("{whole}{rest}");
    check_input(&with("*Nset, nset=a\n1, 9\n"), 8, "no node 9");
    check_input(&with("*Nset, nset=a\nb\n"), 8, "`b` is no number, and no set before");
    check_input(
        &with("*Elset, elset=a, generate\n5, 900000000, 5\n"),
        8,
        "no element from 5 to 900000000",
    );
    check_input(
        &with("*Surface, name=a\nall, S4\n"),
        8,
        "`S4` is no face of this element: S1 to S3",
    );
    check_input(&with("*Elset, elset=a, generate\n1, 1, 0\n"), 8, "a positive step");
    check_input(&with("*Elset\n1\n"), 7, "`*elset` has no `elset=`");
    check_input(&with("*Instance, name=i, part=p\n"), 7, "no part `p`");
    check_input(&with("*Nset, nset=a, instance=i\n"), 7, "no instance `i`");
}

#[test]
fn broken_surfaces_are_refused() {
    let told = |bytes: &[u8], reason: &str| {
        let read = stl::read(bytes).and_then(|surface| surface.fill(0.25));
        let error = read.expect_err(reason);
        check_told(&error, bytes.len());
        assert!(error.to_string().contains(reason), "{error}");
    };
    let (text, binary) = (text_cube(), binary_cube());
    told(b"", "neither text");
    told(b"solid a\nendsolid a\n", "no triangles");
    told(b"solid a\n facet normal 0 0 1\n", "the file ends where `outer` should stand");
    told(text.replacen("vertex", "vertices", 1).as_bytes(), "`vertex` should stand here");
    told(text.replacen("vertex 0", "vertex a", 1).as_bytes(), "a number, not `a`");
    told(&binary[..binary.len() - 1], "12 triangles are announced");
    let mut many = binary.clone();
    many[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    told(&many, "4294967295 triangles are announced");
    let mut infinite = binary.clone();
    infinite[84 + 12..84 + 16].copy_from_slice(&f32::INFINITY.to_le_bytes());
    told(&infinite, "a coordinate of triangle 1 is inf");
    // Without its lid.
    let mut open = binary.clone();
    open.truncate(binary.len() - 100);
    open[80] = 10;
    told(&open, "not closed");
    for cut in (0..text.trim_end().len()).step_by(41) {
        check_told(&stl::read(&text.as_bytes()[..cut]).unwrap_err(), cut);
    }
}

#[test]
fn broken_clouds_are_refused() {
    let error = cloud::as_table("\n0 0 0 1 1e-3\n").unwrap_err();
    assert!(
        error.to_string().contains("no line before this one names the columns; write `header:")
    );
    assert_eq!(error.diagnostic.span.range(), 1..13);
    for (text, place, word) in [("1 2\n5\n", 4, "`5`"), ("1, x", 3, "`x`"), ("0", 0, "`0`")] {
        let error = cloud::read_numbers(text, 4).unwrap_err();
        assert_eq!(error.diagnostic.span.range().start, place, "{error}");
        assert!(error.to_string().contains(word) && error.to_string().contains("from 1 to 4"));
    }
}

proptest::proptest! {
    #[test]
    fn no_input_file_makes_the_reader_panic(
        text in "(\\*Node|\\*Element, type=CPS3|\\*Nset, nset=a|\\*Part, name=p|\\*Instance, name=i, part=p|[0-9 ,.\n]|é){0,40}"
    ) {
        let _ = abaqus::read(text.as_bytes()).and_then(|mesh| mesh.points(Place::Cells));
    }

    #[test]
    fn tables_of_clouds_keep_every_place(text in "(header:|#|x|volume|[0-9. \t\n\r]|é){0,60}") {
        if let Ok(table) = cloud::as_table(&text) {
            assert_eq!(table.len(), text.len());
        }
        let _ = cloud::read_numbers(&text, 10);
    }
}

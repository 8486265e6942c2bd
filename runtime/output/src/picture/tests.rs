//! The pictures are decoded and looked at: size, blankness, colours, labels, well-formed XML.

use std::collections::HashSet;

use piola_mechanics::energy::EnergyParts;
use piola_mechanics::interaction::Inverted;

use super::*;
use crate::{Definiteness, StepRecord};

/// A box on a lattice with `n` points along each axis, stretched along x, thinner across.
fn stretched(n: [usize; 3], dimension: usize, stretch: f64) -> (Points, Frame, Vec<NamedPoints>) {
    let spacing = 0.05;
    let mut positions = Vec::new();
    let mut displacement = Vec::new();
    let (mut left, mut right) = (Vec::new(), Vec::new());
    let length = (n[0] - 1) as f64 * spacing;
    for i in 0..n[0] {
        for j in 0..n[1] {
            for k in 0..if dimension == 3 { n[2] } else { 1 } {
                let x = [i, j, k].map(|m| m as f64 * spacing);
                let point = positions.len() / dimension;
                let s = x[0] / length;
                let squeeze = -0.4 * stretch * 4.0 * s * (1.0 - s);
                let middle = [0.0, (n[1] - 1) as f64, (n[2] - 1) as f64].map(|m| m * spacing / 2.0);
                let u =
                    [stretch * x[0], squeeze * (x[1] - middle[1]), squeeze * (x[2] - middle[2])];
                positions.extend_from_slice(&x[..dimension]);
                displacement.extend_from_slice(&u[..dimension]);
                if i < 3 {
                    left.push(point);
                } else if i + 3 >= n[0] {
                    right.push(point);
                }
            }
        }
    }
    let n_points = positions.len() / dimension;
    let volumes = vec![libm::pow(spacing, dimension as f64); n_points];
    let points = Points {
        dimension,
        positions,
        volumes,
        spacing: Some(spacing),
        mesh: None,
        held: Vec::new(),
    };
    let residual = vec![0.0; displacement.len()];
    let frame = Frame { t: 1.0, displacement, residual, velocity: Vec::new(), fields: Vec::new() };
    let named = |name: &str, points| NamedPoints { name: name.to_owned(), points };
    (points, frame, vec![named("left", left), named("right", right)])
}

#[test]
fn cells_that_are_held_are_not_drawn_as_bent() {
    let (mut points, mut frame, sets) = stretched([9, 5, 1], 2, 0.5);
    // The left end stands still, and what is beside it is thinner already.
    for &point in &sets[0].points {
        frame.displacement[2 * point..2 * point + 2].fill(0.0);
    }
    let corners = |points: &Points| {
        let displacement = &frame.displacement;
        let sets = vec![0; points.n_points()];
        let motion =
            motion::Motion { points, displacement, magnification: 1.0, colours: None, sets };
        let cells = cells::Cells::new(&motion, 0.05, MOST_SHAPES);
        let edges = cells.edges();
        let moved = |edge: &cells::Edge| {
            let pairs = edge.reference.iter().zip(&edge.current);
            pairs
                .flat_map(|(x, y)| [0, 1].map(|axis| (x[axis] - y[axis]).abs()))
                .fold(0.0, f64::max)
        };
        let of_left = |edge: &&cells::Edge| edge.reference.iter().all(|end| end[0] < 0.126);
        edges.iter().filter(of_left).map(moved).fold(0.0, f64::max)
    };
    assert!(corners(&points) > 1e-3);
    points.held = (0..points.n_points()).map(|point| sets[0].points.contains(&point)).collect();
    assert!(corners(&points) < 1e-15);
}

#[test]
fn a_held_layer_of_one_cell_turns_as_a_whole() {
    for dimension in [2, 3] {
        let (mut points, mut frame, _) = stretched([5, 4, 4], dimension, 0.0);
        // The last layer turns by a quarter about z.
        let positions = points.positions.clone();
        let is_last = |x: &[f64]| x[0] > 0.19;
        points.held = positions.chunks(dimension).map(is_last).collect();
        let turned = |x: &[f64]| [0.2 - x[1], x[0] - 0.2];
        for (x, u) in positions.chunks(dimension).zip(frame.displacement.chunks_mut(dimension)) {
            if is_last(x) {
                let at = turned(x);
                (0..2).for_each(|axis| u[axis] = at[axis] - x[axis]);
            }
        }
        let displacement = &frame.displacement;
        let sets = vec![0; points.n_points()];
        let motion = motion::Motion {
            points: &points,
            displacement,
            magnification: 1.0,
            colours: None,
            sets,
        };
        let cells = cells::Cells::new(&motion, 0.05, MOST_SHAPES);
        let facets = cells.facets();
        let (mut n, spacing) = (0, 0.05);
        for facet in &facets {
            // Of the outermost: all sides of a square.
            let all_last =
                facet.corners.iter().all(|corner| corner[1] > -0.026 && corner[0] < 0.251);
            let sides = (0..4).map(|k| {
                let pair = [facet.corners[k], facet.corners[(k + 1) % 4]];
                let squares = [0, 1, 2]
                    .map(|axis| (pair[0][axis] - pair[1][axis]) * (pair[0][axis] - pair[1][axis]));
                squares.iter().sum::<f64>().sqrt()
            });
            let held = points.held[facet.cell];
            if held && all_last && facet.outward.is_none_or(|normal| normal[1].abs() > 1e-9) {
                n += 1;
                for side in sides {
                    assert!((side - spacing).abs() < 1e-12, "{dimension}: {:?}", facet.corners);
                }
            }
        }
        assert!(n >= 4, "{n}");
    }
}

#[test]
fn a_field_without_a_finite_number_is_drawn_as_none() {
    let (points, frame, _) = stretched([3, 3, 1], 2, 0.1);
    let colour = Colour { name: "state".to_owned(), unit: "", values: vec![f64::NAN; 9] };
    let charts = Charts::Times { energies: &[], probes: &[] };
    let colour = Some(&colour);
    let picture = Picture {
        title: "",
        points: &points,
        n_points: points.n_points(),
        frame: &frame,
        sets: &[],
        colour,
        charts,
    };
    let svg = picture.to_svg();
    assert!(svg.contains("not finite and left out: 9"), "{svg}");
}

/// A run with quadratic convergence and a bending reaction curve.
fn history(dimension: usize, n_steps: usize) -> History {
    let sets = vec!["left".to_owned(), "right".to_owned()];
    let mut history = History::new(dimension, Vec::new(), sets, Vec::new());
    for step in 1..=n_steps {
        let t = step as f64 / n_steps as f64;
        let force = 3.2e4 * t / (0.6 + t);
        let mut right = vec![0.0; dimension];
        right[0] = force;
        let left: Vec<f64> = right.iter().map(|r| -r).collect();
        let mut residual = vec![0.4 * (1.5 - t)];
        while residual.last().is_some_and(|&r| r > 1e-11) {
            let last: f64 = residual[residual.len() - 1];
            residual.push(0.3 * last * last * (1.0 + t));
        }
        history.push(StepRecord {
            t,
            iterations: residual.len() - 1,
            residual: residual.iter().map(|r| r * force).collect(),
            residual_over_reaction: residual,
            energy_parts: EnergyParts::default(),
            forces: vec![left.clone(), right.clone()],
            moved: vec![vec![0.0; dimension]; 2],
            reactions: vec![left, right],
            probes: Vec::new(),
            definiteness: Definiteness { positive_definite: None, method: "none".to_owned() },
            condition: None,
            inverted: Inverted::default(),
            broken: None,
        });
    }
    history
}

struct Pixels {
    width: usize,
    height: usize,
    rgb: Vec<[u8; 3]>,
}

impl Pixels {
    fn decode(bytes: &[u8]) -> Pixels {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut buffer = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut buffer).unwrap();
        let channels = info.color_type.samples();
        assert!(channels >= 3, "{:?}", info.color_type);
        let rgb = buffer[..info.buffer_size()]
            .chunks_exact(channels)
            .map(|pixel| [pixel[0], pixel[1], pixel[2]])
            .collect();
        Pixels { width: info.width as usize, height: info.height as usize, rgb }
    }

    /// The share of pixels inside an area that are not white, and the colours there.
    fn look(&self, area: Area) -> (f64, HashSet<[u8; 3]>) {
        let mut colours = HashSet::new();
        let (mut inked, mut all) = (0, 0);
        for y in area.top as usize..area.bottom as usize {
            for x in area.left as usize..area.right as usize {
                let pixel = self.rgb[y * self.width + x];
                colours.insert(pixel);
                all += 1;
                inked += usize::from(pixel != [255; 3]);
            }
        }
        (inked as f64 / all as f64, colours)
    }

    /// Width over height of what is coloured inside an area: axes, outlines and text are grey.
    fn aspect(&self, area: Area) -> f64 {
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for y in area.top as usize..area.bottom as usize {
            for x in area.left as usize..area.right as usize {
                let pixel = self.rgb[y * self.width + x];
                if pixel.iter().max().unwrap() - pixel.iter().min().unwrap() > 60 {
                    low = [low[0].min(x), low[1].min(y)];
                    high = [high[0].max(x + 1), high[1].max(y + 1)];
                }
            }
        }
        (high[0] - low[0]) as f64 / (high[1] - low[1]) as f64
    }
}

fn check_picture(picture: &Picture, least_ink: f64) -> (String, Vec<u8>) {
    let (svg, bytes) = (picture.to_svg(), picture.to_png().unwrap());
    let pixels = Pixels::decode(&bytes);
    assert_eq!((pixels.width, pixels.height), (1600, 800));
    let (ink, colours) = pixels.look(BODY);
    assert!(ink > least_ink, "the body covers {ink} of its area");
    assert!(ink < 0.99);
    assert!(colours.len() > 40, "the body has {} colours", colours.len());
    for area in [BAR, UPPER, LOWER] {
        let (ink, colours) = pixels.look(area);
        assert!(ink > 0.01 && colours.len() > 3, "{area:?} is blank");
    }
    check_xml(&svg);
    for label in [
        "displacement |u| (m)",
        "load parameter t",
        "reaction (10³ N)",
        "residual / reaction",
        "Newton iteration",
        "left, x",
        "right, x",
        "t = 1<",
        "tolerance 1e-10",
        "x (m)",
        "y (m)",
    ] {
        assert!(svg.contains(label), "`{label}` is missing");
    }
    (svg, bytes)
}

/// Tags are closed in the order in which they were opened, and nothing is left unescaped.
fn check_xml(text: &str) {
    let mut open = Vec::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('<') {
        assert!(!before.contains('>'), "stray `>` in {before}");
        for entity in before.split('&').skip(1) {
            let name = entity.split(';').next().unwrap();
            assert!(["amp", "lt", "gt", "quot", "apos"].contains(&name), "entity {name}");
        }
        let (tag, after) = after.split_once('>').expect("a tag is closed");
        assert!(!tag.contains('<'), "{tag}");
        assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop().as_deref(), Some(name), "closing {name}");
        } else if !tag.ends_with('/') && !tag.starts_with(['!', '?']) {
            open.push(tag.split_whitespace().next().unwrap().to_owned());
        }
        rest = after;
    }
    assert!(open.is_empty() && rest.trim().is_empty(), "{open:?} {rest}");
    assert!(text.chars().all(|c| c == '\n' || !c.is_control()));
}

#[test]
fn a_stretched_square_is_drawn() {
    let (points, frame, sets) = stretched([21, 21, 1], 2, 1.0);
    let history = history(2, 25);
    let picture = Picture {
        title: "square at 100 %",
        points: &points,
        n_points: points.n_points(),
        frame: &frame,
        sets: &sets,
        colour: None,
        charts: Charts::Steps(&history, 1e-10, "Newton iteration"),
    };
    let (svg, _) = check_picture(&picture, 0.2);
    assert!(svg.contains("square at 100 %, t = 1<") && !svg.contains("not stable"));
    let mut unstable = history.clone();
    unstable.steps[12].definiteness.positive_definite = Some(false);
    let picture =
        Picture { charts: Charts::Steps(&unstable, 1e-10, "Newton iteration"), ..picture };
    assert!(picture.to_svg().contains("crosses: not stable"));
    assert!(svg.contains("441 points, deformation at true scale"));
    assert!(svg.contains(">left<") && svg.contains(">right<"), "sets are named on the body");
    assert!(svg.matches("<path").count() >= 441);
}

#[test]
fn a_stretched_bar_is_drawn_in_space() {
    let (points, frame, sets) = stretched([25, 9, 7], 3, 0.6);
    let history = history(3, 8);
    let picture = Picture {
        title: "bar",
        points: &points,
        n_points: points.n_points(),
        frame: &frame,
        sets: &sets,
        colour: None,
        charts: Charts::Steps(&history, 1e-10, "Newton iteration"),
    };
    let (svg, _) = check_picture(&picture, 0.1);
    assert!(svg.contains("z (m)"));
}

#[test]
fn a_body_in_motion_is_drawn_with_a_field_and_its_energies() {
    let (points, frame, sets) = stretched([21, 21, 1], 2, 1.0);
    let values: Vec<f64> = (0..points.n_points()).map(|point| point as f64 - 100.0).collect();
    let colour = Colour { name: "von_mises".to_owned(), unit: "Pa", values };
    let series = |name: &str, height: f64| Series {
        name: name.to_owned(),
        points: (0..3000).map(|k| (1e-8 * f64::from(k), height * f64::from(k % 100))).collect(),
    };
    let energies = [series("kinetic", 0.1), series("stored", 0.2)];
    let picture = Picture {
        title: "wave",
        points: &points,
        n_points: points.n_points(),
        frame: &frame,
        sets: &sets,
        colour: Some(&colour),
        charts: Charts::Times { energies: &energies, probes: &[] },
    };
    let (svg, pixels) = (picture.to_svg(), Pixels::decode(&picture.to_png().unwrap()));
    check_xml(&svg);
    // Without probes energies take both places.
    for area in [BODY, BAR, UPPER, LOWER] {
        assert!(pixels.look(area).0 > 0.01, "{area:?} is blank");
    }
    for part in ["von_mises (Pa)", "energy (J)", ">kinetic<", ">stored<", "time t", "wave, t = 1"] {
        assert!(svg.contains(part), "{part}");
    }
    assert_eq!(svg.matches("time t").count(), 1);
    let probes = [series("tip_u", 0.1)];
    let both =
        Picture { charts: Charts::Times { energies: &energies, probes: &probes }, ..picture };
    assert_eq!(both.to_svg().matches("time t").count(), 2);
}

#[test]
fn small_displacements_are_magnified_and_clouds_are_discs() {
    for dimension in [2, 3] {
        let (mut points, frame, sets) = stretched([15, 9, 6], dimension, 1e-4);
        points.spacing = None;
        let history = history(dimension, 3);
        let picture = Picture {
            title: "cloud",
            points: &points,
            n_points: points.n_points(),
            frame: &frame,
            sets: &sets,
            colour: None,
            charts: Charts::Steps(&history, 1e-10, "Newton iteration"),
        };
        // The colour bar needs a power of ten here, so the general check does not apply.
        let svg = picture.to_svg();
        check_xml(&svg);
        assert!(svg.contains("displacements magnified 500 times"), "{}", svg.len());
        assert!(svg.contains("displacement |u| (10⁻⁶ m)"));
        assert!(svg.matches("<circle").count() > if dimension == 2 { 135 } else { 200 });
        let (ink, colours) = Pixels::decode(&picture.to_png().unwrap()).look(BODY);
        assert!(ink > 0.1 && colours.len() > 40, "{ink} {}", colours.len());
    }
}

#[test]
fn the_deformed_body_is_drawn_as_long_as_it_is() {
    for (stretch, drawn) in [(1.0, 2.0), (1e-4, 1.05)] {
        let (mut points, frame, sets) = stretched([21, 11, 1], 2, stretch);
        let history = history(2, 2);
        for is_lattice in [true, false] {
            points.spacing = points.spacing.filter(|_| is_lattice);
            let picture = Picture {
                title: "",
                points: &points,
                n_points: points.n_points(),
                frame: &frame,
                sets: &sets,
                colour: None,
                charts: Charts::Steps(&history, 1e-10, "Newton iteration"),
            };
            let found = Pixels::decode(&picture.to_png().unwrap()).aspect(BODY);
            // Cells of the ends are stretched with the body, discs are not. The height is that of the
            // ends; their cells bulge by half a spacing of 0.4*4*(stretch drawn), 4 % at the most. A
            // pixel is a 150th of the height or less; discs end within half a spacing of their points.
            let (expected, tolerance) = match is_lattice {
                true => (21.0 * drawn / 11.0, 0.01 + 0.04 * (drawn - 1.0)),
                false => (20.0 * drawn / 10.0, 0.1),
            };
            assert!((found / expected - 1.0).abs() < tolerance, "{stretch} {found} {expected}");
        }
    }
}

#[test]
fn large_bodies_are_thinned_and_say_so() {
    for (n, dimension, lattice) in
        [([400, 250, 1], 2, true), ([400, 250, 1], 2, false), ([120, 60, 60], 3, true)]
    {
        let (mut points, frame, sets) = stretched(n, dimension, 0.3);
        points.spacing = points.spacing.filter(|_| lattice);
        let history = history(dimension, 200);
        let picture = Picture {
            title: "",
            points: &points,
            n_points: points.n_points(),
            frame: &frame,
            sets: &sets,
            colour: None,
            charts: Charts::Steps(&history, 1e-10, "Newton iteration"),
        };
        let (svg, _) = check_picture(&picture, 0.1);
        assert!(svg.len() < 4_000_000, "{} bytes", svg.len());
        assert!(svg.contains(if lattice { "drawn as one" } else { "visible points drawn" }));
        let shapes = svg.matches("<path").count() + svg.matches("<circle").count();
        assert!(shapes > MOST_SHAPES / 5, "{shapes} shapes are too few");
    }
}

#[test]
fn strange_runs_are_drawn_too() {
    let draw = |points: &Points, frame: &Frame, sets: &[NamedPoints], history: &History| {
        let title = "<a & \"b\"> $x$ \u{7}";
        let charts = Charts::Steps(history, f64::NAN, "Newton iteration");
        let n_points = points.n_points();
        let picture = Picture { title, points, n_points, frame, sets, colour: None, charts };
        let svg = picture.to_svg();
        check_xml(&svg);
        assert!(svg.contains("&lt;a &amp; &quot;b&quot;&gt; $x$ "));
        Pixels::decode(&picture.to_png().unwrap());
        svg
    };
    // Nothing converged, nothing moved.
    let (points, mut frame, sets) = stretched([5, 4, 1], 2, 0.0);
    let empty = History::new(2, Vec::new(), Vec::new(), Vec::new());
    let svg = draw(&points, &frame, &sets, &empty);
    assert_eq!(svg.matches("no converged step").count(), 2);
    // One point, and a set that names points that do not exist.
    let one = Points {
        dimension: 2,
        positions: vec![1e9, -1e9],
        volumes: vec![1e-6],
        spacing: None,
        mesh: None,
        held: Vec::new(),
    };
    let still = Frame {
        t: 0.0,
        displacement: vec![0.0; 2],
        residual: vec![0.0; 2],
        velocity: Vec::new(),
        fields: Vec::new(),
    };
    let ghosts = [NamedPoints { name: "ghosts".to_owned(), points: vec![7] }];
    assert!(!draw(&one, &still, &ghosts, &empty).contains("ghosts"));
    // Numbers that are not finite, in the body and in the history.
    frame.displacement[3] = f64::NAN;
    let mut odd = history(2, 2);
    odd.steps[0].reactions[0][0] = f64::INFINITY;
    odd.steps[0].residual_over_reaction = vec![f64::NAN, 0.0, 1e-300];
    let svg = draw(&points, &frame, &sets, &odd);
    assert!(svg.contains("not finite and left out: 1"));
    frame.displacement.fill(f64::INFINITY);
    assert!(draw(&points, &frame, &sets, &odd).contains("no finite positions to draw"));
}

#[test]
fn both_files_are_written() {
    let dir = tempfile::tempdir().unwrap();
    let folder = OutputFolder::create(dir.path(), false).unwrap();
    let (points, frame, sets) = stretched([6, 6, 1], 2, 0.1);
    let history = history(2, 2);
    let picture = Picture {
        title: "both",
        points: &points,
        n_points: points.n_points(),
        frame: &frame,
        sets: &sets,
        colour: None,
        charts: Charts::Steps(&history, 1e-8, "Newton iteration"),
    };
    picture.write(&folder).unwrap();
    let read = |file| std::fs::read(folder.path_of(file)).unwrap();
    assert_eq!(read(OutputFile::PictureSvg), picture.to_svg().into_bytes());
    assert_eq!(read(OutputFile::PicturePng), picture.to_png().unwrap(), "same bits every time");
}

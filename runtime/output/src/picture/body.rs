//! The deformed body: what is seen of it, from where, in which colours.

use piola_grammar::counted;

use super::canvas::{Anchor, Canvas, DARK, GREY, LIGHT, Rgb, Text, shaded, shortened, viridis};
use super::cells::Facet;
use super::chart::{Area, Axis, AxisKind, Chart, with_colour_bar};
use super::discs::Discs;
use super::motion::{Camera, Motion, bounds, dot};
use super::solid::Solid;
use super::{Colour, MOST_SHAPES, NamedPoints, ticks};
use crate::{Frame, Points};

/// Below this fraction of the body's size, displacements are magnified to be seen.
const SMALL: f64 = 0.02;

/// Most sets that are marked on the body.
const MOST_SETS: usize = 6;

/// From metres on the plane of projection to pixels.
#[derive(Clone, Copy)]
struct Fit {
    scale: f64,
    centre: [f64; 2],
    page_centre: [f64; 2],
}

impl Fit {
    fn new(low: [f64; 2], high: [f64; 2], area: Area) -> Fit {
        let extent = [high[0] - low[0], high[1] - low[1]].map(|e| e.max(f64::MIN_POSITIVE));
        Fit {
            scale: (area.width() / extent[0]).min(area.height() / extent[1]),
            centre: [(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0],
            page_centre: area.centre(),
        }
    }

    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            self.page_centre[0] + self.scale * (x - self.centre[0]),
            self.page_centre[1] - self.scale * (y - self.centre[1]),
        ]
    }
}

/// What the pictures of a film share, so that nothing but the body moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shared {
    /// The largest displacement in m, by which all are magnified.
    pub(super) largest: f64,
    /// What the ends of the colours stand for.
    pub(super) shades: [f64; 2],
    /// The box around everything that is drawn, in m; nothing where it is not known yet.
    pub(super) bounds: Option<([f64; 3], [f64; 3])>,
}

/// The body as it will be drawn.
pub(super) struct BodyView<'a> {
    motion: Motion<'a>,
    names: Vec<&'a str>,
    camera: Camera,
    shapes: Shapes,
    /// What colours show, and from where to where.
    name: &'a str,
    unit: &'a str,
    shades: [f64; 2],
    /// The box that the axes hold, where it is not that of what is drawn.
    bounds: Option<([f64; 3], [f64; 3])>,
}

enum Shapes {
    Solid(Solid),
    Discs(Discs),
}

impl<'a> BodyView<'a> {
    pub(super) fn new(
        points: &'a Points,
        frame: &'a Frame,
        sets: &'a [NamedPoints],
        colour: Option<&'a Colour>,
        shared: Option<Shared>,
    ) -> BodyView<'a> {
        let mut member_of = vec![0u32; points.n_points()];
        for (bit, set) in sets.iter().take(MOST_SETS).enumerate() {
            for &point in &set.points {
                if let Some(bits) = member_of.get_mut(point) {
                    *bits |= 1 << bit;
                }
            }
        }
        let displacement = &frame.displacement;
        let colours = colour.map(|colour| &colour.values[..]);
        let mut motion =
            Motion { points, displacement, magnification: 1.0, colours, sets: member_of };
        let largest = shared.map_or_else(|| motion.largest(), |shared| shared.largest);
        let (low, high) = motion.reference_bounds();
        let size = [0, 1, 2].map(|axis| high[axis] - low[axis]).into_iter().fold(0.0, f64::max);
        motion.magnification = magnification(largest, size);
        let camera = Camera::new(points.dimension);
        let of_mesh = || Solid::of_mesh(&motion, points.mesh.as_deref()?, MOST_SHAPES);
        let of_lattice = |spacing| Solid::of_lattice(&motion, spacing, MOST_SHAPES);
        let solid = points.spacing.filter(|spacing| *spacing > 0.0).map(of_lattice);
        let shapes = match solid.or_else(of_mesh) {
            Some(solid) => Shapes::Solid(solid),
            None => Shapes::Discs(Discs::new(&motion, &camera, MOST_SHAPES)),
        };
        let names = sets.iter().take(MOST_SETS).map(|set| set.name.as_str()).collect();
        let (name, unit, shades) = match colour {
            None => ("displacement |u|", "m", [0.0, largest]),
            Some(colour) => (&colour.name[..], colour.unit, motion.range()),
        };
        let shades = shared.map_or(shades, |shared| shared.shades);
        let bounds = shared.and_then(|shared| shared.bounds);
        BodyView { motion, names, camera, shapes, name, unit, shades, bounds }
    }

    /// What the reader should know about how the body is drawn.
    pub(super) fn note(&self) -> String {
        let n = self.motion.points.n_points();
        let mut note = counted(n, "point");
        note += &match self.motion.magnification {
            1.0 => ", deformation at true scale".to_owned(),
            factor => format!(", displacements magnified {} times", ticks::short(factor)),
        };
        match &self.shapes {
            Shapes::Solid(solid) if solid.block > 1 => {
                let times = vec![solid.block.to_string(); self.motion.points.dimension];
                note += &format!(", {} points drawn as one", times.join(" × "));
            }
            Shapes::Discs(discs) if discs.every > 1 => {
                note += &format!(", one of {} visible points drawn", discs.every);
            }
            _ => {}
        }
        let missing = n - self.motion.finite_points().count();
        if missing > 0 {
            note += &format!(", not finite and left out: {missing}");
        }
        note
    }

    fn colour(&self, value: f64) -> Rgb {
        let [low, high] = self.shades;
        viridis(if high > low { (value - low) / (high - low) } else { 0.0 })
    }

    /// The body with its axes.
    pub(super) fn draw(&self, canvas: &mut Canvas, area: Area) {
        let (low, high) = self.bounds.unwrap_or_else(|| self.own_bounds());
        if low.iter().chain(&high).any(|x| !x.is_finite()) {
            area.frame(canvas, LIGHT);
            let [x, y] = area.centre();
            let text = Text::new(14, Anchor::Middle, GREY);
            return canvas.text(x, y, "no finite positions to draw", text);
        }
        let fit = if self.motion.points.dimension == 2 {
            self.draw_flat_axes(canvas, area, low, high)
        } else {
            self.draw_box(canvas, area, low, high)
        };
        let mut tags = Tags::new(&self.names);
        match &self.shapes {
            Shapes::Solid(solid) => self.draw_solid(canvas, solid, fit, &mut tags),
            Shapes::Discs(discs) => self.draw_discs(canvas, discs, fit, &mut tags),
        }
        tags.draw(canvas, area);
    }

    /// The box around everything that is drawn, in m; not finite if there is nothing.
    pub(super) fn own_bounds(&self) -> ([f64; 3], [f64; 3]) {
        match &self.shapes {
            Shapes::Solid(solid) => {
                let corners = solid.facets.iter().flat_map(|facet| facet.corners);
                bounds(corners.chain(solid.edges.iter().flat_map(|edge| edge.reference)))
            }
            Shapes::Discs(discs) => bounds(
                discs
                    .discs
                    .iter()
                    .flat_map(|disc| [-disc.radius, disc.radius].map(|r| disc.at.map(|x| x + r))),
            ),
        }
    }

    /// Axes around a two-dimensional body, the same scale along both.
    fn draw_flat_axes(
        &self,
        canvas: &mut Canvas,
        area: Area,
        low: [f64; 3],
        high: [f64; 3],
    ) -> Fit {
        let margin = 0.04 * (high[0] - low[0]).max(high[1] - low[1]);
        let (low, high) =
            ([low[0] - margin, low[1] - margin], [high[0] + margin, high[1] + margin]);
        let fit = Fit::new(low, high, area);
        let ([left, bottom], [right, top]) = (fit.place(low), fit.place(high));
        let area = Area { left, top, right, bottom };
        let ticks = |pixels: f64| AxisKind::Linear((pixels / 90.0).round().max(2.0) as usize);
        let axis = |name, low, high, kind| Axis { name, unit: "m", low, high, kind };
        let chart = Chart {
            area,
            x: axis("x", low[0], high[0], ticks(area.width())),
            y: axis("y", low[1], high[1], ticks(area.height())),
            grid: false,
        };
        chart.draw_axes(canvas);
        fit
    }

    /// Three edges of the box around a three-dimensional body, as axes.
    fn draw_box(&self, canvas: &mut Canvas, area: Area, low: [f64; 3], high: [f64; 3]) -> Fit {
        let corner = |i: usize| {
            [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] })
        };
        let flat = (0..8).map(|i| self.camera.flat(corner(i))).map(|[x, y]| [x, y, 0.0]);
        let (flat_low, flat_high) = bounds(flat);
        let inner = Area {
            left: area.left + 40.0,
            top: area.top + 10.0,
            right: area.right - 40.0,
            bottom: area.bottom - 30.0,
        };
        let fit = Fit::new([flat_low[0], flat_low[1]], [flat_high[0], flat_high[1]], inner);
        let place = |p: [f64; 3]| fit.place(self.camera.flat(p));
        // The three edges that meet at the hidden corner (least x, most y, least z), behind.
        for other in [0b011, 0b000, 0b110] {
            canvas.dashed(place(corner(0b010)), place(corner(other)), LIGHT, 1.0);
        }
        // Edge from, edge to, and where its labels stand as seen from the edge.
        let edges = [
            (0, 0b000, 0b001, [-0.35, 1.0]),
            (1, 0b001, 0b011, [0.7, 0.8]),
            (2, 0b000, 0b100, [-1.0, 0.0]),
        ];
        for (axis, from, to, outwards) in edges {
            self.draw_edge_axis(canvas, axis, [corner(from), corner(to)], outwards, fit);
        }
        fit
    }

    fn draw_edge_axis(
        &self,
        canvas: &mut Canvas,
        axis: usize,
        [from, to]: [[f64; 3]; 2],
        [dx, dy]: [f64; 2],
        fit: Fit,
    ) {
        let place = |p: [f64; 3]| fit.place(self.camera.flat(p));
        let (start, end) = (place(from), place(to));
        canvas.line(start, end, GREY, 1.0);
        let pixels = libm::hypot(end[0] - start[0], end[1] - start[1]);
        let wanted = (pixels / 60.0).round().clamp(2.0, 6.0) as usize;
        let ticks = ticks::linear(from[axis], to[axis], wanted);
        let anchor = if dx > 0.5 { Anchor::Start } else { Anchor::End };
        for (value, label) in ticks.values.iter().zip(&ticks.labels) {
            let mut at = from;
            at[axis] = *value;
            let [x, y] = place(at);
            canvas.line([x, y], [x + 6.0 * dx, y + 6.0 * dy], GREY, 1.0);
            let text = Text::new(13, anchor, DARK);
            canvas.text(x + 9.0 * dx, y + 12.0 * dy + 4.5, label, text);
        }
        let name = ticks::with_unit(["x", "y", "z"][axis], "m", ticks.exponent);
        let [x, y] = [(start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0];
        if axis == 2 {
            let text = Text::new(15, Anchor::Middle, DARK);
            canvas.text(end[0] - 18.0, end[1] - 14.0, &name, text);
        } else {
            let text = Text::new(15, anchor, DARK);
            canvas.text(x + 44.0 * dx, y + 44.0 * dy + 5.0, &name, text);
        }
    }

    fn draw_solid(&self, canvas: &mut Canvas, solid: &Solid, fit: Fit, tags: &mut Tags) {
        let place = |p: [f64; 3]| fit.place(self.camera.flat(p));
        let edges = &solid.edges;
        let outline: Vec<[[f64; 2]; 2]> =
            edges.iter().filter(|e| e.beyond.is_none()).map(|e| e.reference.map(place)).collect();
        canvas.segments(&outline, [190, 190, 190], 1.0);

        let nearness = |facet: &Facet| {
            facet.corners.iter().map(|&corner| self.camera.nearness(corner)).sum::<f64>()
        };
        let faces_viewer =
            |facet: &Facet| facet.outward.is_none_or(|n| dot(n, self.camera.towards) > 0.0);
        let mut seen: Vec<&Facet> = solid.facets.iter().filter(|f| faces_viewer(f)).collect();
        seen.sort_by(|p, q| nearness(p).total_cmp(&nearness(q)));
        // Small cells take their own colour as outline, which closes the seams between them.
        let large = solid.size * fit.scale > 7.0;
        let (edge_shade, set_shade) = if large { (0.88, 0.65) } else { (1.0, 0.85) };
        for facet in &seen {
            let (value, sets) = (solid.values[facet.cell], solid.sets[facet.cell]);
            let brightness = facet.outward.map_or(1.0, |normal| self.camera.brightness(normal));
            let fill = shaded(self.colour(value), brightness);
            let in_marked_set = facet.outward.is_some() && sets != 0;
            let stroke = shaded(fill, if in_marked_set { set_shade } else { edge_shade });
            let corners = facet.corners.map(place);
            canvas.polygon(&corners, fill, stroke, 0.7);
            for corner in corners {
                tags.include(sets, corner);
            }
        }
        for bit in 0..self.names.len() {
            let is_in = |cell: usize| solid.sets[cell] >> bit & 1 == 1;
            let border: Vec<[[f64; 2]; 2]> = edges
                .iter()
                .filter(|edge| is_in(edge.cell) && !edge.beyond.is_some_and(is_in))
                .map(|edge| edge.current.map(place))
                .collect();
            canvas.segments(&border, DARK, 1.6);
        }
    }

    fn draw_discs(&self, canvas: &mut Canvas, discs: &Discs, fit: Fit, tags: &mut Tags) {
        let mut seen = discs.discs.clone();
        let nearness = |at: [f64; 3]| self.camera.nearness(at);
        seen.sort_by(|p, q| nearness(p.at).total_cmp(&nearness(q.at)));
        let far = seen.first().map_or(0.0, |disc| nearness(disc.at));
        let near = seen.last().map_or(1.0, |disc| nearness(disc.at));
        for disc in &seen {
            // Far balls are darker; in two dimensions all are equally near.
            let depth = if near > far { (nearness(disc.at) - far) / (near - far) } else { 1.0 };
            let fill = shaded(self.colour(disc.value), 0.65 + 0.35 * depth);
            let at = fit.place(self.camera.flat(disc.at));
            let outline = if disc.sets != 0 { DARK } else { shaded(fill, 0.75) };
            canvas.disc(at, (disc.radius * fit.scale).max(0.8), fill, Some(outline));
            tags.include(disc.sets, at);
        }
    }

    /// The colours with what they show.
    pub(super) fn draw_colour_bar(&self, canvas: &mut Canvas, bar: Area) {
        let [low, high] = self.shades;
        let high = if high > low { high } else { low + 1.0 };
        let name = with_colour_bar(canvas, bar, (self.name, self.unit), [low, high], 6);
        canvas.text(bar.left - 40.0, bar.top - 16.0, &name, Text::new(15, Anchor::Start, DARK));
    }
}

/// The names of the marked sets, each in the middle of what is seen of the set.
struct Tags<'a> {
    /// Name, sum of the places on the page, their number.
    sets: Vec<(&'a str, [f64; 2], f64)>,
}

impl<'a> Tags<'a> {
    fn new(names: &[&'a str]) -> Tags<'a> {
        Tags { sets: names.iter().map(|&name| (name, [0.0; 2], 0.0)).collect() }
    }

    fn include(&mut self, sets: u32, [x, y]: [f64; 2]) {
        for (bit, (_, sum, count)) in self.sets.iter_mut().enumerate() {
            if sets >> bit & 1 == 1 {
                *sum = [sum[0] + x, sum[1] + y];
                *count += 1.0;
            }
        }
    }

    fn draw(&self, canvas: &mut Canvas, area: Area) {
        let mut taken: Vec<[f64; 2]> = Vec::new();
        for &(name, [x, y], count) in self.sets.iter().filter(|(_, _, count)| *count > 0.0) {
            let mut at = [x / count, y / count];
            let collides = |at: [f64; 2]| {
                taken.iter().any(|t| (t[0] - at[0]).abs() < 60.0 && (t[1] - at[1]).abs() < 24.0)
            };
            while collides(at) && at[1] + 26.0 < area.bottom {
                at[1] += 26.0;
            }
            taken.push(at);
            canvas.tag(at, &shortened(name, 20), 14);
        }
    }
}

/// 1, or the round number that makes small displacements about a twentieth of the body's size.
fn magnification(largest: f64, size: f64) -> f64 {
    if largest > 0.0 && size > 0.0 && largest < SMALL * size {
        let factor = ticks::round_step(0.05 * size / largest);
        if factor.is_finite() { factor.max(1.0) } else { 1.0 }
    } else {
        1.0
    }
}

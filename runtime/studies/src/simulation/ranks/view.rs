//! What ranks show of a body: frames, of which each writes its own points, and on rank 0 the picture of so many points
//! as a picture shows.

use std::path::Path;

use piola_mechanics::body::Body;
use piola_output::picture::{Colour, NamedPoints};
use piola_output::pieces::Piece;
use piola_output::pvd::FrameSeries;
use piola_output::table::write_displacement_of;
use piola_output::{Frame, OutputError, OutputFolder, PointField, Points};
use piola_petsc::{Engine, EngineError, Halo};

use super::Begun;
use super::parts::ends;
use super::share::Share;
use super::steps::{agreed, lost};
use crate::scene::selection::Selection;
use crate::simulation::run::RunError;

/// Most points of a body that rank 0 has for its picture: of larger ones every second is left out along each axis, or
/// every third, and so on.
const MOST_SHOWN: usize = 100_000;

/// Points whose displacements rank 0 has at once for the table.
const ROWS_AT_ONCE: usize = 1 << 16;

/// A lattice's point may be off its place by this part of a spacing.
const NEAR: f64 = 1e-3;

/// What a rank shows of its own points; rows of numbers are of all that it holds.
pub(super) struct View<'a> {
    engine: &'a Engine,
    body: &'a Body,
    share: &'a Share,
    /// How many points the whole body has.
    n_points: usize,
    /// Those of its own points that are in the picture, as places among those held.
    shown: Vec<usize>,
    /// On rank 0.
    pub(super) sketch: Option<Sketch>,
    /// Of a mesh rank 0 writes frames, and of other bodies each rank its piece.
    pieces: Option<Pieces<'a>>,
}

/// The points of a picture.
pub(super) struct Sketch {
    pub(super) points: Points,
    pub(super) sets: Vec<NamedPoints>,
    /// Of rows as they come rank by rank, the place among these points.
    places: Vec<usize>,
}

impl Sketch {
    /// Rows of so many numbers at their places.
    fn placed(&self, rows: &[f64], width: usize) -> Vec<f64> {
        let mut all = vec![0.0; rows.len()];
        for (row, place) in rows.chunks_exact(width).zip(&self.places) {
            all[place * width..(place + 1) * width].copy_from_slice(row);
        }
        all
    }
}

/// What a picture shows of one time, of the points of a sketch. Of a mesh it is the whole frame.
pub(super) struct Look {
    pub(super) frame: Frame,
    pub(super) colour: Option<Colour>,
}

/// What rank 0 has of one time.
pub(super) struct Shown {
    pub(super) look: Look,
    /// The frame to list, where one was written or is to be.
    pub(super) listed: Option<Frame>,
}

impl<'a> View<'a> {
    /// Of the part of a case that a rank holds; `fixed` are degrees of freedom of its own that are prescribed. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    pub(super) fn new(
        Begun { engine, share, parts, path, .. }: &Begun<'a>,
        fixed: &[usize],
    ) -> Result<View<'a>, RunError> {
        let (case, n_points) = (&parts.case, parts.n_points);
        let body = case.body.as_ref();
        let own = share.own_of_held();
        let ends = ends(body, own.clone(), engine);
        let (low, high) = ends.split_at(body.dimension());
        let stride = if parts.is_mesh { 1 } else { stride(n_points, body, (low, high)) };
        let is_shown = shown(body, low, stride);
        let shown: Vec<usize> = own.filter(|point| is_shown(*point)).collect();
        let held = held(body, fixed);
        let sketch = sketch(engine, (body, &shown), (&parts.selection, &held), stride);
        let mesh = case.mesh.clone();
        let sketch = sketch.map(|one| Sketch { points: one.points.with_mesh(mesh), ..one });
        let pieces = match parts.is_mesh {
            true => None,
            false => Some(Pieces::new((engine, share), body, &held, path).map_err(lost)?),
        };
        Ok(View { engine, body, share, n_points, shown, sketch, pieces })
    }

    /// How many points the whole body has.
    pub(super) fn n_points(&self) -> usize {
        self.n_points
    }

    /// The frames of the body, as rank 0 lists them.
    pub(super) fn series<'s>(
        &'s self,
        folder: &'s OutputFolder,
        sketch: &'s Sketch,
    ) -> Result<FrameSeries<'s>, OutputError> {
        match &self.pieces {
            Some(pieces) => FrameSeries::in_pieces(folder, &pieces.piece, self.engine.ranks()),
            None => FrameSeries::new(folder, &sketch.points),
        }
    }

    /// The same behind those of an earlier run, at these times in s.
    pub(super) fn series_behind<'s>(
        &'s self,
        folder: &'s OutputFolder,
        sketch: &'s Sketch,
        times: Vec<f64>,
    ) -> Result<FrameSeries<'s>, OutputError> {
        match &self.pieces {
            Some(pieces) => {
                let n = self.engine.ranks();
                FrameSeries::resume_in_pieces(folder, &pieces.piece, n, times)
            }
            None => FrameSeries::resume(folder, &sketch.points, times),
        }
    }

    /// Shows a frame of all points that are held: `number` is that of the frame where it is to be written, in pieces
    /// by all ranks. Collective.
    ///
    /// # Errors
    /// A file that a rank cannot write; what PETSc reports.
    pub(super) fn show(
        &self,
        number: Option<usize>,
        (frame, colour): (Frame, Option<Colour>),
    ) -> Result<Option<Shown>, RunError> {
        let look = self.look(&frame, colour);
        let own = match (number, &self.pieces) {
            (Some(number), Some(pieces)) => {
                let own = pieces.frame(self.body, frame).map_err(lost)?;
                let place = (number, self.engine.rank());
                let written = pieces.piece.write(pieces.folder, place, &own);
                agreed(self.engine, written.map_err(RunError::from))?;
                Some(named(own, self.body.dimension()))
            }
            (Some(_), None) => look.as_ref().map(|look| look.frame.clone()),
            (None, _) => None,
        };
        Ok(look.map(|look| Shown { look, listed: own }))
    }

    /// What rank 0 sees of a frame of what is held. Collective.
    fn look(&self, frame: &Frame, colour: Option<Colour>) -> Option<Look> {
        let d = self.body.dimension();
        let displacement = self.seen(&frame.displacement, d);
        let colour = colour.map(|colour| Colour { values: self.seen(&colour.values, 1), ..colour });
        let mut seen = Frame {
            t: frame.t,
            displacement,
            residual: Vec::new(),
            velocity: Vec::new(),
            fields: Vec::new(),
        };
        if self.pieces.is_none() {
            seen.residual = self.seen(&frame.residual, d);
            seen.velocity = self.seen(&frame.velocity, d);
            let whole = |field: &PointField| {
                let (name, components) = (field.name.clone(), field.components);
                let values = self.seen(&field.values, components);
                PointField { name, components, values }
            };
            seen.fields = frame.fields.iter().map(whole).collect();
        }
        self.sketch.as_ref().map(|_| Look { frame: seen, colour })
    }

    /// Numbers of what is held as rank 0 sees them; nothing elsewhere. Collective.
    fn seen(&self, values: &[f64], width: usize) -> Vec<f64> {
        if values.is_empty() {
            return Vec::new();
        }
        let rows = self.body.from_user_order(values, width);
        let row = |point: &usize| &rows[point * width..(point + 1) * width];
        let own: Vec<f64> = self.shown.iter().flat_map(row).copied().collect();
        let all = gathered(self.engine, &own).zip(self.sketch.as_ref());
        all.map_or_else(Vec::new, |(all, sketch)| sketch.placed(&all, width))
    }

    /// Writes the table of displacements, in m, of all points in the user's order; `u` are own ones in the body's.
    /// Collective.
    ///
    /// # Errors
    /// On rank 0 a file that cannot be written.
    pub(super) fn write_displacement(
        &self,
        folder: Option<&OutputFolder>,
        u: &[f64],
    ) -> Result<(), OutputError> {
        let (d, own) = (self.body.dimension(), self.share.own_of_held());
        let number = |point: usize| self.body.user_index()[own.start + point] as usize;
        let mut order: Vec<u32> = (0..own.len() as u32).collect();
        order.sort_unstable_by_key(|point| number(*point as usize));
        let (mut rest, mut begin) = (&order[..], 0);
        let mut next = || {
            if begin == self.n_points {
                return None;
            }
            let end = self.n_points.min(begin + ROWS_AT_ONCE);
            let (now, behind) =
                rest.split_at(rest.partition_point(|one| number(*one as usize) < end));
            rest = behind;
            let row = |point: &u32| {
                let point = *point as usize;
                let place = (number(point) - begin) as f64;
                let x = self.body.position(own.start + point);
                [place].into_iter().chain(x.to_vec()).chain(u[point * d..][..d].to_vec())
            };
            let rows = gathered(self.engine, &now.iter().flat_map(row).collect::<Vec<f64>>());
            let mut parts = [(); 2].map(|()| vec![0.0; (end - begin) * d]);
            for row in rows.iter().flat_map(|rows| rows.chunks_exact(1 + 2 * d)) {
                for (part, numbers) in parts.iter_mut().zip(row[1..].chunks_exact(d)) {
                    part[row[0] as usize * d..][..d].copy_from_slice(numbers);
                }
            }
            begin = end;
            let [positions, displacement] = parts;
            Some((positions, displacement))
        };
        let written = folder.map_or(Ok(()), |folder| write_displacement_of(folder, d, &mut next));
        // Other ranks give their rows, also where rank 0 has no use for them any more.
        while next().is_some() {}
        written
    }
}

/// Own numbers of all ranks, one behind the other, on rank 0: a vector in the body's order. Collective.
pub(super) fn gathered(engine: &Engine, own: &[f64]) -> Option<Vec<f64>> {
    let bytes: Vec<u8> = own.iter().flat_map(|x| x.to_le_bytes()).collect();
    let all = engine.gather(&bytes)?;
    let numbers = |bytes: &Vec<u8>| -> Vec<f64> {
        let eights = bytes.chunks_exact(8);
        eights.filter_map(|eight| Some(f64::from_le_bytes(eight.try_into().ok()?))).collect()
    };
    Some(all.iter().flat_map(numbers).collect())
}

/// A frame of which nothing but the names of its arrays is needed: without values, but of a point's velocity.
fn named(mut frame: Frame, d: usize) -> Frame {
    frame.displacement = Vec::new();
    frame.residual = Vec::new();
    frame.velocity = frame.velocity.iter().take(d).copied().collect();
    frame.fields.iter_mut().for_each(|field| field.values = Vec::new());
    frame
}

/// Every which point of a lattice along each axis is shown, or of a cloud.
fn stride(n_points: usize, body: &Body, (low, high): (&[f64], &[f64])) -> usize {
    let Some(spacing) = body.spacing() else { return n_points.div_ceil(MOST_SHOWN).max(1) };
    let counts = || low.iter().zip(high).map(|(low, high)| ((high - low) / spacing).round() + 1.0);
    // Of a body that fills its box; others have fewer.
    let filled = n_points as f64 / counts().product::<f64>();
    let left = |stride: usize| -> f64 {
        counts().map(|count| (count / stride as f64).ceil()).product::<f64>() * filled
    };
    (1..=n_points).find(|stride| left(*stride) <= MOST_SHOWN as f64).unwrap_or(1)
}

/// Whether a point is in the picture; `low` are the lowest coordinates of the body.
fn shown(body: &Body, low: &[f64], stride: usize) -> impl Fn(usize) -> bool {
    move |point| match body.spacing() {
        Some(spacing) => body.position(point).iter().zip(low).all(|(x, low)| {
            let place = ((x - low) / spacing).round();
            place % stride as f64 == 0.0
        }),
        None => (body.user_index()[point] as usize).is_multiple_of(stride),
    }
}

/// Of which points all of the displacement is prescribed, by degrees of freedom that are.
fn held(body: &Body, fixed: &[usize]) -> Vec<f64> {
    let d = body.dimension();
    let mut counts = vec![0; body.n_points()];
    fixed.iter().for_each(|dof| counts[dof / d] += 1);
    counts.iter().map(|count| f64::from(*count == d)).collect()
}

/// The points of the picture, on rank 0. Collective.
fn sketch(
    engine: &Engine,
    (body, shown): (&Body, &[usize]),
    (selection, held): (&Selection, &[f64]),
    stride: usize,
) -> Option<Sketch> {
    let (d, sets) = (body.dimension(), &selection.sets);
    let axes = if body.spacing().is_some() { d } else { 1 };
    let share = libm::pow(stride as f64, axes as f64);
    let mut own = Vec::new();
    for &point in shown {
        own.push(f64::from(body.user_index()[point]));
        own.extend_from_slice(body.position(point));
        own.extend([body.volumes()[point] * share, held[point]]);
        let is_in = |points: &[usize]| f64::from(points.binary_search(&point).is_ok());
        own.extend(sets.iter().map(|set| is_in(&set.points)));
    }
    let all = gathered(engine, &own)?;
    let rows: Vec<&[f64]> = all.chunks_exact(d + 3 + sets.len()).collect();
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_unstable_by(|a, b| rows[*a][0].total_cmp(&rows[*b][0]));
    let mut places = vec![0; rows.len()];
    order.iter().enumerate().for_each(|(place, row)| places[*row] = place);
    let sorted = || order.iter().map(|row| rows[*row]);
    let points = Points {
        dimension: d,
        positions: sorted().flat_map(|row| &row[1..=d]).copied().collect(),
        volumes: sorted().map(|row| row[d + 1]).collect(),
        spacing: body.spacing().map(|spacing| spacing * stride as f64),
        mesh: None,
        held: sorted().map(|row| row[d + 2] > 0.0).collect(),
    };
    let of_set = |number: usize| {
        let is_in = |(place, row): (usize, &[f64])| (row[d + 3 + number] > 0.0).then_some(place);
        sorted().enumerate().filter_map(is_in).collect()
    };
    let named = |(number, name): (usize, &String)| NamedPoints {
        name: name.clone(),
        points: of_set(number),
    };
    let sets = sets.iter().map(|set| &set.name).enumerate().map(named).collect();
    Some(Sketch { points, sets, places })
}

/// Frames of own points, and of those behind them that are corners of their cells.
struct Pieces<'e> {
    share: &'e Share,
    piece: Piece,
    n_borrowed: usize,
    /// Exchanges of a number, a vector and a tensor of each point.
    halos: [Halo<'e>; 3],
    /// Of the run, as rank 0 names it.
    folder: &'e Path,
}

impl<'e> Pieces<'e> {
    fn new(
        (engine, share): (&'e Engine, &'e Share),
        body: &Body,
        held: &[f64],
        folder: &'e Path,
    ) -> Result<Pieces<'e>, EngineError> {
        let own = share.own_of_held();
        let along = |point: usize| body.position(point)[body.sorted_axis()];
        let reach = body.spacing().map_or(0.0, |spacing| spacing * (1.0 + NEAR));
        let near = |point: &usize| along(*point) - along(own.end - 1) <= reach;
        let behind = (own.end..body.n_points()).take_while(near).count();
        let last = own.end + if body.spacing().is_some() { behind } else { 0 };
        let borrowed: Vec<u64> =
            (own.end..last).map(|point| (share.held.start + point) as u64).collect();
        let (d, points) = (body.dimension(), own.start..last);
        let number = |point: usize| f64::from(body.user_index()[point]);
        let piece = Piece {
            points: Points {
                dimension: d,
                positions: body.positions()[points.start * d..points.end * d].to_vec(),
                volumes: body.volumes()[points.clone()].to_vec(),
                spacing: body.spacing(),
                mesh: None,
                held: Vec::new(),
            },
            numbers: points.clone().map(number).collect(),
            n_own: own.len(),
        };
        let halo = |width| Halo::new(engine, &share.ranges, &borrowed, width);
        let halos = [halo(1)?, halo(d)?, halo(9)?];
        let mut pieces = Pieces { share, piece, n_borrowed: borrowed.len(), halos, folder };
        let held = pieces.brought(held, 1)?;
        pieces.piece.points.held = held.iter().map(|held| *held > 0.0).collect();
        Ok(pieces)
    }

    /// Rows of 1, `d` or 9 numbers of the piece's points, of rows of all that are held. Collective.
    fn brought(&self, rows: &[f64], width: usize) -> Result<Vec<f64>, EngineError> {
        let own = self.share.own_of_held();
        let mut room = rows[own.start * width..own.end * width].to_vec();
        room.resize(room.len() + self.n_borrowed * width, 0.0);
        let kind = match width {
            1 => 0,
            9 => 2,
            _ => 1,
        };
        self.halos[kind].fill(&mut room)?;
        Ok(room)
    }

    /// The frame of the piece, of one of what is held, whose arrays make room one by one. Collective.
    fn frame(&self, body: &Body, frame: Frame) -> Result<Frame, EngineError> {
        let d = body.dimension();
        let of = |values: Vec<f64>, width: usize| match values {
            values if values.is_empty() => Ok(values),
            values => {
                let rows = body.from_user_order(&values, width);
                drop(values);
                self.brought(&rows, width)
            }
        };
        let field = |field: PointField| {
            let values = of(field.values, field.components)?;
            Ok(PointField { values, ..field })
        };
        Ok(Frame {
            t: frame.t,
            displacement: of(frame.displacement, d)?,
            residual: of(frame.residual, d)?,
            velocity: of(frame.velocity, d)?,
            fields: frame.fields.into_iter().map(field).collect::<Result<_, EngineError>>()?,
        })
    }
}

//! Shapes on a page, in pixels with y downwards: a thin layer over kuva's scene.

use kuva::backend::raster::RasterBackend;
use kuva::backend::svg::SvgBackend;
use kuva::plot::ColorMap;
use kuva::render::color::Color;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor};

/// A colour: red, green, blue.
pub(super) type Rgb = [u8; 3];

/// Text and axes.
pub(super) const DARK: Rgb = [38, 38, 38];
/// Secondary text.
pub(super) const GREY: Rgb = [110, 110, 110];
/// Grid lines and outlines of the reference.
pub(super) const LIGHT: Rgb = [222, 222, 222];
/// What is not a number.
pub(super) const NOT_A_NUMBER: Rgb = [160, 160, 160];

/// The perceptually uniform colour map viridis at `x` in 0..1.
pub(super) fn viridis(x: f64) -> Rgb {
    match ColorMap::Viridis.map_rgb(x) {
        Some((r, g, b)) if x.is_finite() => [r, g, b],
        _ => NOT_A_NUMBER,
    }
}

/// A colour made darker: every channel times `factor` in 0..1.
pub(super) fn shaded(colour: Rgb, factor: f64) -> Rgb {
    colour.map(|channel| (f64::from(channel) * factor.clamp(0.0, 1.0)).round() as u8)
}

/// Which point of a text stands at its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// How a text looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Text {
    size: u32,
    anchor: Anchor,
    colour: Rgb,
}

impl Text {
    /// Text of this size in pixels.
    pub(super) fn new(size: u32, anchor: Anchor, colour: Rgb) -> Text {
        Text { size, anchor, colour }
    }
}

/// About how wide a text is in pixels: DejaVu Sans is 0.6 em wide on average.
pub(super) fn text_width(text: &str, size: u32) -> f64 {
    text.chars().count() as f64 * f64::from(size) * 0.6
}

/// A text of at most `most` characters.
pub(super) fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        text.to_owned()
    } else {
        text.chars().take(most.saturating_sub(1)).chain(['…']).collect()
    }
}

/// The shapes of a page.
pub(super) struct Canvas {
    scene: Scene,
}

impl Canvas {
    /// A white page.
    pub(super) fn new(width: f64, height: f64) -> Canvas {
        let mut scene = Scene::new(width, height);
        scene.font_family = Some("DejaVu Sans, Verdana, Arial, sans-serif".to_owned());
        Canvas { scene }
    }

    pub(super) fn to_svg(&self) -> String {
        SvgBackend::new().with_pretty(true).render_scene(&self.scene)
    }

    pub(super) fn to_png(&self) -> Result<Vec<u8>, String> {
        RasterBackend::new().with_scale(1.0).render_scene(&self.scene)
    }

    pub(super) fn text(&mut self, x: f64, y: f64, content: &str, style: Text) {
        // kuva reads $..$ as mathematics, and XML allows no control characters.
        let content: String = content.chars().filter(|c| !c.is_control()).collect();
        self.scene.add(Primitive::Text {
            x,
            y,
            content: content.replace('$', "\\$"),
            size: style.size,
            anchor: match style.anchor {
                Anchor::Start => TextAnchor::Start,
                Anchor::Middle => TextAnchor::Middle,
                Anchor::End => TextAnchor::End,
            },
            rotate: None,
            bold: false,
            color: Some(colour(style.colour)),
        });
    }

    /// A short text on a white ground, centred at the position.
    pub(super) fn tag(&mut self, [x, y]: [f64; 2], content: &str, size: u32) {
        let (width, height) = (text_width(content, size) + 8.0, f64::from(size) * 1.35);
        self.scene.add(Primitive::Rect {
            x: x - width / 2.0,
            y: y - height / 2.0,
            width,
            height,
            fill: colour([255, 255, 255]),
            stroke: None,
            stroke_width: None,
            opacity: Some(0.8),
        });
        let drop = f64::from(size) * 0.35; // from the middle of the letters to the base line
        self.text(x, y + drop, content, Text::new(size, Anchor::Middle, DARK));
    }

    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], stroke: Rgb, width: f64) {
        self.add_line(from, to, stroke, width, None);
    }

    pub(super) fn dashed(&mut self, from: [f64; 2], to: [f64; 2], stroke: Rgb, width: f64) {
        self.add_line(from, to, stroke, width, Some("6 4".to_owned()));
    }

    fn add_line(
        &mut self,
        [x1, y1]: [f64; 2],
        [x2, y2]: [f64; 2],
        stroke: Rgb,
        stroke_width: f64,
        stroke_dasharray: Option<String>,
    ) {
        let stroke = colour(stroke);
        self.scene.add(Primitive::Line { x1, y1, x2, y2, stroke, stroke_width, stroke_dasharray });
    }

    pub(super) fn polyline(&mut self, points: &[[f64; 2]], stroke: Rgb, stroke_width: f64) {
        self.scene.add(Primitive::PolyLine {
            points: points.iter().map(|&[x, y]| (x, y)).collect(),
            stroke: colour(stroke),
            stroke_width,
            stroke_dasharray: None,
        });
    }

    /// Many separate segments as one shape.
    pub(super) fn segments(&mut self, segments: &[[[f64; 2]; 2]], stroke: Rgb, width: f64) {
        let mut d = String::new();
        for [[x1, y1], [x2, y2]] in segments {
            d.push_str(&format!("M {x1:.2} {y1:.2} L {x2:.2} {y2:.2} "));
        }
        if !d.is_empty() {
            self.path(d, None, stroke, width);
        }
    }

    /// A filled polygon with its outline.
    pub(super) fn polygon(&mut self, corners: &[[f64; 2]], fill: Rgb, stroke: Rgb, width: f64) {
        let mut d = String::new();
        for (index, [x, y]) in corners.iter().enumerate() {
            d.push_str(if index == 0 { "M" } else { "L" });
            d.push_str(&format!(" {x:.2} {y:.2} "));
        }
        d.push('Z');
        self.path(d, Some(fill), stroke, width);
    }

    fn path(&mut self, d: String, fill: Option<Rgb>, stroke: Rgb, stroke_width: f64) {
        self.scene.add(Primitive::Path(Box::new(PathData {
            d,
            fill: fill.map(colour),
            stroke: colour(stroke),
            stroke_width,
            opacity: None,
            stroke_dasharray: None,
        })));
    }

    pub(super) fn disc(&mut self, [cx, cy]: [f64; 2], r: f64, fill: Rgb, stroke: Option<Rgb>) {
        self.scene.add(Primitive::Circle {
            cx,
            cy,
            r,
            fill: colour(fill),
            fill_opacity: None,
            stroke: stroke.map(colour),
            stroke_width: stroke.map(|_| 0.5),
        });
    }

    /// A filled rectangle without outline.
    pub(super) fn rectangle(&mut self, x: f64, y: f64, width: f64, height: f64, fill: Rgb) {
        self.scene.add(Primitive::Rect {
            x,
            y,
            width,
            height,
            fill: colour(fill),
            stroke: None,
            stroke_width: None,
            opacity: None,
        });
    }
}

fn colour([r, g, b]: Rgb) -> Color {
    Color::Rgb(r, g, b)
}

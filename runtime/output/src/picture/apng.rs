//! Animated PNG: each picture has only the rectangle that differs from the one before.

/// How much longer the last picture stands, in ms.
const REST: f64 = 1000.0;

/// PNG pictures of one size after each other, each for so many ms, the last for [`REST`] more.
pub(super) fn animated(pictures: &[Vec<u8>], delay: f64) -> Result<Vec<u8>, png::EncodingError> {
    let mut out = Vec::new();
    let first = pictures.first().map_or(&[][..], Vec::as_slice);
    let mut before = Pixels::read(first)?;
    let mut encoder = png::Encoder::new(&mut out, before.width as u32, before.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(pictures.len() as u32, 0)?;
    let [for_long, rest] = [delay, delay + REST].map(fraction);
    encoder.set_frame_delay(for_long.0, for_long.1)?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&before.rgb)?;
    for (place, picture) in pictures.iter().enumerate().skip(1) {
        let now = Pixels::read(picture)?;
        let [left, top, width, height] = now.difference(&before);
        if place + 1 == pictures.len() {
            writer.set_frame_delay(rest.0, rest.1)?;
        }
        writer.reset_frame_position()?;
        writer.set_frame_dimension(width as u32, height as u32)?;
        writer.set_frame_position(left as u32, top as u32)?;
        writer.write_image_data(&now.cut(left, top, width, height))?;
        before = now;
    }
    writer.finish()?;
    Ok(out)
}

/// A time in ms as the fraction of a second that a picture's header has room for.
fn fraction(ms: f64) -> (u16, u16) {
    if ms < f64::from(u16::MAX) { (ms as u16, 1000) } else { ((ms / 100.0) as u16, 10) }
}

/// A picture as its pixels.
struct Pixels {
    width: usize,
    height: usize,
    /// Row by row.
    rgb: Vec<u8>,
}

impl Pixels {
    fn read(encoded: &[u8]) -> Result<Pixels, png::EncodingError> {
        let wrong = |error: png::DecodingError| std::io::Error::other(error.to_string());
        let mut decoder = png::Decoder::new(std::io::Cursor::new(encoded));
        decoder.set_transformations(png::Transformations::normalize_to_color8());
        let mut reader = decoder.read_info().map_err(wrong)?;
        let mut pixels = vec![0; reader.output_buffer_size().unwrap_or(0)];
        let info = reader.next_frame(&mut pixels).map_err(wrong)?;
        let samples = info.color_type.samples();
        // The page is white and hides what is behind it: nothing is transparent.
        let rgb = match samples {
            3 => pixels,
            n => pixels.chunks_exact(n).flat_map(|pixel| [0, 1, 2].map(|k| pixel[k % n])).collect(),
        };
        Ok(Pixels { width: info.width as usize, height: info.height as usize, rgb })
    }

    fn row(&self, y: usize) -> &[u8] {
        &self.rgb[3 * self.width * y..3 * self.width * (y + 1)]
    }

    /// The rectangle outside of which both are the same: left, top, width, height, each of the last two at
    /// least 1.
    fn difference(&self, other: &Pixels) -> [usize; 4] {
        let differs = |y: &usize| self.row(*y) != other.row(*y);
        let rows: Vec<usize> = (0..self.height).filter(differs).collect();
        let (Some(&top), Some(&bottom)) = (rows.first(), rows.last()) else { return [0, 0, 1, 1] };
        let (mut left, mut right) = (self.width, 0);
        for y in rows {
            let pixels = self.row(y).chunks_exact(3).zip(other.row(y).chunks_exact(3));
            for (x, _) in pixels.enumerate().filter(|(_, (p, q))| p != q) {
                (left, right) = (left.min(x), right.max(x));
            }
        }
        [left, top, right + 1 - left, bottom + 1 - top]
    }

    fn cut(&self, left: usize, top: usize, width: usize, height: usize) -> Vec<u8> {
        let part = |y| &self.row(y)[3 * left..3 * (left + width)];
        (top..top + height).flat_map(part).copied().collect()
    }
}

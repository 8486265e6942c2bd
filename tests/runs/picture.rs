//! The picture of a run shows something.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::BufReader;

use crate::scenes::strip;

#[test]
fn the_picture_is_not_blank_and_says_what_it_shows() {
    let folder = strip();
    folder.run(&[]).expect(0);
    let png = BufReader::new(File::open(folder.out().join("picture.png")).unwrap());
    let mut reader = png::Decoder::new(png).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert!(info.width >= 600 && info.height >= 300, "{} x {}", info.width, info.height);
    assert_eq!(info.bit_depth, png::BitDepth::Eight);
    let samples = info.color_type.samples();
    let all: Vec<&[u8]> =
        pixels[..info.buffer_size()].chunks_exact(samples).map(|pixel| &pixel[..3]).collect();
    let colors: HashSet<&[u8]> = all.iter().copied().collect();
    // The body is coloured by its displacement: points of many different colours.
    let vivid = |c: &&&[u8]| c.iter().max().unwrap() - c.iter().min().unwrap() > 60;
    assert!(colors.iter().filter(vivid).count() > 30, "{} colours", colors.len());
    let inked = all.iter().filter(|pixel| pixel.iter().any(|c| *c < 200)).count();
    assert!(inked * 20 > all.len(), "{inked} of {} pixels are inked", all.len());
    let svg = fs::read_to_string(folder.out().join("picture.svg")).unwrap();
    for label in
        ["<svg", "</svg>", "reaction", "load parameter t", "Newton iteration", "displacement"]
    {
        assert!(svg.contains(label), "`{label}`");
    }
}

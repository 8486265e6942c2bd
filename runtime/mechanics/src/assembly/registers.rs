//! Four numbers side by side, and sums across four of them: as registers of 256 bits, or one number after
//! the other where a machine has none. The bits are the same: nothing is fused, and sums have one order.

use crate::geometry::each;

/// Four numbers.
pub(super) type Four = [f64; 4];

/// Four numbers in one half of a line of the caches: else every other register would be read from two lines.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))]
pub(super) struct Aligned(pub(super) Four);

/// Where a point is and how far it has moved, in one line of the caches.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(super) struct Placed {
    pub(super) position: Four,
    pub(super) displacement: Four,
}

/// What can be done with four numbers at once.
pub(super) trait Registers: Copy {
    /// A register.
    type Row: Copy;

    fn row(self, numbers: &Four) -> Self::Row;
    fn numbers(self, row: Self::Row) -> Four;
    fn add(self, x: Self::Row, y: Self::Row) -> Self::Row;
    fn subtract(self, x: Self::Row, y: Self::Row) -> Self::Row;
    fn multiply(self, x: Self::Row, y: Self::Row) -> Self::Row;
    fn divide(self, x: Self::Row, y: Self::Row) -> Self::Row;
    fn root(self, x: Self::Row) -> Self::Row;
    /// The larger of each two; of a number and of what is none, either.
    fn larger(self, x: Self::Row, y: Self::Row) -> Self::Row;
    /// The sum of each of four registers, `(x0 + x1) + (x2 + x3)`, side by side.
    fn sums(self, rows: [Self::Row; 4]) -> Self::Row;
    /// Each of four numbers in all of a register.
    fn spread(self, row: Self::Row) -> [Self::Row; 4];
}

/// One number after the other.
#[derive(Clone, Copy)]
pub(super) struct Portable;

impl Registers for Portable {
    type Row = Four;

    #[inline(always)]
    fn row(self, numbers: &Four) -> Four {
        *numbers
    }

    #[inline(always)]
    fn numbers(self, row: Four) -> Four {
        row
    }

    #[inline(always)]
    fn add(self, x: Four, y: Four) -> Four {
        each(|k| x[k] + y[k])
    }

    #[inline(always)]
    fn subtract(self, x: Four, y: Four) -> Four {
        each(|k| x[k] - y[k])
    }

    #[inline(always)]
    fn multiply(self, x: Four, y: Four) -> Four {
        each(|k| x[k] * y[k])
    }

    #[inline(always)]
    fn divide(self, x: Four, y: Four) -> Four {
        each(|k| x[k] / y[k])
    }

    #[inline(always)]
    fn root(self, x: Four) -> Four {
        x.map(f64::sqrt)
    }

    #[inline(always)]
    fn larger(self, x: Four, y: Four) -> Four {
        each(|k| if x[k] > y[k] { x[k] } else { y[k] })
    }

    #[inline(always)]
    fn sums(self, rows: [Four; 4]) -> Four {
        rows.map(|row| (row[0] + row[1]) + (row[2] + row[3]))
    }

    #[inline(always)]
    fn spread(self, row: Four) -> [Four; 4] {
        row.map(|x| [x; 4])
    }
}

#[cfg(target_arch = "x86_64")]
mod wide {
    use pulp::x86::V3;
    use pulp::{Simd as _, cast, f64x4};

    use super::{Four, Registers};

    impl Registers for V3 {
        type Row = f64x4;

        #[inline(always)]
        fn row(self, numbers: &Four) -> f64x4 {
            cast(*numbers)
        }

        #[inline(always)]
        fn numbers(self, row: f64x4) -> Four {
            cast(row)
        }

        #[inline(always)]
        fn add(self, x: f64x4, y: f64x4) -> f64x4 {
            self.add_f64s(x, y)
        }

        #[inline(always)]
        fn subtract(self, x: f64x4, y: f64x4) -> f64x4 {
            self.sub_f64s(x, y)
        }

        #[inline(always)]
        fn multiply(self, x: f64x4, y: f64x4) -> f64x4 {
            self.mul_f64s(x, y)
        }

        #[inline(always)]
        fn divide(self, x: f64x4, y: f64x4) -> f64x4 {
            self.div_f64s(x, y)
        }

        #[inline(always)]
        fn root(self, x: f64x4) -> f64x4 {
            self.sqrt_f64s(x)
        }

        #[inline(always)]
        fn larger(self, x: f64x4, y: f64x4) -> f64x4 {
            self.max_f64s(x, y)
        }

        #[inline(always)]
        fn sums(self, rows: [f64x4; 4]) -> f64x4 {
            let avx = self.avx;
            let low = avx._mm256_hadd_pd(cast(rows[0]), cast(rows[1]));
            let high = avx._mm256_hadd_pd(cast(rows[2]), cast(rows[3]));
            let first = avx._mm256_permute2f128_pd::<0b0010_0000>(low, high);
            let second = avx._mm256_permute2f128_pd::<0b0011_0001>(low, high);
            cast(avx._mm256_add_pd(first, second))
        }

        #[inline(always)]
        fn spread(self, row: f64x4) -> [f64x4; 4] {
            let (all, row) = (self.avx2, cast(row));
            [
                cast(all._mm256_permute4x64_pd::<0b0000_0000>(row)),
                cast(all._mm256_permute4x64_pd::<0b0101_0101>(row)),
                cast(all._mm256_permute4x64_pd::<0b1010_1010>(row)),
                cast(all._mm256_permute4x64_pd::<0b1111_1111>(row)),
            ]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What one does with rows, bit by bit.
    fn all_of<R: Registers>(r: R, of: &[Four; 4]) -> Vec<Four> {
        let rows = of.each_ref().map(|four| r.row(four));
        let [a, b, ..] = rows;
        let spread = r.spread(a);
        let found = [r.add(a, b), r.subtract(a, b), r.multiply(a, b), r.divide(a, b), r.root(a)];
        found.into_iter().chain([r.sums(rows)]).chain(spread).map(|row| r.numbers(row)).collect()
    }

    #[test]
    fn registers_have_the_bits_of_numbers() {
        let of: [Four; 4] = each(|r| each(|k| libm::exp(0.37 * (7 * r + k) as f64) / 3.0));
        let plain = all_of(Portable, &of);
        assert_eq!(plain[5][1], (of[1][0] + of[1][1]) + (of[1][2] + of[1][3]));
        assert_eq!(plain[8], [of[0][2]; 4]);
        #[cfg(target_arch = "x86_64")]
        if let Some(wide) = pulp::x86::V3::try_new() {
            assert_eq!(all_of(wide, &of), plain);
        }
    }
}

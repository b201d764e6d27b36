//! Chance that needs no memory: noise fixed to a surface, and Gaussian noise for pixels.

use rand::RngCore;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::sync::OnceLock;

/// What a stream of random numbers is for. One seed has a stream each, so that an option of one never changes another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Lay lengths and phases.
    Geometry,
    /// Oscillation, encoder, light.
    Motion,
    /// Dirt, oil, water, scratches.
    Finish,
    /// Foreign matter.
    Foreign,
    /// Kind, place and severity of defects.
    Defects,
    /// Fixed pattern of the sensor of a view.
    Sensor(usize),
    /// Noise of one frame of one view.
    Frame {
        /// The view.
        view: usize,
        /// The frame.
        frame: usize,
    },
    /// Noise of the contours of one view.
    Contours(usize),
}

/// The generator of a stream.
pub fn generator(seed: u64, stream: Stream) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(match stream {
        Stream::Geometry => 1,
        Stream::Motion => 2,
        Stream::Finish => 3,
        Stream::Defects => 4,
        Stream::Foreign => 5,
        Stream::Sensor(view) => 0x100 + view as u64,
        Stream::Contours(view) => 0x200 + view as u64,
        Stream::Frame { view, frame } => (1 << 48) | ((view as u64) << 40) | frame as u64,
    });
    rng
}

/// Value in 0..1 of a corner of the noise lattice.
fn corner(seed: u32, u: i32, v: i32) -> f32 {
    let mut h = seed ^ (u as u32).wrapping_mul(0x9E37_79B1) ^ (v as u32).wrapping_mul(0x85EB_CA77);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^= h >> 15;
    (h >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Where a line lies in a noise lattice along the rope. Exact however long the rope is; the same for the whole line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Along {
    cell: i32,
    part: f32,
}

impl Along {
    /// Position `x_mm` in cells of `cell_mm`.
    pub fn at(x_mm: f64, cell_mm: f64) -> Self {
        let u = x_mm / cell_mm;
        Self { cell: u.floor() as i32, part: ease((u - u.floor()) as f32) }
    }
}

fn ease(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

/// Smooth noise in 0..1 over a surface, seen along one line: an independent value per cell, blended between cells.
///
/// Places of a line come in order, so the two cells around the last one are kept.
#[derive(Debug, Clone, Copy)]
pub struct LineNoise {
    along: Along,
    ring: Option<i32>,
    seed: u32,
    cell: i32,
    low: f32,
    high: f32,
}

impl LineNoise {
    /// Noise on an endless strip.
    pub fn strip(along: Along) -> Self {
        Self { along, ring: None, seed: 0, cell: i32::MIN, low: 0.0, high: 0.0 }
    }

    /// Noise round the rope that closes after `ring` cells.
    pub fn ring(along: Along, ring: i32) -> Self {
        Self { ring: Some(ring), ..Self::strip(along) }
    }

    /// Value at `across` cells.
    #[inline]
    pub fn at(&mut self, seed: u32, across: f32) -> f32 {
        let truncated = across as i32;
        let cell = truncated - i32::from(across < truncated as f32); // floor, without a call
        if cell != self.cell || seed != self.seed {
            (self.seed, self.cell) = (seed, cell);
            self.low = self.edge(cell);
            self.high = self.edge(cell + 1);
        }
        let t = ease(across - cell as f32);
        self.low + t * (self.high - self.low)
    }

    fn edge(&self, cell: i32) -> f32 {
        let v = self.ring.map_or(cell, |ring| cell.rem_euclid(ring));
        let (near, far) = (corner(self.seed, self.along.cell, v), corner(self.seed, self.along.cell + 1, v));
        near + self.along.part * (far - near)
    }
}

/// [`LineNoise`] on a strip at a single place.
pub fn surface_noise(seed: u32, along: Along, across: f32) -> f32 {
    LineNoise::strip(along).at(seed, across)
}

/// Standard normal numbers from a table of quantiles: quick, bounded to about 3.5 sd.
pub struct GaussianStream {
    rng: ChaCha8Rng,
    bits: u64,
    left: u32,
}

const TABLE_BITS: u32 = 12;

fn quantiles() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let n = 1_usize << TABLE_BITS;
        (0..n).map(|k| normal_quantile((k as f64 + 0.5) / n as f64) as f32).collect()
    })
}

/// Quantile of the standard normal distribution: bisection on the series of its integral.
fn normal_quantile(p: f64) -> f64 {
    // Phi(x) = 1/2 + phi(x) (x + x^3/3 + x^5/15 + ...), which converges for every x
    let phi = |x: f64| {
        let (mut term, mut sum) = (x, x);
        for n in 1..200 {
            term *= x * x / (2 * n + 1) as f64;
            sum += term;
            if term.abs() < 1e-12 {
                break;
            }
        }
        0.5 + sum * (-x * x / 2.0).exp() / std::f64::consts::TAU.sqrt()
    };
    let (mut low, mut high) = (-6.0, 6.0);
    for _ in 0..50 {
        let middle = (low + high) / 2.0;
        if phi(middle) < p { low = middle } else { high = middle }
    }
    (low + high) / 2.0
}

impl GaussianStream {
    /// The noise of a stream.
    pub fn new(seed: u64, stream: Stream) -> Self {
        Self { rng: generator(seed, stream), bits: 0, left: 0 }
    }

    /// The next number, mean 0, sd 1.
    #[inline]
    pub fn draw(&mut self) -> f32 {
        if self.left == 0 {
            self.bits = self.rng.next_u64();
            self.left = 64 / TABLE_BITS;
        }
        let index = self.bits & ((1 << TABLE_BITS) - 1);
        self.bits >>= TABLE_BITS;
        self.left -= 1;
        quantiles()[index as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussian_noise_has_mean_0_and_sd_1() {
        let mut noise = GaussianStream::new(5, Stream::Contours(0));
        let draws: Vec<f64> = (0..100_000).map(|_| f64::from(noise.draw())).collect();
        let mean = draws.iter().sum::<f64>() / 1e5;
        let sd = (draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / 1e5).sqrt();
        assert!(mean.abs() < 0.015 && (sd - 1.0).abs() < 0.01, "{mean} {sd}"); // 5 standard errors
    }

    #[test]
    fn streams_of_one_seed_differ_and_repeat() {
        let first = |stream| GaussianStream::new(9, stream).rng.next_u64();
        assert_eq!(first(Stream::Frame { view: 1, frame: 2 }), first(Stream::Frame { view: 1, frame: 2 }));
        assert_ne!(first(Stream::Frame { view: 1, frame: 2 }), first(Stream::Frame { view: 2, frame: 1 }));
    }

    #[test]
    fn surface_noise_is_smooth_and_between_0_and_1() {
        let values: Vec<f32> =
            (0..4000).map(|k| surface_noise(3, Along::at(3e5 + f64::from(k) * 0.01, 1.0), -7.3)).collect();
        assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
        assert!(values.windows(2).all(|w| (w[0] - w[1]).abs() < 0.02));
        let along = Along::at(1.7, 1.0);
        let mut ring = LineNoise::ring(along, 9);
        assert!((ring.at(3, 0.25) - ring.at(3, 9.25)).abs() < 1e-6);
    }
}

//! How far an observation speaks for its neighbours in the density of eq. 18, and how finely gray is told apart. [Wacker13, sec. 4.2]

use super::histogram::GRAY_BINS;

/// The Gaussian window of the Parzen estimate (Sigma of eq. 19), and the quantisation of gray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bandwidths {
    /// Standard deviations along (gray, strand phase, wire phase, distance), in bins: the diagonal of eq. 19. Gray is counted in
    /// [`GRAY_BINS`], however finely it is told apart.
    pub sigma_bins: [f32; 4],
    /// Gray values that are told apart: [`GRAY_BINS`] divided by a power of two.
    pub gray_bins: usize,
}

/// Fewest gray values that are told apart.
const LEAST_GRAY_BINS: usize = 8;
/// The most that a bandwidth may be off the fixed one, as a factor.
const FARTHEST: f32 = 4.0;

impl Bandwidths {
    /// One choice for all ropes, by hand as in the paper, with gray the widest.
    pub const FIXED: Self = Self { sigma_bins: [1.2, 1.0, 0.8, 0.5], gray_bins: GRAY_BINS };

    /// Number of coordinates that [`Self::stepped`] changes.
    pub const COORDINATES: usize = 5;

    /// One step on in a coordinate: a standard deviation wider or narrower by the root of two, or half or twice as many gray values. The
    /// likelihood is flat about its maximum, so less than half a step is not worth looking for. `None` beyond the ends of the grid.
    pub fn stepped(mut self, coordinate: usize, wider: bool) -> Option<Self> {
        let Some(sigma) = self.sigma_bins.get_mut(coordinate) else {
            let gray_bins = if wider { self.gray_bins / 2 } else { self.gray_bins * 2 };
            return (LEAST_GRAY_BINS..=GRAY_BINS).contains(&gray_bins).then_some(Self { gray_bins, ..self });
        };
        let root = std::f32::consts::SQRT_2;
        *sigma *= if wider { root } else { 1.0 / root };
        let off = *sigma / Self::FIXED.sigma_bins[coordinate];
        (1.0 / FARTHEST..=FARTHEST).contains(&off).then_some(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_lead_there_and_back_and_end_with_the_grid() {
        for coordinate in 0..Bandwidths::COORDINATES {
            for wider in [false, true] {
                let mut steps = vec![Bandwidths::FIXED];
                steps.extend(std::iter::successors(Bandwidths::FIXED.stepped(coordinate, wider), |at| {
                    at.stepped(coordinate, wider)
                }));
                assert!(steps.len() <= 5, "{coordinate} {wider}: {}", steps.len());
                for pair in steps.windows(2) {
                    let back = pair[1].stepped(coordinate, !wider).unwrap();
                    let near = |(a, b): (&f32, &f32)| (a / b - 1.0).abs() < 1e-5;
                    assert!(back.sigma_bins.iter().zip(&pair[0].sigma_bins).all(near));
                    assert_eq!(back.gray_bins, pair[0].gray_bins);
                }
            }
        }
        assert_eq!(Bandwidths::FIXED.stepped(4, false), None, "gray is never told apart more finely");
    }
}

//! Solves block-tridiagonal systems: those of states along the rope that each depend on the one before.

use nalgebra::{SMatrix, SVector};

/// Block LDL^T factor of a block-tridiagonal matrix: inverses of the pivots, and the multipliers below them.
#[derive(Debug)]
pub(super) struct Banded<const S: usize> {
    pivots: Vec<SMatrix<f64, S, S>>,
    links: Vec<SMatrix<f64, S, S>>,
}

impl<const S: usize> Banded<S> {
    /// Factors the matrix with these diagonal blocks and the same block `off` below each.
    pub fn new(diagonal: &[SMatrix<f64, S, S>], off: SMatrix<f64, S, S>) -> Option<Self> {
        let mut pivots: Vec<SMatrix<f64, S, S>> = Vec::with_capacity(diagonal.len());
        let mut links = Vec::with_capacity(diagonal.len());
        for block in diagonal {
            let mut d = *block;
            if let Some(before) = pivots.last() {
                let link = off * before;
                d -= link * off.transpose();
                links.push(link);
            }
            pivots.push(d.try_inverse()?);
        }
        Some(Self { pivots, links })
    }

    pub fn solve(&self, mut b: Vec<SVector<f64, S>>) -> Vec<SVector<f64, S>> {
        for k in 1..b.len() {
            let carried = self.links[k - 1] * b[k - 1];
            b[k] -= carried;
        }
        for k in (0..b.len()).rev() {
            b[k] = self.pivots[k] * b[k];
            if k + 1 < b.len() {
                let carried = self.links[k].transpose() * b[k + 1];
                b[k] -= carried;
            }
        }
        b
    }

    /// The blocks on the diagonal of the inverse. [Takahashi's equations]
    pub fn diagonal_of_inverse(&self) -> Vec<SMatrix<f64, S, S>> {
        let mut diagonal = self.pivots.clone();
        for k in (0..self.links.len()).rev() {
            let of_later = self.links[k].transpose() * diagonal[k + 1] * self.links[k];
            diagonal[k] += of_later;
        }
        diagonal
    }
}

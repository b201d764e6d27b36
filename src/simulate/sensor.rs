//! From light to gray values: lens blur, vignetting, columns that are not alike, noise, eight bits.

use super::noise::GaussianStream;
use super::recipe::Recipe;
use super::trace::RAYS_PER_PX;
use rand::Rng;

/// Noise grows with light: sd = gray_noise * sqrt(1 + gray / this).
const SHOT_GRAY: f32 = 40.0;
/// Rays on each side of a pixel's centre that the blur gathers.
const GATHER: usize = 4;

/// What is fixed in the sensor of a view.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorPattern {
    gain: Vec<f32>,
    offset: Vec<f32>,
    noise: f32,
    weights: [f32; 2 * GATHER],
}

impl SensorPattern {
    /// The sensor of one view.
    pub fn random(rng: &mut impl Rng, recipe: &Recipe) -> Self {
        let n = recipe.sensor_px as usize;
        let middle = (n as f32 - 1.0) / 2.0;
        let mut gain: Vec<f32> = (0..n)
            .map(|c| {
                let u = (c as f32 - middle) / middle;
                (1.0 - recipe.vignetting as f32 * u * u) * (1.0 + 0.012 * (rng.random::<f32>() - 0.5))
            })
            .collect();
        let mut offset = vec![0.0; n];
        for _ in 0..recipe.bad_columns {
            let column = rng.random_range(0..n);
            if rng.random::<bool>() {
                gain[column] *= 0.78; // tired
            } else {
                offset[column] += 14.0; // hot
            }
        }
        let mut weights = [0.0; 2 * GATHER];
        for (k, weight) in weights.iter_mut().enumerate() {
            let away_px = (k as f32 + 0.5 - GATHER as f32) / RAYS_PER_PX as f32;
            *weight = (-0.5 * (away_px / recipe.blur_px as f32).powi(2)).exp();
        }
        let sum: f32 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Self { gain, offset, noise: recipe.gray_noise as f32, weights }
    }

    /// Turns the light of a line's rays (gray levels) into pixels.
    pub fn expose(&self, rays: &[f32], noise: &mut GaussianStream, row: &mut [u8]) {
        for (column, pixel) in row.iter_mut().enumerate() {
            let first = (column * RAYS_PER_PX + RAYS_PER_PX / 2) as isize - GATHER as isize;
            let mut light = 0.0;
            if first >= 0 && first as usize + 2 * GATHER <= rays.len() {
                let near: &[f32] = &rays[first as usize..first as usize + 2 * GATHER];
                light += self.weights.iter().zip(near).map(|(w, r)| w * r).sum::<f32>();
            } else {
                for (k, weight) in self.weights.iter().enumerate() {
                    let ray = (first + k as isize).clamp(0, rays.len() as isize - 1);
                    light += weight * rays[ray as usize];
                }
            }
            let gray = light * self.gain[column] + self.offset[column];
            let sd = self.noise * (1.0 + gray.max(0.0) / SHOT_GRAY).sqrt();
            *pixel = (gray + sd * noise.draw() + 0.5).clamp(0.0, 255.0) as u8;
        }
    }
}

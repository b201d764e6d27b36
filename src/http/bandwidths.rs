//! How smoothly gray values are learnt.

use crate::pipeline::bandwidths;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Who chooses the bandwidths of a training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BandwidthsBy {
    /// The rope itself: what predicts rope best that did not teach.
    HeldOut,
    /// Nobody: the same for all ropes.
    Fixed,
}

impl From<BandwidthsBy> for bandwidths::BandwidthsBy {
    fn from(by: BandwidthsBy) -> Self {
        match by {
            BandwidthsBy::HeldOut => Self::HeldOut,
            BandwidthsBy::Fixed => Self::Fixed,
        }
    }
}

impl From<bandwidths::BandwidthsBy> for BandwidthsBy {
    fn from(by: bandwidths::BandwidthsBy) -> Self {
        match by {
            bandwidths::BandwidthsBy::HeldOut => Self::HeldOut,
            bandwidths::BandwidthsBy::Fixed => Self::Fixed,
        }
    }
}

/// The bandwidths of the gray density of a model, in bins of its table.
#[derive(Debug, Serialize, ToSchema)]
pub struct Bandwidths {
    /// Who chose them.
    by: BandwidthsBy,
    /// Along the gray values.
    gray_sigma_bins: f32,
    /// Along the strand's phase in view.
    strand_phase_sigma_bins: f32,
    /// Along the wire's phase in view.
    wire_phase_sigma_bins: f32,
    /// Along the distance to the wire's centre line.
    distance_sigma_bins: f32,
    /// Gray values that are told apart.
    gray_bins: usize,
    /// Nats per held-out pixel over the fixed bandwidths; 0 with those.
    gained_nats_per_pixel: f64,
}

impl From<bandwidths::BandwidthsFit> for Bandwidths {
    fn from(fit: bandwidths::BandwidthsFit) -> Self {
        let [gray, strand, wire, distance] = fit.sigma_bins;
        Self {
            by: fit.by.into(),
            gray_sigma_bins: gray,
            strand_phase_sigma_bins: strand,
            wire_phase_sigma_bins: wire,
            distance_sigma_bins: distance,
            gray_bins: fit.gray_bins,
            gained_nats_per_pixel: fit.gained_nats_per_pixel,
        }
    }
}

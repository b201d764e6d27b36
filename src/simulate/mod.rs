//! Acquisitions of ropes that never existed, with everything about them known: for tests, the demo and benchmarks.
//!
//! A [`Recipe`] says what to make, a [`Scene`] is one rope made from it and a seed, [`render_view_frame`] is a frame of it
//! and [`write_acquisition`] the whole folder. Two kinds: the ArtificialRope of [Wacker13, sec. 6.1] and a photographic one.
//! Every frame is a function of scene, view and number alone, so frames can be rendered in any order and at once.

pub mod artificial; // the paper's kind: Gaussian centre lines
pub mod background;
pub mod camera;
pub mod cross_section; // where strands and wires are at one line
pub mod curve; // what drifts smoothly along the rope
pub mod defect_surface;
pub mod defects;
pub mod finish; // dirt, oil, water, scratches of intact rope
pub mod foreign; // tar, grease, water, fibres, grit, stains, paint on intact rope
mod gap; // torn ends, and what shows between them
pub mod labels; // where a defect can be seen
pub mod light;
pub mod noise;
pub mod photographic; // the kind that looks like rope in service
pub mod recipe;
pub mod recipe_limits; // and what it must keep to
pub mod scene;
pub mod sensor;
pub mod trace; // the nearest surface behind every pixel
pub mod truth; // the tables of what is true
pub mod write;

pub use labels::Label;
pub use recipe::{Background, Kind, Recipe};
pub use recipe_limits::RecipeError;
pub use scene::Scene;
pub use write::{RenderProgress, SimulateError, write_acquisition};

/// One frame: gray rows of `sensor_px`, as many as [`Scene::frame_height`] says.
///
/// A view or frame beyond the recipe has no rows.
pub fn render_view_frame(scene: &Scene, view: usize, frame: usize) -> Vec<u8> {
    if view >= scene.views() || frame >= scene.frames() {
        return Vec::new();
    }
    match scene.recipe().kind {
        Kind::Artificial => artificial::render(scene, view, frame),
        Kind::Photographic => photographic::render(scene, view, frame),
    }
}

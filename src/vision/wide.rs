//! Loops as wide as the processor's registers are.
//!
//! Released programs run on every processor of a kind, so compilers may not use the wide registers that only newer ones have. What is
//! given to [`wide`] is compiled for these too, as far as all of it is inlined, and the processor is asked at run time. Nothing is fused
//! but what says so (`mul_add`, which rounds alike on all), and no sum changes its order: results are the same to the last bit.

use pulp::Arch;

/// Runs a closure that is marked `#[inline(always)]`, as all functions must be that it shall make wide.
#[inline(always)]
pub(super) fn wide<R>(run: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(run)
}

//! Known answers: ropes whose lays and phases are known, and what the method makes of their images.

mod reference; // the fast alignment against the paper's own
mod simulated_ropes; // folder in, errors out

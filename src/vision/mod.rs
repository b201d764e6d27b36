//! The method of Wacker & Denzler, "Enhanced Anomaly Detection in Wire Ropes by Combining Structure and Appearance"
//! (cited as [Wacker13]): numbers and images in, numbers and images out.

pub mod rope;
pub mod strand;
pub mod wire;

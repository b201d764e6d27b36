//! How long something will take, in words.

/// `3 s left`, `12 min left`, `3.4 h left`; empty under a second, where it is not worth a word.
pub(crate) fn time_left(seconds: f64) -> String {
    match seconds {
        s if s >= 3600.0 => format!("{:.1} h left", s / 3600.0),
        s if s >= 90.0 => format!("{:.0} min left", s / 60.0),
        s if s >= 1.0 => format!("{s:.0} s left"),
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::time_left;

    #[test]
    fn the_unit_follows_the_size() {
        let words = [0.4, 42.2, 89.0, 90.0, 3600.0, f64::NAN].map(time_left);
        assert_eq!(words, ["", "42 s left", "89 s left", "2 min left", "1.0 h left", ""]);
    }
}

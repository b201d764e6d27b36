//! Times: whole milliseconds inside, RFC 3339 outside.

use super::Problem;

/// `2026-03-01T08:30:00.25Z`.
pub fn rfc3339(ms: i64) -> String {
    jiff::Timestamp::from_millisecond(ms).map_or_else(|_| format!("{ms} ms"), |t| t.to_string())
}

/// Reads RFC 3339 into ms since 1970. Errors: a problem that names the field.
pub fn parse(field: &str, text: &str) -> Result<i64, Problem> {
    text.parse::<jiff::Timestamp>().map(jiff::Timestamp::as_millisecond).map_err(|e| {
        Problem::out_of_range(format!("{field} is {text:?}, which is not an RFC 3339 time: {e}"))
            .with("field", field)
            .with("value", text)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_survives_the_way_out_and_in() {
        let ms = parse("acquired_at", "2026-03-01T09:30:00.250+01:00").unwrap();
        assert_eq!(rfc3339(ms), "2026-03-01T08:30:00.25Z");
        assert_eq!(parse("t", &rfc3339(ms)).unwrap(), ms);
        assert!(parse("t", "yesterday").is_err());
    }
}

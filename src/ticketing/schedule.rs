//! When an attempt that failed is made again.

use rand::Rng;
use std::time::Duration;

/// Waits after the first, second, ... failed attempt in s; after the last one the delivery is dead. About three days in all, the
/// shape that Standard Webhooks recommends: a receiver may be down over a weekend.
pub const WAITS_S: [u64; 9] = [5, 300, 1_800, 7_200, 18_000, 36_000, 50_400, 72_000, 86_400];
/// Part of a wait that chance adds or takes away, so that receivers coming back are not met by everything at once.
pub const JITTER: f64 = 0.2;
/// Longest `Retry-After` that is honoured: a receiver may ask for rest, not for silence.
pub const MAX_RETRY_AFTER: Duration = Duration::from_secs(86_400);

/// The wait after `failed` attempts (1 or more) in ms, with jitter from `rng`; `None` when the schedule has ended.
/// A longer wait asked for by the receiver (`retry_after`) takes the place of a shorter one.
pub fn wait_ms(waits_s: &[u64], failed: usize, retry_after: Option<Duration>, rng: &mut impl Rng) -> Option<i64> {
    let wait_ms = *waits_s.get(failed.checked_sub(1)?)? as f64 * 1000.0;
    let jittered_ms = (wait_ms * (1.0 + rng.random_range(-JITTER..=JITTER))) as i64;
    let asked_ms = retry_after.map_or(0, |wait| wait.min(MAX_RETRY_AFTER).as_millis() as i64);
    Some(jittered_ms.max(asked_ms))
}

/// Reads `Retry-After`: seconds or an HTTP date, against `now_ms` (ms since 1970). `None` for anything else.
pub fn retry_after(value: &str, now_ms: i64) -> Option<Duration> {
    let value = value.trim();
    if let Ok(seconds) = value.parse::<u64>() {
        return Some(Duration::from_secs(seconds));
    }
    let date = jiff::fmt::rfc2822::DateTimeParser::new().parse_timestamp(value).ok()?;
    Some(Duration::from_millis(u64::try_from(date.as_millisecond() - now_ms).unwrap_or(0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn waits_grow_within_their_jitter_and_end() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for (n, wait_s) in WAITS_S.iter().enumerate() {
            let ms = wait_ms(&WAITS_S, n + 1, None, &mut rng).unwrap() as f64;
            assert!((ms / (*wait_s as f64 * 1000.0) - 1.0).abs() <= JITTER, "wait {n} is {ms} ms");
        }
        assert_eq!(wait_ms(&WAITS_S, WAITS_S.len() + 1, None, &mut rng), None);
    }

    #[test]
    fn a_receiver_may_ask_for_more_time_but_not_for_ever() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        assert_eq!(wait_ms(&WAITS_S, 1, Some(Duration::from_secs(60)), &mut rng), Some(60_000));
        assert_eq!(wait_ms(&WAITS_S, 1, Some(Duration::from_secs(1 << 40)), &mut rng), Some(86_400_000));
        assert!(wait_ms(&WAITS_S, 1, Some(Duration::ZERO), &mut rng).unwrap() >= 4_000);
    }

    #[test]
    fn retry_after_is_seconds_or_a_date() {
        let now_ms = 784_111_777_000; // Sun, 06 Nov 1994 08:49:37 GMT
        assert_eq!(retry_after("120", now_ms), Some(Duration::from_secs(120)));
        assert_eq!(retry_after("Sun, 06 Nov 1994 08:50:37 GMT", now_ms), Some(Duration::from_secs(60)));
        assert_eq!(retry_after("Sun, 06 Nov 1994 08:00:00 GMT", now_ms), Some(Duration::ZERO));
        assert_eq!(retry_after("soon", now_ms), None);
    }
}

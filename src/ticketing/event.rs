//! What a receiver is told: a CloudEvents 1.0 body in structured JSON.

use crate::store::outbox::{Cause, DefectFacts};
use serde_json::{Value, json};

/// Media type of the body.
pub const CONTENT_TYPE: &str = "application/cloudevents+json; charset=utf-8";
/// Rope shown before and after the defect in the linked images, in m: the context a person needs to judge it (users ask for 5 cm).
const CONTEXT_M: f64 = 0.05;

/// The CloudEvents type of an event.
pub fn event_type(cause: &Cause) -> &'static str {
    match cause {
        Cause::Verdict { .. } => "org.ropescope.defect.confirmed",
        Cause::Level { .. } => "org.ropescope.defect.level-reached",
    }
}

/// The body of the event `id` that happened at `occurred_ms` (ms since 1970). `base_url` is where people reach this service,
/// without a slash at the end; links start with it.
pub fn body(id: &str, occurred_ms: i64, facts: &DefectFacts, base_url: &str) -> Value {
    let api = format!("{base_url}/api/v1");
    // Rope metres may be negative; pictures are cut to the lines that there are.
    let (from_m, to_m) = (facts.from_m - CONTEXT_M, facts.to_m + CONTEXT_M);
    let map = |name: &str| {
        format!(
            "{api}/inspections/{}/views/{}/{name}.png?from_m={from_m:.3}&to_m={to_m:.3}",
            facts.inspection_id, facts.view
        )
    };
    json!({
        "specversion": "1.0",
        "type": event_type(&facts.cause),
        "source": api,
        "id": id,
        "subject": format!("defects/{}", facts.defect_id),
        "time": rfc3339(occurred_ms),
        "datacontenttype": "application/json",
        "data": {
            "defect_id": facts.defect_id,
            "inspection_id": facts.inspection_id,
            "rope_id": facts.rope_id,
            "rope": facts.rope,
            "ropeway": facts.ropeway,
            "from_m": facts.from_m,
            "to_m": facts.to_m,
            "strand": facts.strand,
            "wire": facts.wire,
            "peak_score": facts.peak_score,
            "view": facts.view,
            "cause": facts.cause,
            "links": {
                "defect": format!("{api}/defects/{}", facts.defect_id),
                "ticket": format!("{api}/defects/{}/ticket", facts.defect_id),
                "image": map("image"),
                "likelihood": map("likelihood"),
            },
        },
    })
}

/// RFC 3339 in UTC of ms since 1970; the epoch itself for times no calendar has.
fn rfc3339(ms: i64) -> String {
    jiff::Timestamp::from_millisecond(ms).unwrap_or(jiff::Timestamp::UNIX_EPOCH).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use uuid::Uuid;

    fn facts(from_m: f64, to_m: f64) -> DefectFacts {
        DefectFacts {
            defect_id: Uuid::from_u128(1),
            inspection_id: Uuid::from_u128(2),
            rope_id: Uuid::from_u128(3),
            rope: "carrying rope".into(),
            ropeway: "North".into(),
            from_m,
            to_m,
            strand: Some(3),
            wire: None,
            peak_score: 7.5,
            view: 2,
            cause: Cause::Level { ticket_level: 6.0 },
        }
    }

    #[test]
    fn body_has_what_cloudevents_requires_and_links_with_context() {
        let event = body("defect_1", 1_700_000_000_000, &facts(0.02, 1.25), "https://ropes.example");
        assert_eq!(event["specversion"], "1.0");
        assert_eq!(event["type"], "org.ropescope.defect.level-reached");
        assert_eq!(event["time"], "2023-11-14T22:13:20Z");
        assert_eq!(event["data"]["wire"], Value::Null);
        assert_eq!(
            event["data"]["links"]["image"],
            "https://ropes.example/api/v1/inspections/00000000-0000-0000-0000-000000000002/views/2/image.png?from_m=-0.030&to_m=1.300"
        );
    }

    #[test]
    fn links_of_a_defect_at_negative_metres_show_these() {
        let event = body("defect_1", 0, &facts(-12.5, -12.4), "https://ropes.example");
        for link in ["image", "likelihood"] {
            let link = event["data"]["links"][link].as_str().unwrap();
            assert!(link.ends_with("?from_m=-12.550&to_m=-12.350"), "{link}");
        }
    }
}

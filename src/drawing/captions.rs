//! What is written above the pictures of a card.

use crate::pipeline::results::{AlarmRow, DefectRow, Kind};

/// What is written above the pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct Captions {
    /// What it is, in a few words.
    pub title: String,
    /// Where it is, how it was judged and by what.
    pub facts: Vec<String>,
}

impl Captions {
    /// Of a defect of a rope: what people decided in a few words, and the line score above which alarms begin.
    pub fn of(defect: &DefectRow, rope: &str, decision: &str, threshold: Option<f64>) -> Self {
        let named =
            |what: &str, number: Option<usize>| number.map_or(format!("{what} unknown"), |n| format!("{what} {n}"));
        let (from_m, to_m) = (defect.from_m, defect.to_m);
        let angle = defect.angle_deg.map_or(String::new(), |angle| format!(", {angle:.0} degrees round the rope"));
        let place = format!(
            "rope metre {from_m:.4} to {to_m:.4} ({:.1} mm), {}, {}{angle}",
            (to_m - from_m) * 1000.0,
            named("strand", defect.strand),
            named("wire", defect.wire)
        );
        let likely = defect.suggestion.as_ref().map(|s| {
            let kind = match s.kind {
                Kind::Unclear => "kind unclear".to_owned(),
                kind => format!("likely {}", kind.name().replace('_', " ")),
            };
            format!("{kind}: {}; {:.0} mm2 over the threshold", s.why, s.area_mm2)
        });
        Self {
            title: format!("Surface anomaly {} of {rope}: {decision}", defect.id),
            facts: [Some(place), Some(scores(defect, threshold)), likely].into_iter().flatten().collect(),
        }
    }
}

fn scores(defect: &DefectRow, threshold: Option<f64>) -> String {
    let mut alarms: Vec<&AlarmRow> = defect.alarms.iter().collect();
    alarms.sort_by(|a, b| b.peak_score.total_cmp(&a.peak_score));
    let best = alarms.first().map_or(0, |alarm| alarm.view);
    let mut scores = format!("score {:.1} in view {best}", defect.peak_score);
    if let Some(threshold) = threshold {
        scores += &format!(", alarms begin above {threshold:.1}");
    }
    let elsewhere = |alarm: &AlarmRow| match alarm.strand {
        Some(strand) if defect.strand.is_some_and(|of_peak| of_peak != strand) => format!(" on strand {strand}"),
        _ => String::new(),
    };
    let other = |a: &&AlarmRow| format!("{:.1} in view {}{}", a.peak_score, a.view, elsewhere(a));
    let others: Vec<_> = alarms.iter().skip(1).map(other).collect();
    if !others.is_empty() {
        scores += &format!("; further alarms: {}", others.join(", "));
    }
    scores
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::results::Suggestion;

    fn defect(kind: Kind) -> DefectRow {
        let alarm = |view, peak_score| AlarmRow {
            view,
            strand: Some(2),
            first_line: 0,
            last_line: 9,
            first_column: 0,
            last_column: 9,
            peak_score,
        };
        DefectRow {
            id: 3,
            from_m: 12.5,
            to_m: 12.504,
            strand: Some(2),
            peak_score: 9.04,
            alarms: vec![alarm(0, 7.5), alarm(1, 9.04)],
            suggestion: Some(Suggestion {
                kind,
                why: "dark over 4 mm".into(),
                length_mm: 4.0,
                width_wires: 1.0,
                area_mm2: 5.6,
                gray_steps: -6.0,
                texture: 1.2,
                beyond_outline_mm: 0.0,
            }),
            ..DefectRow::default()
        }
    }

    #[test]
    fn captions_say_where_it_is_how_it_was_judged_and_what_it_is_likely_to_be() {
        let captions = Captions::of(&defect(Kind::MissingWire), "track 1", "nobody decided yet", Some(6.2));
        assert_eq!(captions.title, "Surface anomaly 3 of track 1: nobody decided yet");
        assert_eq!(
            captions.facts,
            [
                "rope metre 12.5000 to 12.5040 (4.0 mm), strand 2, wire unknown",
                "score 9.0 in view 1, alarms begin above 6.2; further alarms: 7.5 in view 0",
                "likely missing wire: dark over 4 mm; 6 mm2 over the threshold"
            ]
        );
        let mut on_a_border = defect(Kind::MissingWire);
        on_a_border.alarms[0].strand = Some(3);
        let captions = Captions::of(&on_a_border, "track 1", "nobody decided yet", None);
        assert_eq!(captions.facts[1], "score 9.0 in view 1; further alarms: 7.5 in view 0 on strand 3");
        let unclear = Captions::of(&defect(Kind::Unclear), "track 1", "dismissed", None);
        assert!(unclear.facts[2].starts_with("kind unclear: "), "{:?}", unclear.facts);
    }
}

//! One picture of an inspection: the whole rope in every view with its likelihood map and what was planted and found, and the
//! worst defects close up.

use super::compare::Truth;
use anyhow::Context;
use image::RgbImage;
use ropescope::drawing::{Canvas, Colour, Size, heat};
use ropescope::upload::Client;
use serde_json::Value;

const PAPER: Colour = [250, 250, 248];
const INK: Colour = [40, 44, 52];
const FAINT: Colour = [150, 154, 162];
const PLANTED: Colour = [0, 130, 150];
const FOUND: Colour = [225, 85, 25];
const UNSEEN: Colour = [205, 205, 205];

/// Sizes in px. The rope lies: metres to the right.
const MARGIN: i64 = 48;
const LENGTH: i64 = 1800;
const STRIP: i64 = 84;
const BAR: i64 = 10;
const VIEW_GAP: i64 = 26;
const HEAD: i64 = 110;
const CLOSE_UPS: usize = 4;
const CLOSE_GAP: i64 = 24;
const CLOSE_WIDTH: i64 = (LENGTH - 3 * CLOSE_GAP) / CLOSE_UPS as i64;
const CLOSE_HEIGHT: i64 = 300;
/// Rope in a close-up in m.
const CLOSE_M: f64 = 0.05;

/// Draws the inspection; pictures and maps come from the service.
pub(super) async fn draw(
    client: &Client,
    inspection_id: &str,
    truth: &Truth,
    found: &Value,
) -> anyhow::Result<RgbImage> {
    let found = found["items"].as_array().map(Vec::as_slice).unwrap_or_default();
    let metres = truth.lines as f64 * truth.pitch_m;
    let per_view = STRIP * 2 + BAR * 2 + 6 + VIEW_GAP;
    let overview_height = per_view * truth.views as i64 + 40;
    let close_height = if found.is_empty() { 0 } else { CLOSE_HEIGHT * 2 + 40 };
    let height = HEAD + overview_height + close_height + MARGIN;
    let mut canvas = Canvas::new((LENGTH + 2 * MARGIN) as u32, height as u32, PAPER);
    head(&mut canvas, metres, found.len(), truth.planted().len());

    let source = Source { client, inspection_id };
    let x_of = |m: f64| MARGIN + (m / metres * LENGTH as f64) as i64;
    let mut y = HEAD;
    for view in 0..truth.views {
        canvas.text(MARGIN, y - 20, Size::Body, INK, &format!("view {view}"));
        let range = (0.0, metres);
        source.paste(&mut canvas, view, "image", range, (MARGIN, y, LENGTH, STRIP)).await?;
        let bars = y + STRIP + 2;
        canvas.fill(MARGIN, bars, LENGTH, BAR * 2 + 2, [236, 237, 239]);
        for label in truth.labels.iter().filter(|l| l.view == view) {
            let (from, to) = (label.first_line as f64 * truth.pitch_m, label.last_line as f64 * truth.pitch_m);
            canvas.fill(x_of(from), bars, (x_of(to) - x_of(from)).max(4), BAR, PLANTED);
        }
        for alarm in alarms(found).filter(|a| a["view"].as_u64() == Some(view as u64)) {
            let (from, to) = lines(alarm, truth.pitch_m);
            canvas.fill(x_of(from), bars + BAR + 2, (x_of(to) - x_of(from)).max(4), BAR, FOUND);
        }
        source.paste(&mut canvas, view, "likelihood", range, (MARGIN, bars + BAR * 2 + 4, LENGTH, STRIP)).await?;
        y += per_view;
    }
    scale(&mut canvas, y - VIEW_GAP + 8, metres);
    close_ups(&mut canvas, &source, truth, found, y + 40).await?;
    Ok(canvas.0)
}

fn head(canvas: &mut Canvas, metres: f64, found: usize, planted: usize) {
    canvas.text(
        MARGIN,
        24,
        Size::Heading,
        INK,
        &format!("{metres:.1} m of rope: {planted} defects planted, {found} reported"),
    );
    let mut x = MARGIN;
    for (colour, text) in [(PLANTED, "planted"), (FOUND, "found"), (UNSEEN, "not inspected")] {
        canvas.fill(x, 62, 16, 14, colour);
        x = canvas.text(x + 22, 61, Size::Body, INK, text) + 24;
    }
    x = canvas.text(x, 61, Size::Body, INK, "likelihood: as learnt") + 4;
    for step in 0..120 {
        canvas.fill(x + step, 62, 1, 14, heat(255 - (step * 255 / 119) as u8));
    }
    canvas.text(x + 128, 61, Size::Body, INK, "unlikely");
}

fn scale(canvas: &mut Canvas, y: i64, metres: f64) {
    let step_m = if metres > 12.0 {
        5.0
    } else if metres > 2.0 {
        0.5
    } else {
        0.1
    };
    let mut n = 0;
    while f64::from(n) * step_m <= metres + 1e-9 {
        let m = f64::from(n) * step_m;
        let x = MARGIN + (m / metres * (LENGTH - 1) as f64) as i64;
        canvas.fill(x, y - 6, 1, 6, FAINT);
        canvas.text((x - 12).min(MARGIN + LENGTH - 52), y + 3, Size::Body, FAINT, &format!("{m:.1} m"));
        n += 1;
    }
}

/// The found defects with the highest scores, each in the view that saw it best: image above, map below.
async fn close_ups(
    canvas: &mut Canvas,
    source: &Source<'_>,
    truth: &Truth,
    found: &[Value],
    y: i64,
) -> anyhow::Result<()> {
    let mut worst: Vec<&Value> = found.iter().collect();
    worst.sort_by(|a, b| score(b).total_cmp(&score(a)));
    let metres = truth.lines as f64 * truth.pitch_m;
    for (place, defect) in worst.into_iter().take(CLOSE_UPS).enumerate() {
        let list = defect["alarms"].as_array().map(Vec::as_slice).unwrap_or_default();
        let Some(alarm) = list.iter().max_by(|a, b| score(a).total_cmp(&score(b))) else { continue };
        let view = alarm["view"].as_u64().unwrap_or(0) as usize;
        let (from, to) = lines(alarm, truth.pitch_m);
        let half_m = CLOSE_M.min(metres) / 2.0;
        let middle = ((from + to) / 2.0).clamp(half_m, metres - half_m);
        let range = (middle - half_m, middle + half_m);
        let x = MARGIN + place as i64 * (CLOSE_WIDTH + CLOSE_GAP);
        canvas.text(x, y, Size::Body, INK, &format!("{middle:.3} m, view {view}, score {:.1}", score(alarm)));
        for (row, name) in [(0, "image"), (1, "likelihood")] {
            let top = y + 24 + row * (CLOSE_HEIGHT + 6);
            source.paste(canvas, view, name, range, (x, top, CLOSE_WIDTH, CLOSE_HEIGHT)).await?;
            let x_of = |m: f64| x + (((m - range.0) / (range.1 - range.0)).clamp(0.0, 1.0) * CLOSE_WIDTH as f64) as i64;
            let column = |key: &str| alarm[key].as_f64().unwrap_or(0.0) / columns() * CLOSE_HEIGHT as f64;
            let (upper, lower) = (column("first_column") as i64, column("last_column") as i64);
            canvas.frame(
                x_of(from) - 4,
                top + upper - 4,
                (x_of(to) - x_of(from) + 8).max(8),
                (lower - upper + 8).max(8),
                FOUND,
            );
        }
    }
    if !found.is_empty() {
        let text = format!("{:.0} mm of rope each; the frame is the alarm", CLOSE_M * 1000.0);
        canvas.text(MARGIN, y + 24 + 2 * CLOSE_HEIGHT + 16, Size::Body, FAINT, &text);
    }
    Ok(())
}

fn alarms(found: &[Value]) -> impl Iterator<Item = &Value> {
    found.iter().filter_map(|d| d["alarms"].as_array()).flatten()
}

fn score(value: &Value) -> f64 {
    value["peak_score"].as_f64().unwrap_or(0.0)
}

/// First and last metre of an alarm.
fn lines(alarm: &Value, pitch_m: f64) -> (f64, f64) {
    let line = |key: &str| alarm[key].as_f64().unwrap_or(0.0) * pitch_m;
    (line("first_line"), line("last_line"))
}

/// Columns of the sensor of simulated acquisitions.
fn columns() -> f64 {
    f64::from(ropescope::simulate::Recipe::photographic().sensor_px)
}

/// Where pictures come from.
struct Source<'a> {
    client: &'a Client,
    inspection_id: &'a str,
}

impl Source<'_> {
    /// Fetches a range of a view and puts it into a box (x, y, width, height), turned so that the rope lies.
    async fn paste(
        &self,
        canvas: &mut Canvas,
        view: usize,
        name: &str,
        (from_m, to_m): (f64, f64),
        (x, y, width, height): (i64, i64, i64, i64),
    ) -> anyhow::Result<()> {
        let path = format!(
            "/inspections/{}/views/{view}/{name}.png?from_m={from_m:.4}&to_m={to_m:.4}&width={height}&height={width}",
            self.inspection_id
        );
        let bytes = self.client.get_bytes(&path).await?;
        let picture = image::load_from_memory(&bytes).with_context(|| path)?.into_luma_alpha8();
        for column in 0..width {
            for row in 0..height {
                // Pictures are never enlarged by the service: that is done here.
                let line = (column * i64::from(picture.height()) / width) as u32;
                let across = (row * i64::from(picture.width()) / height) as u32;
                let image::LumaA([gray, alpha]) = *picture.get_pixel(across, line);
                let colour = match (name, alpha) {
                    (_, 0) => UNSEEN,
                    ("likelihood", _) => heat(gray),
                    _ => [gray; 3],
                };
                canvas.dot(x + column, y + row, colour);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::demo::compare::tests::{found, truth};
    use axum::extract::{Path, Query, State};
    use std::collections::HashMap;

    /// Answers with a frame of the simulated rope, and with its negative for the map.
    async fn answer(
        State(frame): State<image::GrayImage>,
        Path((_, _, name)): Path<(String, usize, String)>,
        Query(query): Query<HashMap<String, String>>,
    ) -> Vec<u8> {
        let (width, height) = (query["width"].parse().unwrap(), query["height"].parse().unwrap());
        let mut picture = image::imageops::resize(&frame, width, height, image::imageops::FilterType::Triangle);
        if name == "likelihood.png" {
            image::imageops::invert(&mut picture);
        }
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    #[tokio::test]
    async fn the_picture_shows_what_was_planted_and_found() {
        let (folder, truth) = truth();
        let frame = image::open(folder.path().join("view0/frame_000000.png")).unwrap().into_luma8();
        let router = axum::Router::new()
            .route("/api/v1/inspections/{id}/views/{view}/{name}", axum::routing::get(answer))
            .with_state(frame);
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        tokio::spawn(async move { axum::serve(listener, router).await.unwrap() });
        let client = Client::new(&url, "rope_x_y", std::time::Duration::from_secs(5), 1).unwrap();
        let picture = draw(&client, "i", &truth, &found(&truth)).await.unwrap();
        for colour in [PLANTED, FOUND, INK] {
            let dots = picture.pixels().filter(|p| p.0 == colour).count();
            assert!(dots > 300, "{colour:?}: {dots}");
        }
    }
}

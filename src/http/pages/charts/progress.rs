//! Scores over time, with the best so far.

use std::sync::Arc;

use super::drawing::{Drawing, short};
use super::figure::{Figure, FigureRow, share};
use super::runs::Charted;
use crate::clock::{DAY_MS, rfc3339};
use crate::http::pages::html;
use plumbline_engine::grading::standings::Standing;

/// Rectangle of the scales: left, top, width and height.
const PLOT: [f64; 4] = [56.0, 26.0, 600.0, 280.0];
/// Size of the chart.
const SIZE: [f64; 2] = [720.0, 340.0];
/// Greatest number of dates on the time scale, after the first.
const DATES: i64 = 5;

/// Draws the scores of runs by the time at which they finished.
pub fn draw(charted: &Charted) -> Option<Figure> {
    let mut runs: Vec<&Arc<Standing>> = charted.runs.iter().collect();
    runs.sort_by_key(|run| (run.finished_at_ms, &run.run));
    let (first, last) = (runs.first()?.finished_at_ms, runs.last()?.finished_at_ms);
    // From midnight to midnight, with a date every so many days.
    let (from, to) = (first.div_euclid(DAY_MS), last.div_euclid(DAY_MS) + 1);
    let days = (to - from).max(1);
    let (begin, span) = (from * DAY_MS, days * DAY_MS);
    let every = (days + DATES - 1) / DATES;
    let [left, top, width, height] = PLOT;
    let x = |ms: i64| left + (ms - begin) as f64 / span as f64 * width;
    let y = |rate: f64| top + (1.0 - rate) * height;
    let mut drawing = Drawing::new(SIZE[0], SIZE[1]);
    for tick in 0..=4 {
        let share = f64::from(tick) / 4.0;
        drawing.line("grid", [left, y(share)], [left + width, y(share)]);
        drawing.text("soft end", [left - 8.0, y(share) + 4.0], &format!("{:.0} %", share * 100.0));
    }
    for ms in (0..=days).step_by(every as usize).map(|day| begin + day * DAY_MS) {
        drawing.line("grid", [x(ms), top], [x(ms), top + height]);
        drawing.text("soft mid", [x(ms), top + height + 20.0], &rfc3339(ms)[..10]);
    }
    let mut best = -1.0;
    let (mut front, mut records) = (Vec::new(), Vec::new());
    for run in &runs {
        let (at, rate) = (x(run.finished_at_ms), run.rate().unwrap_or_default());
        let is_record = rate > best;
        if is_record {
            if best >= 0.0 {
                front.push([at, y(best)]);
            }
            front.push([at, y(rate)]);
            best = rate;
        }
        records.push(is_record);
    }
    front.push([left + width, y(best.max(0.0))]);
    drawing.way("front", &front);
    let mut labelled = f64::NEG_INFINITY;
    for (run, is_record) in runs.iter().zip(&records) {
        let at = [x(run.finished_at_ms), y(run.rate().unwrap_or_default())];
        let told = format!("{}: {} on {}", run.agent, html::percent(run.rate()), &rfc3339(run.finished_at_ms)[..10]);
        drawing.mark(if *is_record { "point" } else { "faint" }, 0, at, &told);
        // Names of the best so far, where they have room.
        if *is_record && at[0] - labelled > 130.0 {
            let is_late = at[0] > left + width * 0.75;
            drawing.text(if is_late { "end" } else { "" }, [at[0], at[1] - 10.0], &short(&run.agent, 20));
            labelled = at[0];
        }
    }
    let row = |(run, is_record): (&&Arc<Standing>, &bool)| FigureRow {
        name: run.agent.clone(),
        run: Some(run.run.clone()),
        cells: vec![
            rfc3339(run.finished_at_ms)[..10].to_owned(),
            html::percent(run.rate()),
            if *is_record { "yes" } else { "no" }.to_owned(),
        ],
        values: vec![rfc3339(run.finished_at_ms), share(run.rate()), is_record.to_string()],
    };
    let title = "Progress over time";
    let about =
        "Each point is a run at the time when it finished. The line is the best score up to that time.".to_owned();
    Some(Figure {
        svg: drawing.finish(title, &about),
        title,
        about,
        size: SIZE,
        head: ["agent", "finished", "score", "best up to then"].map(ToOwned::to_owned).into(),
        columns: Some(["agent", "finished", "score", "best_up_to_then"].map(ToOwned::to_owned).into()),
        rows: runs.iter().zip(&records).map(row).collect(),
    })
}

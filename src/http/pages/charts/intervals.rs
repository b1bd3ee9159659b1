//! Scores of the best runs with their intervals.

use super::drawing::{Drawing, short};
use super::figure::{Figure, FigureRow, share};
use super::runs::Charted;
use crate::http::pages::html;

/// Greatest number of runs in the chart.
const MAX_RUNS: usize = 30;
/// Height of a row, in pixels.
const ROW: f64 = 24.0;
/// Left end of the scale, and its length.
const SCALE: [f64; 2] = [230.0, 420.0];

/// Draws the scores of the best runs with their intervals.
pub fn draw(charted: &Charted) -> Option<Figure> {
    let runs = charted.runs.get(..charted.runs.len().min(MAX_RUNS)).filter(|runs| !runs.is_empty())?;
    let (width, height) = (720.0, 30.0 + ROW * runs.len() as f64);
    let mut drawing = Drawing::new(width, height);
    let x = |share: f64| SCALE[0] + share * SCALE[1];
    for tick in 0..=4 {
        let share = f64::from(tick) / 4.0;
        drawing.line("grid", [x(share), 0.0], [x(share), height - 22.0]);
        drawing.text("soft mid", [x(share), height - 6.0], &format!("{:.0} %", share * 100.0));
    }
    for (i, run) in runs.iter().enumerate() {
        let y = ROW * (i as f64 + 0.5);
        let rate = run.rate().unwrap_or_default();
        let told = format!("{}: {} ({} %)", run.agent, html::percent(run.rate()), html::bounds(run.interval));
        drawing.text("end", [SCALE[0] - 12.0, y + 4.0], &short(&run.agent, 28));
        if let Some(interval) = run.interval {
            drawing.line("range", [x(interval.low), y], [x(interval.high), y]);
        }
        drawing.mark("point", 0, [x(rate), y], &told);
        drawing.text("end", [width, y + 4.0], &html::percent(run.rate()));
    }
    let row = |run: &std::sync::Arc<plumbline_engine::grading::standings::Standing>| FigureRow {
        name: run.agent.clone(),
        run: Some(run.run.clone()),
        cells: vec![
            html::percent(run.rate()),
            run.interval.map(|it| html::percent(Some(it.low))).unwrap_or_default(),
            run.interval.map(|it| html::percent(Some(it.high))).unwrap_or_default(),
        ],
        values: vec![share(run.rate()), share(run.interval.map(|it| it.low)), share(run.interval.map(|it| it.high))],
    };
    let title = "Scores with 95 % intervals";
    let about =
        "Each bar is the 95 % interval of a score, of at most the 30 best runs. Where bars overlap widely, the order may be chance.".to_owned();
    Some(Figure {
        svg: drawing.finish(title, &about),
        title,
        about,
        size: [width, height],
        head: ["agent", "score", "low", "high"].map(ToOwned::to_owned).into(),
        columns: None,
        rows: runs.iter().map(row).collect(),
    })
}

//! The criteria of two runs, joined.

use super::drawing::{Drawing, short};
use super::figure::{Figure, FigureRow, share};
use crate::http::pages::html;
use crate::http::pages::lines::criteria;
use plumbline_engine::grading::standings::Standing;

/// Left end and width of the scale, its top, and the height of a criterion.
const PLOT: [f64; 4] = [120.0, 560.0, 34.0, 34.0];
/// Width of the chart.
const WIDTH: f64 = 720.0;

/// Draws the criteria of two runs.
pub fn draw(a: &Standing, b: &Standing) -> Figure {
    let of = |run: &Standing| criteria(&run.summary.problem_level.per, &run.summary.graded);
    let (one, other) = (of(a), of(b));
    let [left, width, top, row] = PLOT;
    let height = top + row * one.len() as f64 + 24.0;
    let mut drawing = Drawing::new(WIDTH, height);
    for (i, run) in [a, b].into_iter().enumerate() {
        let x = left + 290.0 * i as f64;
        drawing.mark(&format!("s{i}"), i, [x, 12.0], &run.agent);
        drawing.text("", [x + 12.0, 16.0], &short(&run.agent, 34));
    }
    for tick in 0..=4 {
        let x = left + f64::from(tick) / 4.0 * width;
        drawing.line("grid", [x, top], [x, height - 24.0]);
        drawing.text("soft mid", [x, height - 6.0], &format!("{} %", 25 * tick));
    }
    let mut rows = Vec::new();
    for (i, (one, other)) in one.iter().zip(&other).enumerate() {
        let y = top + row * (i as f64 + 0.5);
        drawing.text("end", [left - 14.0, y + 4.0], one.name);
        if let (Some(from), Some(to)) = (one.value, other.value) {
            drawing.line("rule", [left + from * width, y], [left + to * width, y]);
        }
        for (series, (run, part)) in [(a, one), (b, other)].into_iter().enumerate() {
            if let Some(value) = part.value {
                let told = format!("{}, {}: {}", run.agent, part.name, html::percent(part.value));
                drawing.mark(&format!("s{series}"), series, [left + value * width, y], &told);
            }
        }
        let difference = one.value.zip(other.value).map(|(one, other)| points(other - one));
        let cells = vec![html::percent(one.value), html::percent(other.value), difference.unwrap_or_default()];
        let values = vec![share(one.value), share(other.value)];
        rows.push(FigureRow { name: one.name.to_owned(), run: None, cells, values });
    }
    let title = "Criteria of both runs";
    let about =
        "Of the problems that have such a check, the share that passes; for stability and efficiency, the mean score of those that were graded."
            .to_owned();
    Figure {
        svg: drawing.finish(title, &about),
        title,
        about,
        size: [WIDTH, height],
        head: ["criterion", "first run", "second run", "second − first, points"].map(ToOwned::to_owned).into(),
        columns: Some(["criterion", "first", "second"].map(ToOwned::to_owned).into()),
        rows,
    }
}

/// Writes a difference of two shares in points, with its sign.
fn points(difference: f64) -> String {
    let told = format!("{:.1}", difference.abs() * 100.0);
    match difference {
        _ if told == "0.0" => told,
        less if less < 0.0 => format!("−{told}"),
        _ => format!("+{told}"),
    }
}

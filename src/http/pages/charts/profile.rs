//! Criteria of the best runs side by side.

use super::drawing::{Drawing, SERIES, short};
use super::figure::{Figure, FigureRow, share};
use super::runs::Charted;
use crate::http::pages::html;
use crate::http::pages::lines::criteria;

/// Rectangle of the scale: left, top and width; and the height of a criterion.
const PLOT: [f64; 4] = [120.0, 60.0, 560.0, 40.0];
/// Width of the chart.
const WIDTH: f64 = 720.0;
/// Names in a row of the legend.
const NAMES: usize = 3;

/// Draws the criteria of the best run of each of the best agents.
pub fn draw(charted: &Charted) -> Option<Figure> {
    let mut runs: Vec<&plumbline_engine::grading::standings::Standing> = Vec::new();
    for run in &charted.runs {
        if runs.len() < SERIES && runs.iter().all(|other| other.agent != run.agent) {
            runs.push(run);
        }
    }
    let profiles: Vec<_> =
        runs.iter().map(|run| criteria(&run.summary.problem_level.per, &run.summary.graded)).collect();
    let names: Vec<&'static str> = profiles.first()?.iter().map(|part| part.name).collect();
    let [left, top, width, row] = PLOT;
    let height = top + row * names.len() as f64 + 24.0;
    let mut drawing = Drawing::new(WIDTH, height);
    for (i, run) in runs.iter().enumerate() {
        let [x, y] = [left + (i % NAMES) as f64 * 195.0, 14.0 + (i / NAMES) as f64 * 22.0];
        drawing.mark(&format!("s{i}"), i, [x, y - 4.0], &run.agent);
        drawing.text("", [x + 12.0, y], &short(&run.agent, 22));
    }
    for tick in 0..=4 {
        let x = left + f64::from(tick) / 4.0 * width;
        drawing.line("grid", [x, top], [x, height - 24.0]);
        drawing.text("soft mid", [x, height - 6.0], &format!("{} %", 25 * tick));
    }
    for (i, name) in names.iter().enumerate() {
        let y = top + row * (i as f64 + 0.5);
        drawing.text("end", [left - 14.0, y + 4.0], name);
        let values = profiles.iter().filter_map(|profile| profile[i].value);
        let ends =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if ends.0 <= ends.1 {
            drawing.line("rule", [left + ends.0 * width, y], [left + ends.1 * width, y]);
        }
        for (series, (run, profile)) in runs.iter().zip(&profiles).enumerate().rev() {
            if let Some(value) = profile[i].value {
                let told = format!("{}, {name}: {}", run.agent, html::percent(Some(value)));
                drawing.mark(&format!("s{series}"), series, [left + value * width, y], &told);
            }
        }
    }
    let table = |(run, profile): (&&plumbline_engine::grading::standings::Standing, &[_; 7])| FigureRow {
        name: run.agent.clone(),
        run: Some(run.run.clone()),
        values: profile.iter().map(|part: &crate::http::pages::lines::Part| share(part.value)).collect(),
        cells: profile.iter().map(|part: &crate::http::pages::lines::Part| html::percent(part.value)).collect(),
    };
    let title = "Criteria of the best agents";
    let about = "One mark for each agent's best run. Each criterion counts the problems that have such a check: the share of them \
                 that passes, or for stability and efficiency the mean score of those that were graded."
        .to_owned();
    Some(Figure {
        svg: drawing.finish(title, &about),
        title,
        about,
        size: [WIDTH, height],
        head: ["agent"].iter().chain(&names).map(|name| (*name).to_owned()).collect(),
        columns: None,
        rows: runs.iter().zip(&profiles).map(table).collect(),
    })
}

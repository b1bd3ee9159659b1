//! Scores against declared costs, with the runs that no cheaper run beats.

use std::collections::BTreeMap;

use super::drawing::{Drawing, short};
use super::figure::{Figure, FigureRow, share};
use super::runs::Charted;
use crate::http::pages::html;
use crate::http::pages::lines::money;
use plumbline_engine::grading::standings::Standing;

/// Rectangle of the scales: left, top, width and height.
const PLOT: [f64; 4] = [56.0, 14.0, 600.0, 300.0];
/// Greatest number of powers of ten on the scale of costs.
const MAX_POWERS: f64 = 8.0;
/// Size of the chart.
const SIZE: [f64; 2] = [720.0, 370.0];
/// Width of a character of a label, in pixels, at most.
const CHARACTER: f64 = 7.5;

/// Draws the scores of runs against what they cost, for the currency that most of them declare.
pub fn draw(charted: &Charted) -> Option<Figure> {
    let mut by_currency: BTreeMap<&str, Vec<(&Standing, f64)>> = BTreeMap::new();
    for run in &charted.runs {
        if let Some(cost) = charted.cost(run).filter(|cost| cost.amount.is_finite() && cost.amount > 0.0) {
            by_currency.entry(&cost.currency).or_default().push((run, cost.amount));
        }
    }
    let (currency, mut runs) = by_currency.into_iter().max_by_key(|(_, runs)| runs.len())?;
    runs.sort_by(|a, b| a.1.total_cmp(&b.1).then(rate(b.0).total_cmp(&rate(a.0))));
    // The frontier: each of its runs is better than every cheaper run.
    let mut best = -1.0;
    let is_front: Vec<bool> = runs
        .iter()
        .map(|(run, _)| {
            let is_better = rate(run) > best;
            best = best.max(rate(run));
            is_better
        })
        .collect();

    let [left, top, width, height] = PLOT;
    let logs = runs.iter().map(|(_, amount)| amount.log10());
    let low = logs.clone().fold(f64::INFINITY, f64::min).floor();
    let high = logs.fold(f64::NEG_INFINITY, f64::max).ceil().max(low + 1.0);
    // Amounts beyond eight powers of ten below the greatest stand at the left edge.
    let low = low.max(high - MAX_POWERS);
    let at = |run: &Standing, amount: f64| {
        [left + (amount.log10().max(low) - low) / (high - low) * width, top + (1.0 - rate(run)) * height]
    };
    let mut drawing = Drawing::new(SIZE[0], SIZE[1]);
    for tick in 0..=4 {
        let y = top + f64::from(tick) / 4.0 * height;
        drawing.line("grid", [left, y], [left + width, y]);
        drawing.text("soft end", [left - 8.0, y + 4.0], &format!("{} %", 100 - 25 * tick));
    }
    for power in low as i32..=high as i32 {
        let x = left + (f64::from(power) - low) / (high - low) * width;
        drawing.line("grid", [x, top], [x, top + height]);
        drawing.text("soft mid", [x, top + height + 18.0], &money(10_f64.powi(power)));
    }
    drawing.text("soft mid", [left + width / 2.0, SIZE[1] - 8.0], &format!("declared cost of the run in {currency}"));
    let front: Vec<[f64; 2]> = runs
        .iter()
        .zip(&is_front)
        .filter(|(_, is_front)| **is_front)
        .map(|((run, amount), _)| at(run, *amount))
        .collect();
    drawing.way("front", &front);
    let mut labels: Vec<[f64; 4]> = Vec::new();
    for ((run, amount), is_front) in runs.iter().zip(&is_front) {
        let [x, y] = at(run, *amount);
        let told = format!("{}: {} for {} {currency}", run.agent, html::percent(run.rate()), money(*amount));
        drawing.mark(if *is_front { "point" } else { "faint" }, 0, [x, y], &told);
        let name = short(&run.agent, 24);
        let wide = name.chars().count() as f64 * CHARACTER;
        // A label stands on the side where it has room, and is left out where it would cover another.
        let is_left = x + 10.0 + wide > SIZE[0];
        let label = [if is_left { x - 10.0 - wide } else { x + 10.0 }, y - 8.0, wide, 16.0];
        if *is_front && !labels.iter().any(|other| overlaps(other, &label)) {
            drawing.text(if is_left { "end" } else { "" }, [if is_left { x - 10.0 } else { x + 10.0 }, y + 4.0], &name);
            labels.push(label);
        }
    }
    let row = |((run, amount), is_front): (&(&Standing, f64), &bool)| FigureRow {
        name: run.agent.clone(),
        run: Some(run.run.clone()),
        cells: vec![
            html::percent(run.rate()),
            format!("{} {currency}", money(*amount)),
            if *is_front { "yes" } else { "no" }.to_owned(),
        ],
        values: vec![share(run.rate()), amount.to_string(), currency.to_owned(), is_front.to_string()],
    };
    let title = "Score against cost";
    let about =
        "The line joins the runs that no cheaper run beats. Costs are as the cards of runs declare them.".to_owned();
    Some(Figure {
        svg: drawing.finish(title, &about),
        title,
        about,
        size: SIZE,
        head: ["agent", "score", "cost", "best at its price"].map(ToOwned::to_owned).into(),
        columns: Some(["agent", "score", "cost", "currency", "best_at_its_price"].map(ToOwned::to_owned).into()),
        rows: runs.iter().zip(&is_front).map(row).collect(),
    })
}

fn rate(run: &Standing) -> f64 {
    run.rate().unwrap_or_default()
}

fn overlaps(a: &[f64; 4], b: &[f64; 4]) -> bool {
    (0..2).all(|i| a[i] < b[i] + b[i + 2] && b[i] < a[i] + a[i + 2])
}

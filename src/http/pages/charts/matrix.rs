//! Which run solves which task.

use std::fmt::Write as _;

use super::drawing::{Drawing, short};
use super::figure::{Figure, FigureRow};
use super::runs::Charted;
use crate::app::boards::tasks::TaskResult;
use plumbline_engine::grading::outcomes::Outcomes;

/// Greatest number of runs in the chart.
const MAX_RUNS: usize = 20;
/// Left end and width of the cells, and height of a row, in pixels.
const CELLS: [f64; 3] = [190.0, 520.0, 18.0];
/// Room for the names of families below.
const NAMES: f64 = 130.0;
/// Least width of a family whose name is written, in pixels.
const LEAST_NAMED: f64 = 14.0;
/// Classes of the cells.
const CLASSES: [&str; 4] = ["solved", "accurate", "failed", "none"];

/// Draws a row for each of the best runs and a cell for each task, by family, easier tasks first.
pub fn draw(charted: &Charted) -> Option<Figure> {
    let runs = charted.runs.get(..charted.runs.len().min(MAX_RUNS)).filter(|runs| !runs.is_empty())?;
    let tasks = &charted.board.entry.suite.tasks;
    let mut families: Vec<(&str, Vec<usize>)> = Vec::new();
    for (place, task) in tasks.iter().enumerate() {
        match families.iter_mut().find(|(name, _)| *name == task.family()) {
            Some((_, places)) => places.push(place),
            None => families.push((task.family(), vec![place])),
        }
    }
    let solved = |place: usize| runs.iter().filter(|run| run.outcomes.is_solved(place)).count();
    for (_, places) in &mut families {
        places.sort_by_key(|place| (std::cmp::Reverse(solved(*place)), *place));
    }
    let order: Vec<usize> = families.iter().flat_map(|(_, places)| places.iter().copied()).collect();

    let [left, width, row] = CELLS;
    let height = row * runs.len() as f64;
    let mut drawing = Drawing::new(720.0, height + NAMES);
    let mut paths = CLASSES.map(|class| (class, String::new()));
    for (i, run) in runs.iter().enumerate() {
        drawing.text("end", [left - 10.0, row * (i as f64 + 0.5) + 4.0], &short(&run.agent, 24));
        for (class, begin, length) in stretches(&run.outcomes, &order) {
            // Writing to a string cannot fail.
            let _ = write!(paths[class].1, "M{begin} {i}.5h{length}");
        }
    }
    drawing.cells([left, 0.0, width, height], [order.len(), runs.len()], &paths);
    let mut begin = 0;
    for (name, places) in &families {
        let x = |place: usize| left + place as f64 / order.len() as f64 * width;
        drawing.line("rule", [x(begin), 0.0], [x(begin), height + 4.0]);
        if x(begin + places.len()) - x(begin) >= LEAST_NAMED {
            drawing.slanted([f64::midpoint(x(begin), x(begin + places.len())) + 4.0, height + 14.0], &short(name, 22));
        }
        begin += places.len();
    }
    let counts = |run: &std::sync::Arc<plumbline_engine::grading::standings::Standing>| FigureRow {
        name: run.agent.clone(),
        run: Some(run.run.clone()),
        values: order.iter().map(|place| code(TaskResult::of(&run.outcomes, *place)).to_owned()).collect(),
        cells: families
            .iter()
            .map(|(_, places)| {
                let pass = places.iter().filter(|place| run.outcomes.is_solved(**place)).count();
                format!("{pass} of {}", places.len())
            })
            .collect(),
    };
    let title = "Which run solves which task";
    let about = "A row for each of at most 20 runs, a cell for each task, by family, easier tasks first. Green: solved. Yellow: accurate, but not \
                 solved. Red: failed. Empty: no graded answer."
        .to_owned();
    Some(Figure {
        svg: drawing.finish(title, &about),
        title,
        about,
        size: [720.0, height + NAMES],
        head: ["agent"].into_iter().chain(families.iter().map(|(name, _)| *name)).map(ToOwned::to_owned).collect(),
        columns: Some(
            ["agent".to_owned()].into_iter().chain(order.iter().map(|place| tasks[*place].id.clone())).collect(),
        ),
        rows: runs.iter().map(counts).collect(),
    })
}

/// Returns the name of a result in the CSV.
const fn code(result: TaskResult) -> &'static str {
    match result {
        TaskResult::Solved => "solved",
        TaskResult::Accurate => "accurate",
        TaskResult::Failed => "failed",
        TaskResult::Skipped => "skipped",
        TaskResult::NotAnswered => "",
    }
}

/// Returns the stretches of equal results of a run: class, first cell and number of cells.
fn stretches(outcomes: &Outcomes, order: &[usize]) -> Vec<(usize, usize, usize)> {
    let mut stretches: Vec<(usize, usize, usize)> = Vec::new();
    for (cell, place) in order.iter().enumerate() {
        let class = match TaskResult::of(outcomes, *place) {
            TaskResult::Solved => 0,
            TaskResult::Accurate => 1,
            TaskResult::Failed => 2,
            TaskResult::Skipped | TaskResult::NotAnswered => 3,
        };
        match stretches.last_mut() {
            Some((of, _, length)) if *of == class => *length += 1,
            _ => stretches.push((class, cell, 1)),
        }
    }
    stretches
}

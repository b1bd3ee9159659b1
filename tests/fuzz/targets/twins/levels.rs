//! Size, and what stands on one level: clusters and parts.

use std::collections::BTreeSet;

use super::{Arguments, Build, Flat, parts};

pub fn size(rule: &str, arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    if build.blocks.is_empty() {
        return Some(false);
    }
    let [x, y, z] = [0, 1, 2].map(|axis| build.ends(axis));
    let [dx, dy, dz] = [x, y, z].map(|(least, most)| (most - least) as f64);
    let plan = |compare: fn(f64, f64) -> bool| {
        let wanted = arguments.list("xz").into_iter().map(|blocks| Some(blocks.as_f64()? - 1.0));
        let mut wanted = wanted.collect::<Option<Vec<f64>>>()?;
        wanted.sort_by(f64::total_cmp);
        let height = arguments.number("y").is_none_or(|blocks| compare(dy, blocks - 1.0));
        Some(compare(dx.min(dz), wanted[0]) && compare(dx.max(dz), wanted[1]) && height)
    };
    match rule {
        "is_equal" => plan(|found, wanted| found == wanted),
        "is_leq" => plan(|found, wanted| found <= wanted),
        "min_y_is_equal" => Some(y.0 as f64 == arguments.number("expected_y")?),
        "min_y_is_leq" => Some(y.0 as f64 <= arguments.number("max_y")?),
        "max_y_is_geq" => Some(y.1 as f64 >= arguments.number("min_y")?),
        "all_dimensions_geq" => {
            let least = arguments.number("min_size")? - 1.0;
            Some([dx, dy, dz].iter().all(|extent| *extent >= least))
        }
        _ => None,
    }
}

pub fn clusters(rule: &str, arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    let clusters = || parts(&build.level(arguments.integer("y", 0)), arguments.flag("use_8_neighbors", false));
    let squared = |a: &Flat, b: &Flat| ((a.0 - b.0).pow(2) + (a.1 - b.1).pow(2)) as f64;
    match rule {
        "cluster_count_at_y_is" => Some(clusters().len() as f64 == arguments.number("expected_count")?),
        "clusters_at_y_have_min_span" => {
            let clusters = clusters();
            let pairs = (0..clusters.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
            let spans = pairs.flat_map(|(i, j)| {
                let other = &clusters[j];
                clusters[i].iter().flat_map(move |a| other.iter().map(move |b| squared(a, b)))
            });
            Some(reaches(spans.fold(f64::INFINITY, f64::min), arguments.number("min_span")?))
        }
        "cluster_at_y_has_min_radius" => {
            let [cluster] = &clusters()[..] else { return Some(false) };
            let mean = |along: fn(&Flat) -> i64| cluster.iter().map(along).sum::<i64>() as f64 / cluster.len() as f64;
            let (x, z) = (mean(|at| at.0), mean(|at| at.1));
            let radii = cluster.iter().map(|at| (at.0 as f64 - x).hypot(at.1 as f64 - z));
            // The mean is rounded, so a radius near the bound is left open.
            let (radius, least) = (radii.fold(0.0, f64::max), arguments.number("min_radius")?);
            ((radius - least).abs() > 1e-9 * least.abs().max(1.0)).then_some(radius >= least)
        }
        "cluster_at_y_has_min_diameter" => {
            let [cluster] = &clusters()[..] else { return Some(false) };
            let all = cluster.iter().flat_map(|a| cluster.iter().map(move |b| squared(a, b)));
            Some(reaches(all.fold(0.0, f64::max), arguments.number("min_diameter")?))
        }
        "level_has" => Some(!build.blocks.is_empty() && level_has(arguments, build)),
        _ => None,
    }
}

/// Whether a distance, given by its square, is at least so long.
fn reaches(squared: f64, least: f64) -> bool {
    least <= 0.0 || squared >= least * least
}

fn level_has(arguments: Arguments<'_>, build: &Build<'_>) -> bool {
    let build = &build.standing(arguments.flag("solid", false));
    let (y, of) = (arguments.integer("y", 0), arguments.blocks("of"));
    let counts = |name: &str| of.is_none_or(|of| of.has(name));
    let own = build.cells(counts);
    let places: BTreeSet<Flat> = own.iter().filter(|at| at[1] == y).map(|at| (at[0], at[2])).collect();
    let parts = parts(&places, true);
    let span = |part: &BTreeSet<Flat>, along: fn(&Flat) -> i64| {
        (part.iter().map(along).max().expect("a place") - part.iter().map(along).min().expect("a place") + 1) as f64
    };
    let is_within = |count: usize, least: &str, most: &str| {
        let count = count as f64;
        arguments.number(least).unwrap_or(0.0) <= count && arguments.number(most).is_none_or(|most| count <= most)
    };
    let size: Vec<f64> = arguments.list("min_size").into_iter().filter_map(serde_json::Value::as_f64).collect();
    let reaches = |part: &BTreeSet<Flat>| {
        let (x, z) = (span(part, |at| at.0), span(part, |at| at.1));
        (x >= size[0] && z >= size[1]) || (x >= size[1] && z >= size[0])
    };
    let full: Vec<i64> = arguments.list("full_size").into_iter().filter_map(serde_json::Value::as_i64).collect();
    let fills = |a: i64, b: i64| {
        let is_full = |(x, z): &Flat| {
            a * b <= places.len() as i64 && (0..a).all(|dx| (0..b).all(|dz| places.contains(&(x + dx, z + dz))))
        };
        places.iter().any(is_full)
    };
    let is_full = full.is_empty()
        || [[full[0], full[1]], [full[1], full[0]]].iter().any(|[a, b]| fills((*a).max(1), (*b).max(1)));
    let least = arguments.number("min_part_blocks").unwrap_or(0.0);
    is_full
        && parts.iter().all(|part| part.len() as f64 >= least)
        && is_within(places.len(), "min_blocks", "max_blocks")
        && is_within(parts.len(), "min_parts", "max_parts")
        && (size.is_empty() || parts.iter().any(reaches))
}

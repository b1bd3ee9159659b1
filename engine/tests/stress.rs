//! The stress simulation as a whole: what must not matter, and that nothing hangs.

use std::sync::atomic::{AtomicU32, Ordering};

use crate::repository;
use plumbline_engine::elasticity::{Control, Stopped, fem, sph};
use plumbline_engine::voxel::Cell;

fn cuboid(x: i32, y: i32, z: i32) -> Vec<Cell> {
    (0..x * y * z).map(|i| Cell::new(i % x, i / x % y, i / x / y)).collect()
}

fn simulate(cells: &[Cell]) -> sph::Outcome {
    sph::simulate(cells, &Control::unhurried()).unwrap()
}

#[test]
fn neither_order_nor_place_matters() {
    // An L of two storeys, so that no axis is like another.
    let mut cells = cuboid(5, 3, 2);
    cells.extend((0..4).map(|z| Cell::new(0, 2, 2 + z)));
    let expected = simulate(&cells);
    let reversed: Vec<Cell> = cells.iter().rev().copied().collect();
    let other = simulate(&reversed);
    assert!(other.von_mises_pa.iter().rev().eq(&expected.von_mises_pa), "the order of blocks changes bits");
    let moved: Vec<Cell> = cells.iter().map(|c| c.offset(-1_000_000, 70, 123_456)).collect();
    assert_eq!(simulate(&moved).von_mises_pa, expected.von_mises_pa, "the place changes bits");
    let turned: Vec<Cell> = cells.iter().map(|c| Cell::new(-c.z, c.y, c.x)).collect();
    for (a, b) in simulate(&turned).von_mises_pa.iter().zip(&expected.von_mises_pa) {
        assert!((a - b).abs() <= 1e-6 * b + 1e-3, "turned: {a} Pa, before {b} Pa");
    }
}

#[test]
fn several_cores_give_the_same_bits() {
    let cells = cuboid(24, 8, 24);
    let shares = AtomicU32::new(0);
    let join = |a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)| {
        shares.fetch_add(1, Ordering::Relaxed);
        rayon::join(a, b);
    };
    let shared = sph::simulate(&cells, &Control { join: Some(&join), ..Control::unhurried() }).unwrap();
    assert!(shares.load(Ordering::Relaxed) >= 6_000, "a large structure was not shared out");
    let alone = simulate(&cells);
    assert_eq!(shared.von_mises_pa, alone.von_mises_pa);
    assert_eq!(shared.displacement_m, alone.displacement_m);
}

#[test]
fn it_tells_progress_and_stops_when_asked() {
    let cells = cuboid(10, 10, 10);
    let looks = AtomicU32::new(0);
    let progress = |done: f64| assert!((0.0..=1.0).contains(&done));
    let stop = || looks.fetch_add(1, Ordering::Relaxed) == 3;
    let control = Control { progress: Some(&progress), ..Control::until(&stop) };
    assert_eq!(sph::simulate(&cells, &control).unwrap_err(), Stopped);
    assert_eq!(looks.load(Ordering::Relaxed), 4);
}

#[test]
fn a_million_detached_blocks_end_at_once() {
    let cells: Vec<Cell> = (0..1_000_000).map(|i| Cell::new(i % 100 * 2, i / 10_000 * 2, i / 100 % 100 * 2)).collect();
    let outcome = simulate(&cells);
    assert_eq!(outcome.max_von_mises_pa, 0.0);
    assert_eq!(outcome.most_stressed, None);
    assert_eq!(outcome.diagnostics.degenerate.len(), 1_000_000);
    // All but the lowest of a hundred layers fall, for 0.2 s at less than g / 160.
    assert_eq!(outcome.diagnostics.unconnected.len(), 990_000);
    assert!((0.0009..0.0012).contains(&outcome.diagnostics.max_displacement_m));
    assert_eq!(outcome.diagnostics.residual_force_n, 900.0);
}

#[test]
fn a_tower_of_a_thousand_single_blocks_has_a_result() {
    let outcome = simulate(&(0..1_000).map(|y| Cell::new(0, y, 0)).collect::<Vec<_>>());
    assert_eq!(outcome.diagnostics.singular_moment.len(), 1_000);
    assert!(outcome.max_von_mises_pa.is_finite());
    assert!(outcome.diagnostics.kinetic_energy_j > 0.0, "it cannot have come to rest");
}

/// A sloped thin part blows up (the vectors' `thin_arch_w3`). A sound cube one empty cell away keeps its values.
#[test]
fn a_part_that_blows_up_takes_no_other_with_it() {
    let (_, arch) = named_structures().into_iter().find(|(name, _)| name == "thin_arch_w3").unwrap();
    assert!(!simulate(&arch).diagnostics.non_finite.is_empty(), "it does not blow up any more");
    let right = arch.iter().map(|cell| cell.x).max().unwrap();
    let ground = arch.iter().map(|cell| cell.y).min().unwrap();
    let cube: Vec<Cell> = cuboid(4, 4, 4).iter().map(|cell| cell.offset(right + 2, ground, 0)).collect();
    let both = simulate(&arch.iter().chain(&cube).copied().collect::<Vec<_>>());
    let alone = simulate(&cube);
    for (a, b) in both.von_mises_pa[arch.len()..].iter().zip(&alone.von_mises_pa) {
        assert!((a - b).abs() <= 2e-7 * b + 4e-4, "{a} Pa, alone {b} Pa");
    }
    assert!(both.diagnostics.non_finite.iter().all(|&entry| (entry as usize) < arch.len()));
}

/// Parts scattered over the world are moved together in the lattice, and have the values of one of them: bits may
/// differ, because positions are rounded where they are.
#[test]
fn scattered_parts_have_the_values_of_one() {
    let pair = [Cell::new(0, 0, 0), Cell::new(1, 1, 1), Cell::new(1, 0, 1), Cell::new(0, 1, 1)];
    let one = simulate(&pair);
    let many: Vec<Cell> =
        (0..500).flat_map(|i| pair.map(|cell| cell.offset(i * 7_919 % 50_021, 0, i * 104_729 % 50_021))).collect();
    let all = simulate(&many);
    for (found, expected) in all.von_mises_pa.iter().zip(one.von_mises_pa.iter().cycle()) {
        assert!((found - expected).abs() <= 1e-6 * expected + 1e-3, "{found} Pa, alone {expected} Pa");
    }
}

/// Two particles in one cell move alike: without rounding the result is that of a heavier neighbour, and it is found
/// whatever their order. It is marked, because the published evaluator's rounding decides otherwise.
#[test]
fn cells_listed_twice_are_marked_and_keep_their_value() {
    let mut cells = cuboid(3, 3, 3);
    cells.push(Cell::new(1, 2, 1));
    let twice = simulate(&cells);
    assert_eq!(twice.diagnostics.repeated_cells, 1);
    assert!(twice.diagnostics.order_sensitive);
    let once = simulate(&cells[..27]);
    assert!(!once.diagnostics.order_sensitive);
    assert!(twice.max_von_mises_pa > once.max_von_mises_pa);
    assert_eq!(twice.von_mises_pa[27], twice.von_mises_pa[cells.iter().position(|c| *c == cells[27]).unwrap()]);
}

#[test]
fn where_all_blocks_are_held_nothing_moves() {
    let outcome = simulate(&cuboid(40, 1, 40));
    assert_eq!(outcome.diagnostics.max_displacement_m, 0.0);
    assert_eq!(outcome.diagnostics.kinetic_energy_j, 0.0);
    assert_eq!(outcome.max_von_mises_pa, 0.0);
}

#[test]
fn diagnostics_name_what_is_loose_and_what_moves() {
    let mut cells = cuboid(3, 3, 3);
    cells.extend(cuboid(2, 2, 2).iter().map(|c| c.offset(10, 2, 0)));
    let outcome = simulate(&cells);
    assert_eq!(outcome.diagnostics.unconnected, (27..35).collect::<Vec<u32>>());
    assert!(outcome.diagnostics.residual_force_n > 800.0, "falling blocks are not in equilibrium");
    assert!(outcome.diagnostics.max_displacement_m > 0.0009);
    assert!(outcome.displacement_m[27..].iter().all(|d| d[1] < -0.0009));
    assert!(outcome.diagnostics.cautions().iter().any(|c| c.contains("8 blocks are not connected")));
}

/// The paper's structures, by their names in the published evaluator's vectors.
fn named_structures() -> Vec<(String, Vec<Cell>)> {
    let text = std::fs::read_to_string(repository("tests/conformance/reference_structures.json")).unwrap();
    let items: Vec<serde_json::Value> = serde_json::from_str(&text).unwrap();
    let cell = |block: &serde_json::Value| {
        let at = |k: usize| i32::try_from(block[k].as_i64().unwrap()).unwrap();
        Cell::new(at(0), at(1), at(2))
    };
    let read = |item: &serde_json::Value| {
        (item["name"].as_str().unwrap().to_owned(), item["blocks"].as_array().unwrap().iter().map(cell).collect())
    };
    items.iter().map(read).collect()
}

/// The paper's two comparisons (section 4.2): an arch is less stressed than a flat bridge, balanced columns carry a
/// roof better than biased ones.
#[test]
fn the_papers_comparisons_hold_by_both_methods() {
    let structures = named_structures();
    let stress = |name: &str| {
        let (_, cells) = structures.iter().find(|(found, _)| found == name).unwrap();
        let equilibrium = fem::solve_equilibrium(cells, &Control::unhurried()).unwrap();
        (simulate(cells).max_von_mises_pa, equilibrium.max_von_mises_pa.unwrap())
    };
    for (better, worse) in
        [("arch_w2_2x2_supports_h4", "flat_bridge_w2"), ("roof_1layer_5cols", "roof_1layer_5cols_biased")]
    {
        let ((sph_better, fem_better), (sph_worse, fem_worse)) = (stress(better), stress(worse));
        println!("{better}: sph {sph_better:.2}, fem {fem_better:.2}; {worse}: sph {sph_worse:.2}, fem {fem_worse:.2}");
        assert!(sph_better < sph_worse, "sph: {better} {sph_better} Pa, {worse} {sph_worse} Pa");
        assert!(fem_better < fem_worse, "fem: {better} {fem_better} Pa, {worse} {fem_worse} Pa");
    }
}

/// What has no equilibrium, what touches only in edges, and what is listed twice end with a clear result.
#[test]
fn equilibrium_leaves_out_what_is_not_supported() {
    let mut cells = cuboid(2, 2, 2);
    cells.push(Cell::new(1, 1, 1));
    cells.push(Cell::new(2, 2, 1));
    cells.push(Cell::new(9, 5, 9));
    let outcome = fem::solve_equilibrium(&cells, &Control::unhurried()).unwrap();
    assert_eq!(outcome.unsupported, [9, 10]);
    assert_eq!(outcome.von_mises_pa[8], outcome.von_mises_pa[7], "the cell listed twice is one block");
    assert_eq!(outcome.von_mises_pa[9], None);
    assert!(outcome.is_solved && outcome.relative_residual <= 1.1e-8);
    let floating = fem::solve_equilibrium(&[], &Control::unhurried()).unwrap();
    assert_eq!(floating.max_von_mises_pa, None);
}

#[test]
fn equilibrium_of_the_extreme_ends_in_bounded_time() {
    let tower: Vec<Cell> = (0..1_000).map(|y| Cell::new(0, y, 0)).collect();
    let outcome = fem::solve_equilibrium(&tower, &Control::unhurried()).unwrap();
    // A thousand blocks press on the base, whose held corners add to it.
    assert!((900_000.0..1_100_000.0).contains(&outcome.max_von_mises_pa.unwrap()));
    assert!(outcome.iterations < 500, "{} iterations", outcome.iterations);
    let scattered: Vec<Cell> =
        (0..1_000_000).map(|i| Cell::new(i % 100 * 2, i / 10_000 * 2, i / 100 % 100 * 2)).collect();
    let looks = AtomicU32::new(0);
    let stop = || looks.fetch_add(1, Ordering::Relaxed) > 1_000;
    let outcome = fem::solve_equilibrium(&scattered, &Control::until(&stop)).unwrap();
    assert_eq!(outcome.unsupported.len(), 990_000);
    // Arches within arches, slice behind slice on both sides of 0, none touching another: thousands of long thin parts.
    let arch = |z: i32, i: i32| {
        let legs = (0..2 * i).flat_map(move |y| [-2 * i, 2 * i].map(|x| Cell::new(x, y, z)));
        legs.chain((-2 * i..=2 * i).map(move |x| Cell::new(x, 2 * i, z)))
    };
    let nested: Vec<Cell> = (-50..50).flat_map(|z| (1..6).flat_map(move |i| arch(2 * z, i))).collect();
    looks.store(0, Ordering::Relaxed);
    let outcome = fem::solve_equilibrium(&nested, &Control::until(&stop)).unwrap();
    assert!(outcome.is_solved && outcome.iterations < 1_000, "{} iterations", outcome.iterations);
    let cube = cuboid(20, 20, 20);
    let stop = || looks.fetch_add(1, Ordering::Relaxed) > 1_000;
    looks.store(999, Ordering::Relaxed);
    assert_eq!(fem::solve_equilibrium(&cube, &Control::until(&stop)).unwrap_err(), Stopped);
}

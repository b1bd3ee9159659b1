//! Verification against closed-form solutions: bars, beams and patches.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::element::Element;
use crate::elasticity::fem::*;
use crate::elasticity::tests::on_two_threads;
use crate::elasticity::{POISSON, YOUNG_PA};

/// Returns the cells of a box.
fn cuboid(x: i32, y: i32, z: i32) -> Vec<Cell> {
    (0..x * y * z).map(|i| Cell::new(i % x, i / x % y, i / x / y)).collect()
}

/// Solves for blocks of edge `edge_m` that weigh 900 N per cubic metre, with the nodes held that `is_held` selects.
fn settle(element: &Element, cells: Vec<Cell>, edge_m: f64, is_held: impl Fn(&[i32; 3]) -> bool) -> (Mesh, Vec<f64>) {
    let mesh = Mesh::new(cells);
    let system = System::new(&mesh, element, edge_m, is_held);
    let mut displacement = vec![0.0; system.len()];
    let load = system.weight(WEIGHT_N * edge_m.powi(3));
    let convergence = solve(&system, &load, &mut displacement, &Control::unhurried()).unwrap();
    assert!(convergence.is_solved && convergence.relative_residual < 1e-7, "{convergence:?}");
    (mesh, displacement)
}

/// Returns the greatest sag, m.
fn sag(displacement: &[f64]) -> f64 {
    displacement.chunks_exact(3).map(|u| -u[1]).fold(0.0, f64::max)
}

/// Returns the sag of a Timoshenko beam `length` long and `height` high, with one end or both ends clamped: the
/// Euler-Bernoulli part, and that of shear with the coefficient 10 (1 + nu) / (12 + 11 nu) of a rectangle (Cowper
/// 1966).
fn beam_sag(poisson: f64, length: f64, height: f64, both_ends: bool) -> f64 {
    let (load, inertia) = (WEIGHT_N * height, height.powi(3) / 12.0);
    let shear = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson) * YOUNG_PA / (2.0 * (1.0 + poisson)) * height;
    let (bending_part, shear_part) = if both_ends { (384.0, 8.0) } else { (8.0, 2.0) };
    load * length.powi(4) / (bending_part * YOUNG_PA * inertia) + load * length.powi(2) / (shear_part * shear)
}

/// Away from the base, whose held nodes keep it from widening, the stress of a bar under its own weight is within a
/// quarter of one block's weight (which the element has as forces on its corners) of the weight above the block's
/// middle. The top sinks by rho g H^2 / 2 E.
#[test]
fn a_bar_under_its_own_weight() {
    let outcome = solve_equilibrium(&cuboid(1, 30, 1), &Control::unhurried()).unwrap();
    for y in 4..30 {
        let expected = WEIGHT_N * (29.5 - f64::from(y));
        let found = outcome.von_mises_pa[y as usize].unwrap();
        assert!((found - expected).abs() < 0.25 * WEIGHT_N, "at {y}: {found} Pa, expected {expected} Pa");
    }
    let expected = WEIGHT_N * 30.0 * 30.0 / 2.0 / YOUNG_PA;
    assert!((outcome.max_displacement_m.unwrap() / expected - 1.0).abs() < 0.02);
}

/// Returns the relative errors of the sag of a beam one block thick and `length` long, with blocks of 1, 1/2 and 1/4 m.
fn sag_errors(poisson: f64, length: i32, both_ends: bool) -> [f64; 3] {
    let element = Element::new(YOUNG_PA, poisson);
    [1, 2, 4].map(|refinement| {
        let cells = cuboid(length * refinement, refinement, refinement);
        let is_held = |position: &[i32; 3]| position[0] == 0 || both_ends && position[0] == length * refinement;
        let (_, displacement) = settle(&element, cells, 1.0 / f64::from(refinement), is_held);
        sag(&displacement) / beam_sag(poisson, f64::from(length), 1.0, both_ends) - 1.0
    })
}

/// Without the Poisson effect a clamp is as the theory assumes: with one element over the thickness the sag is within
/// 2.5 % of Timoshenko's, with four within 0.3 %.
#[test]
fn beams_one_block_thick() {
    for (length, both_ends) in [(12, false), (16, true)] {
        let errors = sag_errors(0.0, length, both_ends);
        assert!(errors[0].abs() < 0.025 && errors[2].abs() < 0.003, "{errors:?}");
        assert!(errors[2].abs() < 0.5 * errors[0].abs(), "{errors:?}");
    }
}

/// With the Poisson effect a clamp keeps the section from widening, which stiffens about half a block at each clamp.
/// The sag is within 6 % for beams this short, and closer with refinement.
#[test]
fn beams_of_the_blocks_material() {
    for (length, both_ends) in [(12, false), (16, true)] {
        let errors = sag_errors(POISSON, length, both_ends);
        assert!(errors[0].abs() < 0.06 && errors[2].abs() < errors[0].abs(), "{errors:?}");
    }
}

/// The bending stress in the middle of a clamped beam, far from the clamps, is q L^2 / 24 over the section.
#[test]
fn bending_stress_of_a_clamped_beam() {
    let refinement = 4;
    let edge_m = 1.0 / f64::from(refinement);
    let cells = cuboid(16 * refinement, refinement, 1);
    let (mesh, displacement) = settle(&ELEMENT, cells, edge_m, |position| position[0] % (16 * refinement) == 0);
    let system = System::new(&mesh, &ELEMENT, edge_m, |_| false);
    let block = mesh.cells.iter().position(|cell| (cell.x, cell.y) == (8 * refinement, 0)).unwrap();
    let found = ELEMENT.von_mises(&system.corners(block, &displacement), edge_m).into_iter().fold(0.0, f64::max);
    // At the integration points nearest the underside.
    let height = 0.5 - edge_m * (1.0 - 1.0 / 3.0_f64.sqrt()) / 2.0;
    let expected = WEIGHT_N * 16.0_f64.powi(2) / 24.0 * height * 12.0;
    assert!((found / expected - 1.0).abs() < 0.01, "{found} Pa, expected {expected} Pa");
}

/// The patch test: where the nodes of the surface follow a linear field, those inside do as well, and the stress is the
/// same everywhere.
#[test]
fn the_patch_test() {
    let linear = |position: &[i32; 3]| {
        let [x, y, z] = position.map(f64::from);
        [0.1 + 0.2 * x - 0.3 * y + 0.05 * z, -0.2 + 0.1 * x + 0.4 * y - 0.1 * z, 0.3 - 0.15 * x + 0.25 * y + 0.35 * z]
    };
    let mesh = Mesh::new(cuboid(4, 4, 4));
    let system = System::new(&mesh, &ELEMENT, 1.0, |position| position.iter().any(|&k| k == 0 || k == 4));
    let mut displacement: Vec<f64> = Vec::new();
    for (position, is_held) in mesh.position.iter().zip(&system.is_held) {
        displacement.extend(if *is_held { linear(position) } else { [0.0; 3] });
    }
    solve(&system, &vec![0.0; system.len()], &mut displacement, &Control::unhurried()).unwrap();
    for (position, found) in mesh.position.iter().zip(displacement.chunks_exact(3)) {
        for (found, expected) in found.iter().zip(linear(position)) {
            assert!((found - expected).abs() < 1e-7, "at {position:?}: {found}, expected {expected}");
        }
    }
    let stresses: Vec<f64> =
        (0..64).flat_map(|block| ELEMENT.von_mises(&system.corners(block, &displacement), 1.0)).collect();
    assert!(stresses.iter().all(|stress| (stress / stresses[0] - 1.0).abs() < 1e-6));
}

#[test]
fn a_symmetric_structure_has_symmetric_stress() {
    // A table on four legs, seen from two sides and mirrored.
    let mut cells = cuboid(7, 1, 7);
    for cell in &mut cells {
        cell.y = 3;
    }
    for (x, z) in [(0, 0), (6, 0), (0, 6), (6, 6)] {
        cells.extend((0..3).map(|y| Cell::new(x, y, z)));
    }
    let outcome = solve_equilibrium(&cells, &Control::unhurried()).unwrap();
    let stress_at =
        |wanted: Cell| outcome.von_mises_pa[cells.iter().position(|cell| *cell == wanted).unwrap()].unwrap();
    for cell in &cells {
        let stress = stress_at(*cell);
        for other in [Cell::new(6 - cell.x, cell.y, cell.z), Cell::new(cell.z, cell.y, cell.x)] {
            assert!((stress_at(other) / stress - 1.0).abs() < 1e-5);
        }
    }
}

/// Random numbers from 0 to below `below`, the same each time.
fn random(below: u64) -> impl FnMut() -> u64 {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    move || {
        for (shift, is_left) in [(13, true), (7, false), (17, true)] {
            state ^= if is_left { state << shift } else { state >> shift };
        }
        state % below
    }
}

/// Returns blocks that each touch exactly one that was there before.
fn branches(count: usize) -> Vec<Cell> {
    let mut draw = random(1 << 40);
    let sides = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [0, -1, 0]];
    let mut cells = vec![Cell::new(0, 0, 0)];
    while cells.len() < count {
        let from = cells[draw() as usize % cells.len()];
        let [x, y, z] = sides[draw() as usize % 5];
        let next = from.offset(x, y, z);
        let touched = sides.iter().filter(|[x, y, z]| cells.contains(&next.offset(*x, *y, *z))).count();
        if touched == 1 && !cells.contains(&next) {
            cells.push(next);
        }
    }
    cells
}

/// Structures of all kinds are solved in fewer than 100 iterations: with nothing but thin winding parts, with large thin
/// parts on few columns, and solid ones.
#[test]
fn any_structure_takes_few_iterations() {
    let sponge = |side: i32, percent: u64| {
        let mut draw = random(100);
        cuboid(side, side, side).into_iter().filter(|_| draw() < percent).collect::<Vec<_>>()
    };
    let roof = cuboid(60, 4, 60).into_iter().filter(|c| c.y == 3 || c.x % 20 == 0 && c.z % 20 == 0).collect();
    let bridge = (0..500).map(|x| Cell::new(x, 3, 0));
    let bridge = bridge.chain([0, 499].into_iter().flat_map(|x| (0..3).map(move |y| Cell::new(x, y, 0)))).collect();
    let cases: [(&str, Vec<Cell>); 7] = [
        ("a dense sponge", sponge(16, 90)),
        ("a sponge", sponge(18, 50)),
        ("a sponge that hardly holds together", sponge(24, 34)),
        ("branches", branches(1_500)),
        ("a roof on columns", roof),
        ("a bridge of 500", bridge),
        ("a cube", cuboid(14, 14, 14)),
    ];
    for (name, cells) in cases {
        let outcome = solve_equilibrium(&cells, &Control::unhurried()).unwrap();
        assert!(outcome.is_solved && outcome.iterations < 100, "{name}: {} iterations", outcome.iterations);
        assert!(outcome.relative_residual < 1e-4, "{name}: {}", outcome.relative_residual);
    }
}

/// The figures of a beam so long that rounding leaves forces greater than its weight are not reliable, and it says so.
#[test]
fn figures_of_which_rounding_leaves_nothing_have_a_caution() {
    let mut cells: Vec<Cell> = (0..20_000).map(|x| Cell::new(x, 1, 0)).collect();
    cells.extend([Cell::new(0, 0, 0), Cell::new(19_999, 0, 0)]);
    let outcome = solve_equilibrium(&cells, &Control::unhurried()).unwrap();
    assert!(outcome.is_solved && outcome.relative_residual > 1.0, "{}", outcome.relative_residual);
    assert!(outcome.cautions()[0].ends_with("the figures of fem are not reliable"), "{:?}", outcome.cautions());
}

/// A large structure's figures are the same on two cores, and whatever the order of its blocks.
#[test]
fn neither_cores_nor_the_order_of_blocks_matter() {
    let blocks = cuboid(62, 13, 62).into_iter().filter(|c| c.y == 12 || c.x % 4 == 0 && c.z % 4 == 0 || c.y % 3 == 0);
    let blocks: Vec<Cell> = blocks.collect();
    assert!(blocks.len() > 20_000, "{}", blocks.len());
    let alone = solve_equilibrium(&blocks, &Control::unhurried()).unwrap();
    let joined = AtomicUsize::new(0);
    let join = |first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)| {
        joined.fetch_add(1, Ordering::Relaxed);
        on_two_threads(first, second);
    };
    let together = solve_equilibrium(&blocks, &Control { join: Some(&join), ..Control::unhurried() }).unwrap();
    assert!(joined.into_inner() > together.iterations as usize, "each iteration takes two cores");
    let reversed: Vec<Cell> = blocks.iter().rev().copied().collect();
    let mut turned = solve_equilibrium(&reversed, &Control::unhurried()).unwrap();
    turned.von_mises_pa.reverse();
    assert!(alone.is_solved);
    assert_eq!(alone.von_mises_pa, together.von_mises_pa);
    assert_eq!(alone.von_mises_pa, turned.von_mises_pa);
}

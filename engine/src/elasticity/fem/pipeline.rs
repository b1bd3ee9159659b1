//! Steps of smoothing that follow each other through a structure.
//!
//! Each step needs the forces that the step before it causes. What it changes at a node is needed only by the blocks
//! there. So it can begin while the step before it is still under way some layers of blocks ahead, and finds in the cache
//! what that one wrote. Memory is then read once for all steps, if the layers between them fit into the cache.

#![expect(clippy::inline_always, reason = "so that the loops are compiled for the processor that the caller chose")]

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::modes::{Modes, add, forces};
use super::shares::{Corners, Share, Shares};
use super::steps::{Step, Vectors};
use crate::elasticity::Control;

/// Greatest number of steps that follow each other.
pub const MAX_STEPS: usize = 4;

/// Forces that are being added up, for each share and step: those on nodes that have been reached but are not complete.
#[derive(Debug)]
pub struct Open([[Ring; MAX_STEPS]; 2]);

/// Forces on a window of nodes, which moves on; zeros outside of it.
#[derive(Debug, Default)]
struct Ring {
    force: Vec<f64>,
    /// A power of two less one: node `n` has the place `n & mask`.
    mask: usize,
}

impl Open {
    /// Prepares the forces of shares.
    #[must_use]
    pub fn new(shares: &Shares) -> Self {
        let ring = |share: Option<&Share>| {
            let Some(share) = share else { return Ring::default() };
            let places = share.open.max(1).next_power_of_two();
            Ring { force: vec![0.0; 3 * places], mask: places - 1 }
        };
        Self([Some(&shares.first), shares.second.as_ref()].map(|share| std::array::from_fn(|_| ring(share))))
    }
}

/// Steps through a structure.
#[derive(Debug, Clone, Copy)]
pub struct Pipeline<'a> {
    /// Blocks of the structure.
    pub shares: &'a Shares,
    /// Stiffness of a block.
    pub modes: &'a Modes,
    /// Instructions to use.
    pub arch: Arch,
}

impl Pipeline<'_> {
    /// Takes steps. Before the first, `start` writes the direction of some nodes, and what else it knows, given their
    /// vectors; it is called once for each node. The numbers do not depend on whether `control` lends cores.
    pub fn take(
        &self,
        control: &Control<'_>,
        steps: &[Step],
        open: &mut Open,
        vectors: Vectors<'_>,
        start: &(impl Fn(Range<usize>, Vectors<'_>) + Sync),
    ) {
        let Shares { first, second, between } = self.shares;
        let (of_first, of_second) = vectors.split_at(first.nodes);
        let [open_first, open_second] = &mut open.0;
        let front = |share, from, vectors, open| Front {
            share,
            from,
            modes: self.modes,
            steps,
            start,
            vectors,
            open,
            started: 0,
            run: [0; MAX_STEPS],
            complete: [0; MAX_STEPS],
        };
        let mut front_first = front(first, 0, of_first, open_first);
        let Some(second) = second else {
            return self.arch.dispatch(Advance(&mut front_first));
        };
        let mut front_second = front(second, first.nodes, of_second, open_second);
        control
            .both(|| self.arch.dispatch(Advance(&mut front_first)), || self.arch.dispatch(Advance(&mut front_second)));
        self.arch.dispatch(Meet { first: &mut front_first, second: &mut front_second, between });
    }
}

/// How far the steps have come in a share.
struct Front<'a, F> {
    share: &'a Share,
    /// First node of the share.
    from: usize,
    modes: &'a Modes,
    steps: &'a [Step],
    start: &'a F,
    vectors: Vectors<'a>,
    open: &'a mut [Ring; MAX_STEPS],
    /// Number of nodes that have been started.
    started: usize,
    /// Next run of each step.
    run: [usize; MAX_STEPS],
    /// Number of nodes at which each step is complete.
    complete: [usize; MAX_STEPS],
}

impl<F: Fn(Range<usize>, Vectors<'_>)> Front<'_, F> {
    /// Starts the nodes before one.
    #[inline(always)]
    fn start(&mut self, until: usize) {
        let nodes = self.started..until.max(self.started);
        (self.start)(self.from + nodes.start..self.from + nodes.end, self.vectors.part(nodes.clone()));
        self.started = nodes.end;
    }

    /// Adds the forces of the next run of a step, and completes what has all its forces then.
    #[inline(always)]
    fn go_on<S: Simd>(&mut self, simd: S, step: usize) {
        let run = self.run[step];
        let Ring { force, mask } = &mut self.open[step];
        let mask = *mask;
        let place = |node: u32| 3 * (node as usize & mask);
        add(simd, self.share.run(run), self.modes, self.vectors.direction, force, place);
        self.run[step] += 1;
        self.complete(step, self.share.complete[run]);
    }

    /// Completes a step at the nodes before one.
    #[inline(always)]
    fn complete(&mut self, step: usize, until: usize) {
        let Ring { force, mask } = &mut self.open[step];
        let mut first = self.complete[step];
        while first < until {
            let place = first & *mask;
            // Up to the end of the ring.
            let end = until.min(first + *mask + 1 - place);
            let forces = &mut force[3 * place..3 * (place + end - first)];
            self.steps[step].complete(forces, self.vectors.part(first..end));
            first = end;
        }
        self.complete[step] = first;
    }
}

/// Lets the steps follow each other through a share, as far as they come without the blocks between the shares.
struct Advance<'a, 'b, F>(&'a mut Front<'b, F>);

impl<F: Fn(Range<usize>, Vectors<'_>)> WithSimd for Advance<'_, '_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(front) = self;
        let runs = front.share.complete.len();
        for run in 0..runs {
            front.start(front.share.reached[run]);
            front.go_on(simd, 0);
            for step in 1..front.steps.len() {
                while front.run[step] < runs && front.share.reached[front.run[step]] <= front.complete[step - 1] {
                    front.go_on(simd, step);
                }
            }
        }
    }
}

/// Takes the steps where the shares meet.
struct Meet<'a, 'b, F> {
    first: &'a mut Front<'b, F>,
    second: &'a mut Front<'b, F>,
    between: &'a [Corners],
}

impl<F: Fn(Range<usize>, Vectors<'_>)> WithSimd for Meet<'_, '_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { first, second, between } = self;
        for front in [&mut *first, &mut *second] {
            front.start(front.share.nodes);
        }
        for step in 0..first.steps.len() {
            for front in [&mut *first, &mut *second] {
                while front.run[step] < front.share.complete.len() {
                    front.go_on(simd, step);
                }
            }
            add_between(simd, between, step, first, second);
            for front in [&mut *first, &mut *second] {
                front.complete(step, front.share.nodes);
            }
        }
    }
}

/// Adds the forces of blocks with nodes of both shares.
#[inline(always)]
fn add_between<'a, S: Simd, F>(
    simd: S,
    blocks: &[Corners],
    step: usize,
    first: &mut Front<'a, F>,
    second: &mut Front<'a, F>,
) {
    let middle = second.from;
    let modes = first.modes;
    for blocks in blocks.chunks(S::F64_LANES) {
        let forces = forces(simd, blocks, modes, |node, k| {
            let node = node as usize;
            let (of, node) = if node < middle { (&*first, node) } else { (&*second, node - middle) };
            of.vectors.direction[3 * node + k]
        });
        for (lane, nodes) in blocks.iter().enumerate() {
            for (corner, &node) in nodes.iter().enumerate() {
                let node = node as usize;
                let (of, node) = if node < middle { (&mut *first, node) } else { (&mut *second, node - middle) };
                let Ring { force, mask } = &mut of.open[step];
                for (sum, of_corners) in force[3 * (node & *mask)..].iter_mut().zip(&forces) {
                    *sum += of_corners[corner][lane];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elasticity::fem::ELEMENT;
    use crate::elasticity::fem::mesh::{Mesh, Supported};
    use crate::elasticity::fem::system::System;
    use crate::elasticity::tests::on_two_threads;
    use crate::voxel::Cell;

    /// Vectors as [`Vectors`] has them, of all unknowns.
    #[derive(Debug, Clone, PartialEq)]
    struct All([Vec<f64>; 6]);

    impl All {
        fn vectors(&mut self) -> Vectors<'_> {
            let [force, compliance, direction, rest, solution, pulled] = &mut self.0;
            Vectors { force, compliance, direction, rest, solution, pulled }
        }
    }

    /// Takes the steps one after the other, each with all forces of the one before.
    fn by_rule(system: &System<'_>, all: &mut All, steps: &[Step], start: impl Fn(Range<usize>, Vectors<'_>)) {
        start(0..system.len() / 3, all.vectors());
        for step in steps {
            let mut forces = vec![0.0; system.len()];
            system.pull(&all.0[2], &mut forces);
            step.complete(&mut forces, all.vectors());
        }
    }

    #[test]
    fn steps_that_follow_each_other_are_as_those_one_by_one() {
        let on_two = Control { join: Some(&on_two_threads), ..Control::unhurried() };
        // A few blocks, a solid, blocks in no good order, and a sponge.
        let solid: Vec<Cell> = (0..30 * 30 * 30).map(|i| Cell::new(i % 30, i / 30 % 30, i / 900)).collect();
        let sponge: Vec<Cell> = solid.iter().copied().filter(|c| (c.x * 7 + c.y * 3 + c.z * 11) % 13 < 10).collect();
        let shuffled = (0..27_000).map(|i| solid[i * 3_001 % 27_000]).collect();
        let few = solid[..70].to_vec();
        for cells in [Supported::of(&few).cells, Supported::of(&solid).cells, shuffled, Supported::of(&sponge).cells] {
            let mesh = Mesh::new(cells);
            let system = System::new(&mesh, &ELEMENT, 1.0, |position| position[1] == 0);
            let vector = |seed: f64| (0..system.len()).map(|i| (i as f64 * seed).sin()).collect::<Vec<f64>>();
            let held = system.is_held.iter().flat_map(|is_held| [f64::from(u8::from(!is_held)) * 1e-10; 3]);
            let mut expected = All([vector(0.3), held.collect(), vector(0.7), vector(1.1), vector(1.3), vector(1.7)]);
            let start = |nodes: Range<usize>, vectors: Vectors<'_>| {
                for (direction, node) in vectors.direction.chunks_exact_mut(3).zip(nodes) {
                    direction.fill((node as f64).cos());
                }
            };
            let mut open = Open::new(&system.shares);
            for steps in [
                &[Step::First { of_rest: 0.8 }, Step::Next { of_direction: 0.3, of_rest: 0.5 }, Step::Settle][..],
                &[Step::End { adds: true }],
            ] {
                let (mut alone, mut together) = (expected.clone(), expected.clone());
                system.pipeline().take(&Control::unhurried(), steps, &mut open, alone.vectors(), &start);
                system.pipeline().take(&on_two, steps, &mut open, together.vectors(), &start);
                assert_eq!(alone, together, "the numbers do not depend on the cores");
                by_rule(&system, &mut expected, steps, start);
                for (k, (found, expected)) in alone.0.iter().zip(&expected.0).enumerate() {
                    let greatest = expected.iter().fold(0.0_f64, |greatest, entry| greatest.max(entry.abs()));
                    let apart = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(apart <= 1e-12 * greatest, "vector {k}: {apart} of {greatest}");
                }
            }
        }
    }
}

//! The catalogue of checks: rules with typed arguments that yield a score and evidence (`docs/rules.md#checks`).
//!
//! A check is data: `{"fn": "shape.has_rooms", "args": {"room_cnt": 2}}`. To add one, write its rule in a file of its
//! criterion, and add a line to the catalogue below. Reading a task fails on unknown check names, and on unknown,
//! missing or ill-typed arguments.

pub mod accuracy;
pub mod amount;
pub mod criterion;
pub mod evidence;
pub mod planning;
pub mod safety;
pub mod sample;

use std::cell::OnceCell;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

pub use amount::Amount;
pub use criterion::{Criterion, Dimension};
pub use evidence::{Finding, Witness};

use crate::elasticity::{Control, Stopped};
use crate::voxel::Structure;
use crate::voxel::blocks::is_structural;
use crate::voxel::inside::Surroundings;
use accuracy::{blocks, material, shape, size};
use planning::{dependency, efficiency, layers};
use safety::{equilibrium, plausibility, stability};

/// Version of this implementation of the published rules. Any change that can alter a score by more than the rounding of a
/// solver, 1e-6, increments it.
///
/// Version 2: the stress simulation sums in another order, so scores differ from those of version 1 by rounding.
pub const CHECKS_VERSION: u32 = 2;

/// Structure that a check evaluates, with the control over its computations.
pub struct Subject<'a> {
    /// Blocks in building order, as they stand after the check's turn.
    pub structure: &'a Structure,
    /// Control over long computations: progress, cancellation and additional cores.
    pub control: &'a Control<'a>,
    /// Whether findings are to have evidence beside their scores.
    wants_evidence: bool,
    /// What walking rules look at, computed when the first of them asks.
    surroundings: OnceCell<Option<Surroundings>>,
    /// The blocks of which something can be built, picked out when the first rule asks for them.
    solid: OnceCell<Structure>,
}

impl<'a> Subject<'a> {
    /// Returns a subject whose computations run to completion.
    #[must_use]
    pub fn unhurried(structure: &'a Structure) -> Self {
        Self::new(structure, const { &Control::unhurried() })
    }

    /// Returns a subject whose computations `control` can stop.
    #[must_use]
    pub const fn new(structure: &'a Structure, control: &'a Control<'a>) -> Self {
        Self { structure, control, wants_evidence: true, surroundings: OnceCell::new(), solid: OnceCell::new() }
    }

    /// Returns the same subject, of which only the scores are asked for: findings need no evidence.
    #[must_use]
    pub fn for_scores(self) -> Self {
        Self { wants_evidence: false, ..self }
    }

    /// Returns a part of the evidence, or what is empty where only the score is asked for. It must never enter a score or
    /// a branch.
    pub fn tell<T: Default>(&self, evidence: impl FnOnce() -> T) -> T {
        if self.wants_evidence { evidence() } else { T::default() }
    }

    /// Returns the blocks that something can be built of, in building order, which several checks of a turn share: none
    /// that a walker passes through, walks over or climbs in, and no doors.
    #[must_use]
    pub fn solid(&self) -> &Structure {
        self.solid.get_or_init(|| self.structure.only(is_structural))
    }

    /// Returns the blocks that a rule looks at: all, or those of [`solid`](Self::solid).
    #[must_use]
    pub fn standing(&self, only_solid: bool) -> &Structure {
        if only_solid { self.solid() } else { self.structure }
    }

    /// Returns the terrain of the build and the air around and inside it, which several checks of a turn share. `None`
    /// if the build is empty or too large.
    #[must_use]
    pub fn surroundings(&self) -> Option<&Surroundings> {
        self.surroundings.get_or_init(|| Surroundings::of(self.structure)).as_ref()
    }
}

impl std::fmt::Debug for Subject<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Subject").field("structure", self.structure).finish_non_exhaustive()
    }
}

/// A rule with its arguments.
pub trait Rule {
    /// Scores the subject. Never fails, whatever the agent built.
    fn evaluate(&self, subject: &Subject<'_>) -> Finding;
}

/// Defines the enum of checks with their names, requirements and criteria.
macro_rules! catalogue {
    ($( $criterion:ident { $( $name:literal => $variant:ident($rule:path): $what:literal, )* } )*) => {
        /// A check: a published name and its arguments.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "fn", content = "args")]
        #[expect(missing_docs, reason = "each variant is documented at its rule")]
        pub enum Check {
            $( $( #[serde(rename = $name)] $variant($rule), )* )*
        }

        impl Check {
            /// Name and requirement of each check, in the order of the catalogue.
            pub const LIST: &'static [(&'static str, &'static str)] = &[ $( $( ($name, $what), )* )* ];

            /// Reads the arguments of the check with this published name. Returns `None` if no check has that name.
            ///
            /// # Errors
            /// Returns an error with the path to the argument that is wrong.
            #[must_use]
            pub fn read(
                name: &str,
                args: &Map<String, Value>,
            ) -> Option<Result<Self, serde_path_to_error::Error<serde_json::Error>>> {
                Some(match name {
                    $( $( $name => serde_path_to_error::deserialize::<_, $rule>(args).map(Self::$variant), )* )*
                    _ => return None,
                })
            }

            /// Returns the arguments, as a task file has them.
            #[must_use]
            pub fn args(&self) -> Value {
                match self { $( $( Self::$variant(rule) => serde_json::to_value(rule), )* )* }
                    .expect("arguments are JSON")
            }

            /// Returns the requirement in words.
            #[must_use]
            pub const fn asks(&self) -> &'static str {
                match self { $( $( Self::$variant(_) => $what, )* )* }
            }

            /// Returns the published name.
            #[must_use]
            pub const fn name(&self) -> &'static str {
                match self { $( $( Self::$variant(_) => $name, )* )* }
            }

            /// Returns the criterion that the check counts towards.
            #[must_use]
            pub const fn criterion(&self) -> Criterion {
                match self { $( $( Self::$variant(_) => Criterion::$criterion, )* )* }
            }

            /// Scores the subject.
            ///
            /// # Errors
            /// Returns an error only if the subject's control stops a long computation.
            pub fn evaluate(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
                match self { $( $( Self::$variant(rule) => Evaluate::run(rule, subject), )* )* }
            }
        }
    };
}

/// How the catalogue evaluates a rule. Every [`Rule`] has it. A rule with a long computation does not implement
/// [`Rule`], but has an implementation below, so that the subject's control can stop it.
trait Evaluate {
    fn run(&self, subject: &Subject<'_>) -> Result<Finding, Stopped>;
}

impl<R: Rule> Evaluate for R {
    fn run(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        Ok(self.evaluate(subject))
    }
}

impl Evaluate for stability::StressScore {
    fn run(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        self.evaluate(subject)
    }
}

impl Evaluate for shape::exits::HasExit {
    fn run(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        self.evaluate(subject)
    }
}

impl Evaluate for shape::exits::HasWideExit {
    fn run(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        self.evaluate(subject)
    }
}

impl Evaluate for equilibrium::EquilibriumScore {
    fn run(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        self.evaluate(subject)
    }
}

catalogue! {
    Material {
        "material.is_block_cnt_equal_to" => BlockCountEqualTo(material::BlockCountEqualTo):
            "Exactly the expected number of blocks stand, counting one material if one is given",
        "material.is_block_cnt_larger_than" => BlockCountLargerThan(material::BlockCountLargerThan):
            "More than the given number of blocks stand, counting one material if one is given",
        "material.is_block_cnt_geq" => BlockCountAtLeast(material::BlockCountAtLeast):
            "At least the given number of blocks stand, counting one material if one is given",
        "material.is_block_cnt_leq" => BlockCountAtMost(material::BlockCountAtMost):
            "At most the given number of blocks stand, counting one material if one is given",
        "material.is_all_material_equal_to" => AllMaterialEqualTo(material::AllMaterialEqualTo):
            "Every block is of the expected material",
        "material.is_corner_material_equal_to" => CornerMaterialEqualTo(material::CornerMaterialEqualTo):
            "At least the required share of the corner blocks of one level is of the expected material",
        "material.is_min_x_material_equal_to" => MinXMaterialEqualTo(material::MinXMaterialEqualTo):
            "At least the required share of the blocks with the least x on one level is of the expected material",
        "material.is_max_x_material_equal_to" => MaxXMaterialEqualTo(material::MaxXMaterialEqualTo):
            "At least the required share of the blocks with the greatest x on one level is of the expected material",
        "material.is_min_z_material_equal_to" => MinZMaterialEqualTo(material::MinZMaterialEqualTo):
            "At least the required share of the blocks with the least z on one level is of the expected material",
        "material.is_max_z_material_equal_to" => MaxZMaterialEqualTo(material::MaxZMaterialEqualTo):
            "At least the required share of the blocks with the greatest z on one level is of the expected material",
        "material.is_highest_block_material_equal_to" =>
            HighestBlockMaterialEqualTo(material::HighestBlockMaterialEqualTo):
            "At least the required share of the highest blocks is of the expected material",
        "material.are_blocks_known" => BlocksKnown(blocks::BlocksKnown):
            "Every block is a block of the game, and none is air (strict)",
        "material.count_is_within" => CountWithin(blocks::CountWithin):
            "The number of blocks, counting one kind or family if one is given, lies within the given bounds (strict)",
        "material.is_made_of" => MadeOf(blocks::MadeOf):
            "At least the required share of one part of the build is of the given kind or family (strict)",
    }
    Size {
        "size.is_equal" => SizeEqual(size::Equal):
            "The plan, in either orientation, and the height, if one is given, have exactly the given size",
        "size.is_leq" => SizeAtMost(size::AtMost):
            "The plan, in either orientation, and the height, if one is given, have at most the given size",
        "size.min_y_is_equal" => MinYEqual(size::MinYEqual):
            "The lowest block lies exactly at the given level",
        "size.min_y_is_leq" => MinYAtMost(size::MinYAtMost):
            "The lowest block lies at or below the given level",
        "size.max_y_is_geq" => MaxYAtLeast(size::MaxYAtLeast):
            "The highest block lies at or above the given level",
        "size.all_dimensions_geq" => AllDimensionsAtLeast(size::AllDimensionsAtLeast):
            "The build measures at least the given number of blocks along every axis",
    }
    Shape {
        "shape.cluster_count_at_y_is" => ClusterCountAtY(shape::clusters::ClusterCountAtY):
            "One level has exactly the expected number of separate clusters",
        "shape.clusters_at_y_have_min_span" => ClustersAtYHaveMinSpan(shape::clusters::ClustersAtYHaveMinSpan):
            "The clusters of one level are at least the given distance apart, between their nearest cells",
        "shape.cluster_at_y_has_min_radius" => ClusterAtYHasMinRadius(shape::clusters::ClusterAtYHasMinRadius):
            "One level has a single cluster, which reaches at least the given distance from the mean of its cells",
        "shape.cluster_at_y_has_min_diameter" => ClusterAtYHasMinDiameter(shape::clusters::ClusterAtYHasMinDiameter):
            "One level has a single cluster, whose farthest cells are at least the given distance apart",
        "shape.is_top_surface_concave" => TopSurfaceConcave(shape::surfaces::TopSurfaceConcave):
            "Some slice of the upper surface bulges up",
        "shape.is_bottom_surface_concave" => BottomSurfaceConcave(shape::surfaces::BottomSurfaceConcave):
            "Some slice of the lower surface bulges down (that of a true arch does not)",
        "shape.is_true_arch" => TrueArch(shape::arch::TrueArch):
            "Between two supports, the underside and the upper surface rise from both ends and bulge up (our own rule)",
        "shape.has_rooms" => HasRooms(shape::rooms::HasRooms):
            "Walls enclose at least the given number of rooms on one level",
        "shape.are_doors_passable" => DoorsPassable(shape::doors::DoorsPassable):
            "Every door can be walked through",
        "shape.are_adjacent" => Adjacent(shape::doors::Adjacent):
            "A block of the first material shares a face with a block of the second",
        "shape.is_single_level" => SingleLevel(shape::single_level::SingleLevel):
            "A level path on the lowest floor leads from every start to the outside",
        "shape.has_exit" => HasExit(shape::exits::HasExit):
            "A box of the given size can move from a start to the outside",
        "shape.has_wide_exit" => HasWideExit(shape::exits::HasWideExit):
            "A box of the given width and two blocks high can move from a start to the outside",
        "shape.has_axis_symmetry" => HasAxisSymmetry(shape::symmetry::HasAxisSymmetry):
            "The build is its own mirror image along at least one axis",
        "shape.has_no_axis_symmetry" => HasNoAxisSymmetry(shape::symmetry::HasNoAxisSymmetry):
            "The build is not its own mirror image along any axis",
        "shape.is_reachable_by_stairs" => ReachableByStairs(shape::stairs::ReachableByStairs):
            "Stairs with head room lead from y = 0 up to the given level",
        "shape.has_enclosed_rooms" => EnclosedRooms(shape::enclosed::EnclosedRooms):
            "At least the given number of rooms have walls, a roof, head room and a way in through doors (strict)",
        "shape.doors_lead_through" => DoorsLeadThrough(shape::enclosed::DoorsLeadThrough):
            "At least the given number of doors stand, and each can be walked straight through (strict)",
        "shape.walks_out" => WalksOut(shape::ways::WalksOut):
            "A walkable path leads outside from beside every block of the given kind or family (strict)",
        "shape.climbs_to" => ClimbsTo(shape::ways::ClimbsTo):
            "A path in steps of one block climbs from the ground around the build to the given level (strict)",
        "shape.has_clear_span" => ClearSpan(shape::spans::HasClearSpan):
            "At least the given number of free cells lie between two supports, and a deck crosses them (strict)",
        "shape.has_upper_floor" => UpperFloor(shape::ways::HasUpperFloor):
            "From outside one can walk and climb to enough enclosed cells of floor at or above the given level (strict)",
        "shape.has_ceilings" => Ceilings(shape::ceilings::HasCeilings):
            "The ceilings of the rooms lie at enough different levels (strict)",
        "shape.has_columns" => Columns(shape::columns::HasColumns):
            "Enough columns fill the same cells on every level from their feet to what they carry (strict)",
        "shape.level_has" => LevelHas(shape::level::LevelHas):
            "The blocks of one level have the given number, number of parts and extent (strict)",
        "shape.is_vault" => Vault(shape::vaults::IsVault):
            "A cover closes the hollow below it, and rises from all sides to its middle (strict)",
    }
    PhysicalPlausibility {
        "physical_plausibility.is_ground_connected" => GroundConnected(plausibility::GroundConnected):
            "Every block is connected to the ground through shared faces",
    }
    StructuralStability {
        "structural_stability.stress_score" => StressScore(stability::StressScore):
            "The greatest von Mises stress does not exceed the reference",
        "structural_stability.equilibrium_score" => EquilibriumScore(equilibrium::EquilibriumScore):
            "The greatest von Mises stress in equilibrium does not exceed the reference (strict)",
    }
    Efficiency {
        "efficiency.l1_dist" => L1Distance(efficiency::L1Distance):
            "Each block is placed next to the previous one",
    }
    Dependency {
        "dependency.material_sequence_order" => MaterialSequenceOrder(dependency::MaterialSequenceOrder):
            "The given materials are placed in the given order",
        "dependency.layers_follow" => LayersFollow(layers::LayersFollow):
            "Each layer is complete before the next begins (strict)",
    }
}

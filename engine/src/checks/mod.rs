//! Checks: THE list of rules, each with typed arguments, a score and evidence (SPEC 3).
//!
//! A check is data: `{"fn": "shape.has_rooms", "args": {"room_cnt": 2}}`. Adding one takes a file or a place in one
//! of the criteria's files, and a line in the list below. Unknown names, and unknown, missing or ill-typed arguments,
//! are refused when a task is read.

pub mod accuracy;
pub mod amount;
pub mod evidence;
pub mod planning;
pub mod safety;

use serde::{Deserialize, Serialize};

pub use amount::Amount;
pub use evidence::{Finding, Witness};

use crate::elasticity::{Control, Stopped};
use crate::voxel::Structure;
use accuracy::{blocks, material, shape, size};
use planning::{dependency, efficiency, layers};
use safety::{equilibrium, plausibility, stability};

/// Version of the published rules as coded here. A change that can alter a score raises it.
///
/// 2: the stress simulation adds in another order; scores differ from those of 1 by rounding.
pub const CHECKS_VERSION: u32 = 2;

/// What a check looks at.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The ordered blocks after the check's turn.
    pub structure: &'a Structure,
    /// How long computations are watched, ended and shared out.
    pub control: &'a Control<'a>,
}

impl<'a> Subject<'a> {
    /// A subject whose computations run to their end.
    #[must_use]
    pub fn unhurried(structure: &'a Structure) -> Self {
        Self { structure, control: const { &Control::unhurried() } }
    }
}

impl std::fmt::Debug for Subject<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Subject").field("structure", self.structure).finish_non_exhaustive()
    }
}

/// A rule with its arguments.
pub trait Rule {
    /// Scores the subject. Cannot fail, whatever an agent built.
    fn evaluate(&self, subject: &Subject<'_>) -> Finding;
}

/// One of the seven criteria (paper, section 4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// Accuracy: what it is made of.
    Material,
    /// Accuracy: what form it has.
    Shape,
    /// Accuracy: how large it is.
    Size,
    /// Safety: whether it could stand at all.
    PhysicalPlausibility,
    /// Safety: how far it is from breaking.
    StructuralStability,
    /// Planning: how little movement it took.
    Efficiency,
    /// Planning: whether parts came after what carries them.
    Dependency,
}

/// One of the three dimensions that the criteria belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Dimension {
    /// Material, shape, size.
    Accuracy,
    /// Physical plausibility, structural stability.
    Safety,
    /// Efficiency, dependency.
    Planning,
}

impl Criterion {
    /// All seven, in the paper's order.
    pub const ALL: [Self; 7] = [
        Self::Material,
        Self::Shape,
        Self::Size,
        Self::PhysicalPlausibility,
        Self::StructuralStability,
        Self::Efficiency,
        Self::Dependency,
    ];

    /// The dimension it belongs to.
    #[must_use]
    pub const fn dimension(self) -> Dimension {
        match self {
            Self::Material | Self::Shape | Self::Size => Dimension::Accuracy,
            Self::PhysicalPlausibility | Self::StructuralStability => Dimension::Safety,
            Self::Efficiency | Self::Dependency => Dimension::Planning,
        }
    }

    /// Its name in the API and in published files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Material => "material",
            Self::Shape => "shape",
            Self::Size => "size",
            Self::PhysicalPlausibility => "physical_plausibility",
            Self::StructuralStability => "structural_stability",
            Self::Efficiency => "efficiency",
            Self::Dependency => "dependency",
        }
    }
}

impl Dimension {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Accuracy, Self::Safety, Self::Planning];

    /// Its name in the API and in published files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Accuracy => "accuracy",
            Self::Safety => "safety",
            Self::Planning => "planning",
        }
    }
}

/// Makes the list: the enum of checks, their names, what they ask, and their criteria.
macro_rules! catalogue {
    ($( $criterion:ident { $( $name:literal => $variant:ident($rule:path): $what:literal, )* } )*) => {
        /// A check: a published name with its arguments.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "fn", content = "args")]
        #[expect(missing_docs, reason = "each variant is documented at its rule")]
        pub enum Check {
            $( $( #[serde(rename = $name)] $variant($rule), )* )*
        }

        impl Check {
            /// Name of each check and what it asks, in the order of the list.
            pub const LIST: &'static [(&'static str, &'static str)] = &[ $( $( ($name, $what), )* )* ];

            /// What it asks, in words.
            #[must_use]
            pub const fn asks(&self) -> &'static str {
                match self { $( $( Self::$variant(_) => $what, )* )* }
            }

            /// The published name.
            #[must_use]
            pub const fn name(&self) -> &'static str {
                match self { $( $( Self::$variant(_) => $name, )* )* }
            }

            /// The criterion it counts for.
            #[must_use]
            pub const fn criterion(&self) -> Criterion {
                match self { $( $( Self::$variant(_) => Criterion::$criterion, )* )* }
            }

            /// Scores the subject.
            ///
            /// # Errors
            /// Only where the subject's control asked a long computation to end.
            pub fn evaluate(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
                match self { $( $( Self::$variant(rule) => Evaluate::run(rule, subject), )* )* }
            }
        }
    };
}

/// Lets the list treat rules that may be stopped and rules that never are alike.
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

impl Evaluate for equilibrium::EquilibriumScore {
    fn run(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        self.evaluate(subject)
    }
}

catalogue! {
    Material {
        "material.is_block_cnt_equal_to" => BlockCountEqualTo(material::BlockCountEqualTo):
            "So many blocks stand, of a material where one is given",
        "material.is_block_cnt_larger_than" => BlockCountLargerThan(material::BlockCountLargerThan):
            "More than so many blocks stand, of a material where one is given",
        "material.is_block_cnt_geq" => BlockCountAtLeast(material::BlockCountAtLeast):
            "At least so many blocks stand, of a material where one is given",
        "material.is_block_cnt_leq" => BlockCountAtMost(material::BlockCountAtMost):
            "At most so many blocks stand, of a material where one is given",
        "material.is_all_material_equal_to" => AllMaterialEqualTo(material::AllMaterialEqualTo):
            "Every block is of the material",
        "material.is_corner_material_equal_to" => CornerMaterialEqualTo(material::CornerMaterialEqualTo):
            "Enough of the corners of a level are of the material",
        "material.is_min_x_material_equal_to" => MinXMaterialEqualTo(material::MinXMaterialEqualTo):
            "Enough of the blocks at the least x of a level are of the material",
        "material.is_max_x_material_equal_to" => MaxXMaterialEqualTo(material::MaxXMaterialEqualTo):
            "Enough of the blocks at the greatest x of a level are of the material",
        "material.is_min_z_material_equal_to" => MinZMaterialEqualTo(material::MinZMaterialEqualTo):
            "Enough of the blocks at the least z of a level are of the material",
        "material.is_max_z_material_equal_to" => MaxZMaterialEqualTo(material::MaxZMaterialEqualTo):
            "Enough of the blocks at the greatest z of a level are of the material",
        "material.is_highest_block_material_equal_to" =>
            HighestBlockMaterialEqualTo(material::HighestBlockMaterialEqualTo):
            "Enough of the highest blocks are of the material",
        "material.are_blocks_known" => BlocksKnown(blocks::BlocksKnown):
            "Every block is one of the game's, and none is air (strict)",
        "material.count_is_within" => CountWithin(blocks::CountWithin):
            "So many blocks of a kind or a family stand (strict)",
        "material.is_made_of" => MadeOf(blocks::MadeOf):
            "Enough of a part of the build is of a kind or a family (strict)",
    }
    Size {
        "size.is_equal" => SizeEqual(size::Equal):
            "The plan, turned either way, and the height are exactly so large",
        "size.is_leq" => SizeAtMost(size::AtMost):
            "The plan, turned either way, and the height are at most so large",
        "size.min_y_is_equal" => MinYEqual(size::MinYEqual):
            "The lowest block lies exactly at a level",
        "size.min_y_is_leq" => MinYAtMost(size::MinYAtMost):
            "The lowest block lies at a level or below",
        "size.max_y_is_geq" => MaxYAtLeast(size::MaxYAtLeast):
            "The highest block lies at a level or above",
        "size.all_dimensions_geq" => AllDimensionsAtLeast(size::AllDimensionsAtLeast):
            "It measures at least so many blocks along every axis",
    }
    Shape {
        "shape.cluster_count_at_y_is" => ClusterCountAtY(shape::clusters::ClusterCountAtY):
            "A level shows so many separate clusters",
        "shape.clusters_at_y_have_min_span" => ClustersAtYHaveMinSpan(shape::clusters::ClustersAtYHaveMinSpan):
            "The clusters of a level keep a distance between their nearest cells",
        "shape.cluster_at_y_has_min_radius" => ClusterAtYHasMinRadius(shape::clusters::ClusterAtYHasMinRadius):
            "The one cluster of a level reaches so far from its middle",
        "shape.cluster_at_y_has_min_diameter" => ClusterAtYHasMinDiameter(shape::clusters::ClusterAtYHasMinDiameter):
            "The one cluster of a level has two cells so far apart",
        "shape.is_top_surface_concave" => TopSurfaceConcave(shape::surfaces::TopSurfaceConcave):
            "Some cut of the upper surface bulges up",
        "shape.is_bottom_surface_concave" => BottomSurfaceConcave(shape::surfaces::BottomSurfaceConcave):
            "Some cut of the lower surface bulges down (a true arch does not)",
        "shape.is_true_arch" => TrueArch(shape::arch::TrueArch):
            "Between two supports, underside and upper surface rise from both ends and bulge up (our own rule)",
        "shape.has_rooms" => HasRooms(shape::rooms::HasRooms):
            "So many rooms are walled all round at a level",
        "shape.are_doors_passable" => DoorsPassable(shape::doors::DoorsPassable):
            "Every door can be walked through",
        "shape.are_adjacent" => Adjacent(shape::doors::Adjacent):
            "Two materials touch somewhere",
        "shape.is_single_level" => SingleLevel(shape::single_level::SingleLevel):
            "One floor leads from every start to the outside without a step",
        "shape.has_exit" => HasExit(shape::exits::HasExit):
            "A passage of a size leads from the start to the outside",
        "shape.has_wide_exit" => HasWideExit(shape::exits::HasWideExit):
            "A passage wide enough leads from the start to the outside",
        "shape.has_axis_symmetry" => HasAxisSymmetry(shape::symmetry::HasAxisSymmetry):
            "It is its own mirror image along some axis",
        "shape.has_no_axis_symmetry" => HasNoAxisSymmetry(shape::symmetry::HasNoAxisSymmetry):
            "It is not its own mirror image along any axis",
        "shape.is_reachable_by_stairs" => ReachableByStairs(shape::stairs::ReachableByStairs):
            "Steps lead from the ground up to a level",
        "shape.has_enclosed_rooms" => EnclosedRooms(shape::enclosed::EnclosedRooms):
            "So many rooms have walls, a roof, head room and a door that leads in from outside (strict)",
        "shape.doors_lead_through" => DoorsLeadThrough(shape::enclosed::DoorsLeadThrough):
            "There are doors, and through each one walks straight (strict)",
        "shape.walks_out" => WalksOut(shape::ways::WalksOut):
            "From beside every block of a kind one walks outside on floors (strict)",
        "shape.climbs_to" => ClimbsTo(shape::ways::ClimbsTo):
            "From the ground around it one climbs to a level (strict)",
        "shape.has_clear_span" => ClearSpan(shape::spans::HasClearSpan):
            "Two supports leave so many free cells between them, and a deck crosses them (strict)",
        "shape.is_vault" => Vault(shape::vaults::IsVault):
            "A hollow is closed above, and the cover rises from all sides to its middle (strict)",
    }
    PhysicalPlausibility {
        "physical_plausibility.is_ground_connected" => GroundConnected(plausibility::GroundConnected):
            "Every block hangs together with the ground, face to face",
    }
    StructuralStability {
        "structural_stability.stress_score" => StressScore(stability::StressScore):
            "The greatest von Mises stress stays within a reference",
        "structural_stability.equilibrium_score" => EquilibriumScore(equilibrium::EquilibriumScore):
            "The greatest von Mises stress in equilibrium stays within a reference (strict)",
    }
    Efficiency {
        "efficiency.l1_dist" => L1Distance(efficiency::L1Distance):
            "Each block is placed next to the one before",
    }
    Dependency {
        "dependency.material_sequence_order" => MaterialSequenceOrder(dependency::MaterialSequenceOrder):
            "Materials first come in the given order",
        "dependency.layers_follow" => LayersFollow(layers::LayersFollow):
            "Each layer is finished before the next begins (strict)",
    }
}

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
use accuracy::{material, shape, size};
use planning::{dependency, efficiency};
use safety::{plausibility, stability};

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

/// Makes the list: the enum of checks, their published names, and their criteria.
macro_rules! catalogue {
    ($( $criterion:ident { $( $name:literal => $variant:ident($rule:path), )* } )*) => {
        /// A check: a published name with its arguments.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "fn", content = "args")]
        #[expect(missing_docs, reason = "each variant is documented at its rule")]
        pub enum Check {
            $( $( #[serde(rename = $name)] $variant($rule), )* )*
        }

        impl Check {
            /// Names of all checks, in the order of the list.
            pub const NAMES: &'static [&'static str] = &[ $( $( $name, )* )* ];

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

catalogue! {
    Material {
        "material.is_block_cnt_equal_to" => BlockCountEqualTo(material::BlockCountEqualTo),
        "material.is_block_cnt_larger_than" => BlockCountLargerThan(material::BlockCountLargerThan),
        "material.is_block_cnt_geq" => BlockCountAtLeast(material::BlockCountAtLeast),
        "material.is_block_cnt_leq" => BlockCountAtMost(material::BlockCountAtMost),
        "material.is_all_material_equal_to" => AllMaterialEqualTo(material::AllMaterialEqualTo),
        "material.is_corner_material_equal_to" => CornerMaterialEqualTo(material::CornerMaterialEqualTo),
        "material.is_min_x_material_equal_to" => MinXMaterialEqualTo(material::MinXMaterialEqualTo),
        "material.is_max_x_material_equal_to" => MaxXMaterialEqualTo(material::MaxXMaterialEqualTo),
        "material.is_min_z_material_equal_to" => MinZMaterialEqualTo(material::MinZMaterialEqualTo),
        "material.is_max_z_material_equal_to" => MaxZMaterialEqualTo(material::MaxZMaterialEqualTo),
        "material.is_highest_block_material_equal_to" =>
            HighestBlockMaterialEqualTo(material::HighestBlockMaterialEqualTo),
    }
    Size {
        "size.is_equal" => SizeEqual(size::Equal),
        "size.is_leq" => SizeAtMost(size::AtMost),
        "size.min_y_is_equal" => MinYEqual(size::MinYEqual),
        "size.min_y_is_leq" => MinYAtMost(size::MinYAtMost),
        "size.max_y_is_geq" => MaxYAtLeast(size::MaxYAtLeast),
        "size.all_dimensions_geq" => AllDimensionsAtLeast(size::AllDimensionsAtLeast),
    }
    Shape {
        "shape.cluster_count_at_y_is" => ClusterCountAtY(shape::clusters::ClusterCountAtY),
        "shape.clusters_at_y_have_min_span" => ClustersAtYHaveMinSpan(shape::clusters::ClustersAtYHaveMinSpan),
        "shape.cluster_at_y_has_min_radius" => ClusterAtYHasMinRadius(shape::clusters::ClusterAtYHasMinRadius),
        "shape.cluster_at_y_has_min_diameter" => ClusterAtYHasMinDiameter(shape::clusters::ClusterAtYHasMinDiameter),
        "shape.is_top_surface_concave" => TopSurfaceConcave(shape::surfaces::TopSurfaceConcave),
        "shape.is_bottom_surface_concave" => BottomSurfaceConcave(shape::surfaces::BottomSurfaceConcave),
        "shape.has_rooms" => HasRooms(shape::rooms::HasRooms),
        "shape.are_doors_passable" => DoorsPassable(shape::doors::DoorsPassable),
        "shape.are_adjacent" => Adjacent(shape::doors::Adjacent),
        "shape.is_single_level" => SingleLevel(shape::single_level::SingleLevel),
        "shape.has_exit" => HasExit(shape::exits::HasExit),
        "shape.has_wide_exit" => HasWideExit(shape::exits::HasWideExit),
        "shape.has_axis_symmetry" => HasAxisSymmetry(shape::symmetry::HasAxisSymmetry),
        "shape.has_no_axis_symmetry" => HasNoAxisSymmetry(shape::symmetry::HasNoAxisSymmetry),
        "shape.is_reachable_by_stairs" => ReachableByStairs(shape::stairs::ReachableByStairs),
    }
    PhysicalPlausibility {
        "physical_plausibility.is_ground_connected" => GroundConnected(plausibility::GroundConnected),
    }
    StructuralStability {
        "structural_stability.stress_score" => StressScore(stability::StressScore),
    }
    Efficiency {
        "efficiency.l1_dist" => L1Distance(efficiency::L1Distance),
    }
    Dependency {
        "dependency.material_sequence_order" => MaterialSequenceOrder(dependency::MaterialSequenceOrder),
    }
}

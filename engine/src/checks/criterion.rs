//! The seven criteria and their three dimensions (`docs/rules.md#scores`; paper, section 4).

use serde::{Deserialize, Serialize};

/// One of the seven criteria (paper, section 4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// Accuracy: the materials of the build.
    Material,
    /// Accuracy: the form of the build.
    Shape,
    /// Accuracy: the dimensions of the build.
    Size,
    /// Safety: whether the build could stand at all.
    PhysicalPlausibility,
    /// Safety: how far the build is from breaking.
    StructuralStability,
    /// Planning: how little the builder moved between blocks.
    Efficiency,
    /// Planning: whether the parts were built in the order that the task asks for.
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
    /// All seven criteria, in the paper's order.
    pub const ALL: [Self; 7] = [
        Self::Material,
        Self::Shape,
        Self::Size,
        Self::PhysicalPlausibility,
        Self::StructuralStability,
        Self::Efficiency,
        Self::Dependency,
    ];

    /// Returns the dimension that the criterion belongs to.
    #[must_use]
    pub const fn dimension(self) -> Dimension {
        match self {
            Self::Material | Self::Shape | Self::Size => Dimension::Accuracy,
            Self::PhysicalPlausibility | Self::StructuralStability => Dimension::Safety,
            Self::Efficiency | Self::Dependency => Dimension::Planning,
        }
    }

    /// Returns whether a problem passes only if this criterion holds, where it applies (`docs/rules.md#scores`).
    #[must_use]
    pub const fn decides(self) -> bool {
        match self {
            Self::Material | Self::Shape | Self::Size | Self::PhysicalPlausibility | Self::Dependency => true,
            Self::StructuralStability | Self::Efficiency => false,
        }
    }

    /// Returns the criterion's name in the API and in published files.
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
    /// All three dimensions.
    pub const ALL: [Self; 3] = [Self::Accuracy, Self::Safety, Self::Planning];

    /// Returns the dimension's name in the API and in published files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Accuracy => "accuracy",
            Self::Safety => "safety",
            Self::Planning => "planning",
        }
    }
}

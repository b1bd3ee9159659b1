//! What a task demands, read from its checks.

use crate::checks::Check;

/// Parameters of one turn, as far as its checks tell them.
#[derive(Debug, Clone, Default)]
pub struct Demands {
    /// Plan size in blocks.
    pub plan: Option<[i32; 2]>,
    /// Height in blocks.
    pub height: Option<i32>,
    /// Exact number of blocks of any material.
    pub block_count: Option<i32>,
    /// Least number of blocks of any material.
    pub least_blocks: Option<i32>,
    /// Level of the lowest block.
    pub lowest_y: Option<i32>,
    /// Level that the highest block reaches.
    pub highest_y: Option<i32>,
    /// Level that stairs lead to.
    pub stairs_to_y: Option<i32>,
    /// Clusters demanded, as (level, number).
    pub clusters: Vec<(i32, i32)>,
    /// Distance between clusters.
    pub span: Option<i32>,
    /// Distance of two blocks of one level.
    pub diameter: Option<i32>,
    /// Rooms.
    pub rooms: i32,
    /// Beds.
    pub beds: i32,
    /// Seats.
    pub seats: i32,
    /// Extent along each axis.
    pub extent: Option<i32>,
    /// Colour of the highest blocks.
    pub top_colour: Option<String>,
    /// Materials in the order in which they come.
    pub sequence: Vec<String>,
    /// Whether mirror images are unwanted.
    pub asymmetric: bool,
    /// Reference stress, Pa.
    pub reference_pa: Option<f64>,
}

impl Demands {
    /// The demands that these checks make.
    #[must_use]
    pub fn of(checks: &[Check]) -> Self {
        let mut demands = Self::default();
        for check in checks {
            demands.add(check);
        }
        demands
    }

    fn add(&mut self, check: &Check) {
        match check {
            Check::SizeEqual(c) => {
                self.plan = Some(c.xz.map(|blocks| blocks.0 as i32));
                self.height = c.y.map(|blocks| blocks.0 as i32);
            }
            Check::BlockCountEqualTo(c) => match c.expected_material.as_deref() {
                None => self.block_count = Some(c.expected_count.0 as i32),
                Some("bed") => self.beds = c.expected_count.0 as i32,
                Some("oak_stairs") => self.seats = c.expected_count.0 as i32,
                Some(_) => {}
            },
            Check::BlockCountAtLeast(c) if c.expected_material.is_none() => {
                self.least_blocks = Some(c.min_count.0 as i32);
            }
            Check::MinYEqual(c) => self.lowest_y = Some(c.expected_y.0 as i32),
            Check::MaxYAtLeast(c) => self.highest_y = Some(c.min_y.0.ceil() as i32),
            Check::ReachableByStairs(c) => self.stairs_to_y = Some(c.min_floor_y.0.ceil() as i32),
            Check::ClusterCountAtY(c) => self.clusters.push((c.y, c.expected_count.0 as i32)),
            Check::ClustersAtYHaveMinSpan(c) => self.span = Some(c.min_span.0.ceil() as i32),
            Check::ClusterAtYHasMinDiameter(c) => self.diameter = Some(c.min_diameter.0.ceil() as i32),
            Check::HasRooms(c) => self.rooms = c.room_cnt.0 as i32,
            Check::AllDimensionsAtLeast(c) => self.extent = Some(c.min_size.0 as i32),
            Check::HighestBlockMaterialEqualTo(c) => self.top_colour = Some(c.expected_material.clone()),
            Check::MaterialSequenceOrder(c) => self.sequence.clone_from(&c.material_sequence),
            Check::HasNoAxisSymmetry(_) => self.asymmetric = true,
            Check::StressScore(c) => self.reference_pa = Some(c.reference_pa.0),
            _ => {}
        }
    }

    /// The block that stands for the `i`th material of the sequence.
    #[must_use]
    pub fn material(&self, i: usize) -> &str {
        match self.sequence.get(i).map(String::as_str) {
            None => "stone",
            Some("concrete") => "gray_concrete",
            Some("iron") => "iron_block",
            Some("red") => "red_wool",
            Some(name) => name,
        }
    }
}

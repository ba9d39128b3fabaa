//! What the ground truth integrates over, seen as regions that can be bounded, split and sampled.

use glam::DVec3;

use super::cone::Cone;
use super::medium::Phase;

/// A point that receives light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receiver {
    pub position: DVec3,
    /// Unit direction towards the camera.
    pub view: DVec3,
    pub place: Place,
}

/// Where a receiver is, and so which part of the light counts there.
#[derive(Clone, Copy, Debug)]
pub(super) enum Place {
    /// On a triangle; the unit normal is towards the camera. Light counts by its cosine.
    Surface { normal: DVec3, triangle: u32 },
    /// In the medium, where the part counts that is scattered to the camera. Bounds hold for all points that are at most so far
    /// from the position, towards the camera or away from it: for a piece of a line of sight, m.
    Medium { phase: Phase, half_length: f64 },
}

/// How fine the cuts of a domain are made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fineness {
    /// Twice the splits of a cut pay if they bring the total of measure × bound, and so the variance of a point, below this part of
    /// what it was,
    pub worthwhile: f64,
    /// or while that is above this many times the typical irradiance of the picture.
    pub refined_above: Option<f64>,
    /// A cut of fewer splits is never as fine as pays.
    pub least_splits: u32,
    /// Where a finer cut would pay, so many times fewer points: the next pass brings more.
    pub fewer_points: u64,
}

/// In two dimensions.
pub(super) const ON_SURFACES: Fineness =
    Fineness { worthwhile: 0.3, refined_above: Some(50.0), least_splits: 64, fewer_points: 4 };

/// No triangle's index.
const NONE: u32 = u32::MAX;

impl Receiver {
    /// The triangle that it lies on, if any, which is in no light's way.
    pub fn triangle(&self) -> u32 {
        match self.place {
            Place::Surface { triangle, .. } => triangle,
            Place::Medium { .. } => NONE,
        }
    }

    /// The part of the radiance from a direction that counts, times the length of the vector that has it; at most 0 where none
    /// does.
    pub fn received(&self, offset: DVec3) -> f64 {
        match self.place {
            Place::Surface { normal, .. } => offset.dot(normal),
            Place::Medium { phase, .. } => {
                let length = offset.length();
                length * phase.value(-offset.dot(self.view) / length)
            }
        }
    }

    /// The largest part of the radiance from any direction of a cone that counts.
    pub fn most_received(&self, cone: &Cone) -> f64 {
        match self.place {
            Place::Surface { normal, .. } => cone.largest_cosine(normal, 0.0),
            Place::Medium { phase, .. } => phase.largest(self.view, cone),
        }
    }

    /// How far from the position a bound must hold, m.
    pub fn half_length(&self) -> f64 {
        match self.place {
            Place::Surface { .. } => 0.0,
            Place::Medium { half_length, .. } => half_length,
        }
    }

    /// From the nearest of its points to another one, m.
    pub fn distance(&self, point: DVec3) -> f64 {
        let to = point - self.position;
        let along = to.dot(self.view).clamp(-self.half_length(), self.half_length());
        (to - along * self.view).length()
    }
}

/// A set with a measure (area or solid angle, or length times one of these), tiled by regions.
pub(super) trait Domain: Sync {
    /// A part of the set.
    type Region: Copy + Send;

    /// How fine its cuts are made.
    fn fineness(&self) -> Fineness;

    /// What the integral is for: a point, or a line of sight.
    type Receiver: Copy + Sync;

    /// Regions that tile the whole set.
    fn roots(&self, visit: &mut dyn FnMut(Self::Region));

    /// m² or sr, or more dimensions.
    fn measure(&self, region: &Self::Region) -> f64;

    /// At least the largest sum of the integrand's channels over a region, and 0 only where the integrand vanishes
    /// everywhere. Where the integrand is singular it may be smaller; that costs variance, not truth.
    fn bound(&self, region: &Self::Region, receiver: &Self::Receiver) -> f64;

    /// Visits smaller regions that tile this one; visits none where it is small enough.
    fn split(&self, region: &Self::Region, receiver: &Self::Receiver, visit: &mut dyn FnMut(Self::Region));

    /// Sorts regions so that neighbours in the order are neighbours in space.
    fn order(&self, region: &Self::Region) -> u64;

    /// Whether the integrand depends on the last five numbers.
    fn needs_all_numbers(&self) -> bool;

    /// The integrand at a point of the region that is uniform if the first three of `u` are uniform in [0, 1)³. Of the next ones two choose
    /// the microfacet, and one the place on a line of sight; the last two choose a point of what lights the surfaces that are seen. The
    /// integrand is the mean over these.
    fn integrand(&self, region: &Self::Region, u: [f64; 8], receiver: &Self::Receiver) -> DVec3;
}

/// What lights points: its regions may be bounded for a piece of a line of sight at once.
pub(super) trait Lighting: Domain<Receiver = Receiver> {
    /// By about how many radians directions of light differ within a region, seen from one point of a piece, and within the piece,
    /// seen by one point of the region.
    fn angles(&self, region: &Self::Region, piece: &Receiver) -> [f64; 2];
}

//! What the ground truth integrates over, seen as regions that can be bounded, split and sampled.

use glam::DVec3;

/// A point that receives light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receiver {
    pub position: DVec3,
    /// Unit normal, towards the camera.
    pub normal: DVec3,
    /// Unit direction towards the camera.
    pub view: DVec3,
    /// The triangle that it lies on.
    pub triangle: u32,
}

/// A set with a measure (area or solid angle), tiled by regions.
pub(super) trait Domain: Sync {
    /// A part of the set.
    type Region: Copy + Send;

    /// Regions that tile the whole set.
    fn roots(&self, visit: &mut dyn FnMut(Self::Region));

    /// m² or sr.
    fn measure(&self, region: &Self::Region) -> f64;

    /// At least the largest sum of the integrand's channels over a region, and 0 only where the integrand vanishes
    /// everywhere. Where the integrand is singular it may be smaller; that costs variance, not truth.
    fn bound(&self, region: &Self::Region, receiver: &Receiver) -> f64;

    /// Visits smaller regions that tile this one; visits none where it is small enough.
    fn split(&self, region: &Self::Region, visit: &mut dyn FnMut(Self::Region));

    /// Sorts regions so that neighbours in the order are neighbours in space.
    fn order(&self, region: &Self::Region) -> u64;

    /// Whether the integrand is itself the mean over two more numbers, uniform in [0, 1)².
    fn is_mean(&self) -> bool;

    /// The integrand at a point of the region that is uniform if the first three of `u` are uniform in [0, 1)³; the others are
    /// those of [`Domain::is_mean`].
    fn integrand(&self, region: &Self::Region, u: [f64; 5], receiver: &Receiver) -> DVec3;
}

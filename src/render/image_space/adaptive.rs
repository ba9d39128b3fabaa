//! Photons where they are needed: clusters of 2×2 from a coarse grid on are discarded, kept, or divided in four (Wyman and Nichols 2009,
//! Section 3.2). No grid is ever filled; lists of clusters are divided into batches that fit in memory (Section 4.3).

use glam::{DVec2, Vec3};

use super::caustic_map::CausticMap;
use super::constants::{MAX_CLUSTER_EXTENT, MIN_CLUSTER_COSINE};
use super::coverage::Coverage;
use super::emission::{Emission, Kind, Traced};
use super::ledger::Ledger;
use super::lights::LightView;
use super::options::Traversal;
use super::photons::{Photon, PhotonGrid};
use crate::lanes::LANES;
use crate::parallel;

/// Photons along an edge of the grid that a traversal begins with.
pub const FIRST_GRID: u32 = 64;

/// Clusters may be one photon from grids of this size on.
pub const FIRST_MERGED_GRID: u32 = 512;

/// The photons of a cluster: columns and rows.
const PHOTONS: [[u32; 2]; 4] = [[0, 0], [1, 0], [0, 1], [1, 1]];

/// Clusters that are traced by one packet of rays.
const CLUSTERS_OF_PACKET: usize = LANES / 4;

/// Whether photons of a grid have to be followed: clusters of coarser ones are divided wherever they may show a caster.
pub fn is_followed(traversal: Traversal, grid: u32, finest: u32) -> bool {
    grid >= finest || traversal == Traversal::TexelError && grid >= FIRST_MERGED_GRID
}

/// How much was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Photons that were followed.
    pub evaluations: u64,
    /// Photons that were added to maps.
    pub photons: u64,
}

/// A traversal of a light's view.
pub struct Traverser<'a> {
    /// Rays from the light, and what they meet.
    pub emission: Emission<'a>,
    /// What of the view shows casters.
    pub coverage: &'a Coverage,
    /// The way that counts.
    pub kind: Kind,
    /// Where photons land: the map tells how far they lie from each other.
    pub map: &'a CausticMap<'a>,
    /// When clusters are kept.
    pub traversal: Traversal,
    /// Photons along an edge of the finest grid; a power of two.
    pub finest: u32,
    /// Clusters of a batch at most.
    pub batch: usize,
}

/// What batches add up to, and what is done with their photons.
struct Run<'a> {
    add: &'a mut dyn FnMut(&PhotonGrid),
    ledger: Ledger,
    effort: Effort,
}

/// What a list of clusters became.
#[derive(Default)]
struct Outcome {
    photons: Vec<(Photon, Option<[Vec3; 2]>)>,
    /// To be looked at in a grid that is twice as fine.
    divided: Vec<[u32; 2]>,
    ledger: Ledger,
    effort: Effort,
}

impl Traverser<'_> {
    /// Follows photons from the first grid to the finest one that is needed, and hands them over batch by batch. Returns the account of their
    /// flux, as far as it is not deposited.
    pub fn run(&self, add: &mut dyn FnMut(&PhotonGrid)) -> (Ledger, Effort) {
        let across = FIRST_GRID / 2;
        let all: Vec<[u32; 2]> = (0..across * across).map(|k| [k % across, k / across]).collect();
        let mut run = Run { add, ledger: Ledger::default(), effort: Effort::default() };
        self.run_list(&all, FIRST_GRID.min(self.finest), &mut run);
        (run.ledger, run.effort)
    }

    /// A list of clusters of a grid, in batches: each is followed to its end before the next one.
    fn run_list(&self, clusters: &[[u32; 2]], grid: u32, run: &mut Run<'_>) {
        let view = self.emission.view.resized(grid);
        for batch in clusters.chunks(self.batch.max(1)) {
            let of_packet = |clusters: &[[u32; 2]]| self.packet(&view, clusters);
            let outcomes: Vec<Outcome> = parallel::map_chunks(batch, CLUSTERS_OF_PACKET, &of_packet);
            let mut divided = Vec::new();
            let mut photons = Vec::new();
            for outcome in outcomes {
                run.ledger += outcome.ledger;
                run.effort.evaluations += outcome.effort.evaluations;
                photons.extend(outcome.photons);
                divided.extend(outcome.divided);
            }
            run.effort.photons += photons.len() as u64;
            if !photons.is_empty() {
                (run.add)(&PhotonGrid::scattered(photons));
            }
            if !divided.is_empty() {
                self.run_list(&divided, 2 * grid, run);
            }
        }
    }

    fn packet(&self, view: &LightView, clusters: &[[u32; 2]]) -> Outcome {
        let grid = view.projection.size[0];
        let mut outcome = Outcome::default();
        let covered: Vec<[u32; 2]> =
            clusters.iter().copied().filter(|cluster| self.coverage.has(*cluster, grid / 2)).collect();
        if covered.is_empty() {
            return outcome;
        }
        if !is_followed(self.traversal, grid, self.finest) {
            outcome.divided = covered.iter().flat_map(|cluster| quarters(*cluster)).collect();
            return outcome;
        }
        let texels: [[u32; 2]; LANES] = std::array::from_fn(|lane| {
            let [x, y] = covered[(lane / 4).min(covered.len() - 1)];
            let [dx, dy] = PHOTONS[lane % 4];
            [2 * x + dx, 2 * y + dy]
        });
        let lanes = (1 << (4 * covered.len())) - 1;
        let mut traced = [Traced::default(); LANES];
        let emission = Emission { view, ..self.emission };
        emission.trace(&[self.kind], &texels, lanes, |_, lane, one| traced[lane] = one);
        outcome.effort.evaluations = 4 * covered.len() as u64;
        for (cluster, photons) in covered.iter().zip(traced.as_chunks::<4>().0) {
            self.decide(*cluster, grid, photons, &mut outcome);
        }
        outcome
    }

    /// Divides a cluster or keeps its photons, as four or as one.
    fn decide(&self, cluster: [u32; 2], grid: u32, traced: &[Traced; 4], outcome: &mut Outcome) {
        let photons = traced.each_ref().map(|traced| traced.photon);
        let is_merged =
            self.traversal == Traversal::TexelError && grid >= FIRST_MERGED_GRID && are_one(self.map, &photons);
        if !is_merged && grid < self.finest {
            outcome.divided.extend(quarters(cluster));
            return;
        }
        for traced in traced {
            outcome.ledger += traced.ledger;
        }
        let sides = sides_of(&photons);
        if let (true, [Some(a), Some(b), Some(c), Some(d)]) = (is_merged, photons) {
            // It stands for two texels along each axis.
            let sides = sides.map(|sides| sides.map(|side| 2.0 * side));
            outcome.photons.push((merged(&[a, b, c, d]), sides));
        } else {
            outcome.photons.extend(photons.into_iter().flatten().map(|photon| (photon, sides)));
        }
    }
}

/// Whether four photons land within a texel of a map, on one side of one receiver.
pub fn are_one(map: &CausticMap<'_>, photons: &[Option<Photon>; 4]) -> bool {
    let [Some(a), Some(b), Some(c), Some(d)] = *photons else { return false };
    let all = [a, b, c, d];
    let is_same = |other: &Photon| {
        (other.object, other.caster) == (a.object, a.caster) && other.normal.dot(a.normal) >= MIN_CLUSTER_COSINE
    };
    let places = all.map(|photon| map.project(photon.position));
    let [Some(p), Some(q), Some(r), Some(s)] = places else { return false };
    let places: [DVec2; 4] = [p, q, r, s];
    let is_near = |k: usize, j: usize| places[k].distance(places[j]) <= f64::from(MAX_CLUSTER_EXTENT);
    all.iter().all(is_same) && (0..4).all(|k| (0..k).all(|j| is_near(k, j)))
}

/// The photon that stands for four.
pub fn merged(photons: &[Photon; 4]) -> Photon {
    let position = 0.25 * photons.iter().map(|photon| photon.position).sum::<Vec3>();
    let flux = photons.iter().map(|photon| photon.flux).sum();
    Photon { position, flux, ..photons[0] }
}

/// The clusters that one is divided into.
fn quarters([x, y]: [u32; 2]) -> [[u32; 2]; 4] {
    PHOTONS.map(|[dx, dy]| [2 * x + dx, 2 * y + dy])
}

/// How places on the receiver change from one photon of a cluster to the next, along both axes of the view.
fn sides_of(photons: &[Option<Photon>; 4]) -> Option<[Vec3; 2]> {
    let [a, b, c, d] = photons.map(|photon| photon.map(|photon| photon.position));
    let difference = |from: Option<Vec3>, to: Option<Vec3>| Some(to? - from?);
    let mean = |one: Option<Vec3>, other: Option<Vec3>| match (one, other) {
        (Some(one), Some(other)) => Some(0.5 * (one + other)),
        (one, other) => one.or(other),
    };
    Some([mean(difference(a, b), difference(c, d))?, mean(difference(a, c), difference(b, d))?])
}

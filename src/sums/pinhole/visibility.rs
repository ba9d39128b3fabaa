//! Visibility: each sample traces a small octahedral map of the half-space of its side.
//!
//! A texel holds the plane that its ray hit, or nothing where it reached the environment. The plane tells whether a receiver in
//! that direction is occluded (the leg from the mirror to the receiver; Wand & Straßer, Section 5, propose depth maps); the
//! sky mask, a bit per texel, tells which part of a footprint the environment shines through (the leg from the environment to
//! the mirror). Unlike distances, planes do not shadow the surface that they were taken from.
//!
//! Layout (octahedral): for a direction (x, y, z) in the sample's frame, k = 1/(|x| + |y| + z), u = ½(x + y)k + ½,
//! v = ½(x − y)k + ½. Look-ups: `shaders/shared/visibility.wgsl`, `cpu::visibility`.

use glam::{Vec2, Vec3};

use super::PinholeSample;
use crate::lanes::{ALL, LANES};
use crate::parallel;
use crate::progress::Progress;
use crate::scene::{Scene, Sides};
use crate::tracing::{Hit, Piece, Tracer};

/// The visibility maps of all samples. Texel (i, j) of map k is `k·resolution² + j·resolution + i`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VisibilityMaps {
    /// Texels along an edge.
    pub resolution: u32,
    /// The plane hit by each texel's ray: m with m·l = 1 for its points l, in the sample's frame and relative to the sample,
    /// 1/m; 0 where nothing was hit. The fourth component plus 1 is the m·l up to which a point is not occluded by that surface;
    /// its last 16 bits are two bytes, for the edges towards the next texel along u and along v: six bits for where on the way
    /// what is hit changes, in 64ths, and two, s, for how softly: within 2ˢ/4 of the way.
    pub planes: Vec<[f32; 4]>,
    /// A word for each row of each map: bit i is set where texel i sees the environment. The transition towards the next texel
    /// follows the edges in `planes`.
    pub sky_mask: Vec<u32>,
    /// By texel: where only a ray can tell whether a point is occluded.
    pub doubts: Vec<Doubt>,
}

/// What a sample of a mirror sees, as an octahedral map of the half-space before it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleView {
    /// Texels along the map's edge.
    pub resolution: u32,
    /// Row by row: whether the environment is seen, and not another surface.
    pub sees_environment: Vec<bool>,
}

impl VisibilityMaps {
    /// What the sample sees whose first map has this number, on the side that its normal points to.
    pub fn view(&self, map: u32) -> Option<SampleView> {
        let n = self.resolution as usize;
        let rows = self.sky_mask.get(map as usize * n..)?.get(..n)?;
        let texels = rows.iter().flat_map(|row| (0..n).map(move |i| row >> i & 1 == 1));
        Some(SampleView { resolution: self.resolution, sees_environment: texels.collect() })
    }
}

/// Where the plane of a texel says too little: a curved surface lies partly in front of it, partly behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doubt {
    /// The m·l from which the surface may occlude a point.
    pub from: f32,
    /// The square of the distance from which it may, m²: a curved surface turns away from its plane.
    pub from_distance_2: f32,
    /// The object that was hit; points on it are not in doubt.
    pub object: u32,
}

/// How exactly maps tell where between texels what is hit changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edges {
    /// As exactly as they store it.
    Fine,
    /// Roughly, as rays are traced there.
    Traced,
    /// Roughly, between half as many texels: for previews.
    Coarse,
}

impl Edges {
    /// Bisections of the way between texels that see different things.
    pub fn bisections(self) -> u32 {
        match self {
            Self::Fine => 4,
            Self::Traced | Self::Coarse => 2,
        }
    }

    /// Texels along an edge of a map, at most.
    fn most_texels(self) -> u32 {
        match self {
            Self::Fine | Self::Traced => RESOLUTIONS[0],
            Self::Coarse => 16,
        }
    }
}

/// Texels of all maps together: 128 MiB, which every WebGPU device can bind.
const MAX_TEXELS: usize = 1 << 23;
/// Texels along an edge, from the finest to the coarsest; the finest that fits is used. Multiples of four, as squares of 4×4 texels are
/// traced together.
const RESOLUTIONS: [u32; 5] = [32, 24, 16, 8, 4];

/// The frame of a sample, from its unit normal: two tangents (Duff et al. 2017, *Building an Orthonormal Basis, Revisited*).
pub fn frame(n: Vec3) -> [Vec3; 2] {
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    [Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y)]
}

impl VisibilityMaps {
    /// Traces the maps of all samples and stores in each sample the index of its map. Samples that see something on both sides get two, the
    /// back's second.
    /// `None` if it was cancelled.
    pub fn trace(
        scene: &Scene,
        tracer: &Tracer,
        samples: &mut [PinholeSample],
        edges: Edges,
        progress: &dyn Progress,
    ) -> Option<Self> {
        let Hemispheres { resolution, of_maps } = Hemispheres::number(scene, samples);
        let resolution = resolution.min(edges.most_texels());
        let trace = |hemisphere: &Hemisphere| {
            let is_wanted = !progress.is_cancelled();
            is_wanted.then(|| hemisphere.trace(tracer, resolution, edges))
        };
        let traced = parallel::map(&of_maps, &trace);
        let traced: Vec<TracedMap> = traced.into_iter().collect::<Option<_>>()?;
        let mut maps = Self { resolution, ..Self::default() };
        for TracedMap { planes, sky_mask, doubts } in traced {
            maps.planes.extend(planes);
            maps.sky_mask.extend(sky_mask);
            maps.doubts.extend(doubts);
        }
        Some(maps)
    }
}

/// The hemispheres that the maps of some samples show.
#[derive(Debug)]
pub struct Hemispheres {
    /// Texels along the edge of a map.
    pub resolution: u32,
    /// One for each map.
    pub of_maps: Vec<Hemisphere>,
}

impl Hemispheres {
    /// Numbers the maps of all samples and stores in each sample the number of its first.
    pub fn number(scene: &Scene, samples: &mut [PinholeSample]) -> Self {
        let mut count = 0;
        for sample in samples.iter_mut() {
            sample.set_map(count, texel_jitter(count));
            count += if sample.has_two_maps() { 2 } else { 1 };
        }
        let of_maps = samples.iter().flat_map(|s| Hemisphere::of_sample(scene, s)).collect();
        Self { resolution: resolution_of(count as usize), of_maps }
    }
}

fn resolution_of(maps: usize) -> u32 {
    let fits = |r: &&u32| maps * (**r * **r) as usize <= MAX_TEXELS;
    *RESOLUTIONS.iter().find(fits).unwrap_or(&RESOLUTIONS[RESOLUTIONS.len() - 1])
}

/// Offset of the texels of map k, from −½ to ½ of a texel (Roberts' R2 sequence): it differs from map to map, so that their
/// edges do not line up.
fn texel_jitter(k: u32) -> Vec2 {
    let part = |step: f64| ((f64::from(k) * step).fract() - 0.5) as f32;
    Vec2::new(part(0.754_877_666_246_692_8), part(0.569_840_290_998_053_2))
}

impl Doubt {
    /// Of a texel whose surface lies so far in front of and behind its plane at the texels around it.
    fn new(occluder: Option<&Occluder>, [low, high]: [f32; 2]) -> Self {
        let is_flat = high - low < BEHIND;
        // Rounding adds to m·l; no distance is the same throughout a texel.
        let from_distance_2 = match occluder {
            Some(own) if !is_flat => (1.25 * own.point).length_squared(),
            _ => f32::INFINITY,
        };
        let object = occluder.map_or(u32::MAX, |own| own.object);
        Self { from: 1.0 + 1.2 * BEHIND + low, from_distance_2, object }
    }
}

/// One map; fields as in [`VisibilityMaps`].
struct TracedMap {
    planes: Vec<[f32; 4]>,
    sky_mask: Vec<u32>,
    doubts: Vec<Doubt>,
}

/// The half-space above one side of a sample.
#[derive(Debug)]
pub struct Hemisphere {
    /// The part of the surface from which rays start.
    pub piece: Piece,
    /// The sample's frame; the last axis points to the side in question.
    pub axes: [Vec3; 3],
    /// Shift of the directions within the texels of the map, −½ to ½.
    pub texel_jitter: Vec2,
}

/// Neighbouring texels that see different things.
struct MapEdge {
    from: usize,
    to: usize,
    /// 0 along u, 1 along v.
    axis: usize,
}

/// What a texel's ray hit, in the sample's frame.
struct Occluder {
    point: Vec3,
    normal: Vec3,
    plane: Vec3,
    object: u32,
}

impl Occluder {
    /// How far a smooth surface falls away from its plane at another point, at most, relative to the plane's distance: no more
    /// than its normals turn on the way. Anything further is another part of the surface.
    fn fall_to(&self, other: &Self) -> f32 {
        let turn_2 = (other.normal - self.normal).length_squared();
        // Of most neighbours on flat surfaces.
        if turn_2 == 0.0 {
            return 0.0;
        }
        (self.plane.length_squared() * (other.point - self.point).length_squared() * turn_2).sqrt()
    }
}

impl Hemisphere {
    fn of_sample(scene: &Scene, sample: &PinholeSample) -> Vec<Self> {
        let n = sample.normal();
        let [t, b] = frame(n);
        let of_mesh = scene.objects[sample.object() as usize].reflector.is_none_or(|r| r.sides != Sides::Back);
        let extent = sample.side_1().length().max(sample.side_2().length());
        let side = |back: bool| Self {
            piece: Piece { position: sample.position(), object: sample.object(), front: of_mesh != back, extent },
            axes: [t, b, if back { -n } else { n }],
            texel_jitter: sample.texel_jitter(),
        };
        if sample.has_two_maps() { vec![side(false), side(true)] } else { vec![side(false)] }
    }

    fn trace(&self, tracer: &Tracer, resolution: u32, edges: Edges) -> TracedMap {
        let n = resolution as usize;
        let occluders = self.occluders(tracer, n);
        let edges = self.edges(tracer, (n, edges.bisections()), &occluders);
        let depths: Vec<[f32; 2]> = (0..n * n).map(|k| depths(&occluders, n, k)).collect();
        let plane = |k: usize| {
            let plane = occluders[k].as_ref().map_or(Vec3::ZERO, |m| m.plane);
            plane.extend(with_edges(BEHIND + depths[k][1], edges[k])).to_array()
        };
        let row = |j: usize| (0..n).filter(|i| occluders[j * n + i].is_none()).fold(0, |bits, i| bits | 1 << i);
        let doubt = |k: usize| Doubt::new(occluders[k].as_ref(), depths[k]);
        TracedMap {
            planes: (0..n * n).map(plane).collect(),
            sky_mask: (0..n).map(row).collect(),
            doubts: (0..n * n).map(doubt).collect(),
        }
    }

    /// Centre of texel k on the map.
    fn place(&self, n: usize, k: usize) -> Vec2 {
        (Vec2::new((k % n) as f32, (k / n) as f32) + 0.5 + self.texel_jitter) / n as f32
    }

    /// What the texels see, row by row; squares of four by four are traced together.
    fn occluders(&self, tracer: &Tracer, n: usize) -> Vec<Option<Occluder>> {
        let mut occluders: Vec<Option<Occluder>> = (0..n * n).map(|_| None).collect();
        for square in 0..n * n / LANES {
            let (x, y) = (4 * (square % (n / 4)), 4 * (square / (n / 4)));
            let texels: [usize; LANES] = std::array::from_fn(|lane| (y + lane / 4) * n + x + lane % 4);
            let found = self.at_places(tracer, &texels.map(|k| self.place(n, k)), ALL);
            texels.into_iter().zip(found).for_each(|(k, found)| occluders[k] = found);
        }
        occluders
    }

    /// What is hit in the directions of sixteen places on the map, in the lanes asked for.
    fn at_places(&self, tracer: &Tracer, places: &[Vec2; LANES], lanes: u32) -> [Option<Occluder>; LANES] {
        let directions = places.map(|place| {
            let [x, y, z] = direction(place).to_array();
            x * self.axes[0] + y * self.axes[1] + z * self.axes[2]
        });
        tracer.seen_by(&self.piece, &directions, lanes).map(|hit| hit.map(|hit| self.at_hit(&hit)))
    }

    /// Where between each texel and the next along u and along v what is hit changes, and how softly.
    fn edges(&self, tracer: &Tracer, (n, bisections): (usize, u32), occluders: &[Option<Occluder>]) -> Vec<[u8; 2]> {
        let mut edges = vec![[MIDDLE; 2]; n * n];
        let mut differing = Vec::new();
        for from in 0..n * n {
            for (axis, is_last, to) in [(0, from % n + 1 == n, from + 1), (1, from / n + 1 == n, from + n)] {
                if !is_last && !same_surface(occluders[from].as_ref(), occluders[to].as_ref()) {
                    differing.push(MapEdge { from, to, axis });
                }
            }
        }
        for group in differing.chunks(LANES) {
            let places = self.bisect(tracer, (n, bisections), occluders, group);
            for (edge, place) in group.iter().zip(places) {
                let softness = self.softness(n, occluders[edge.from].as_ref(), occluders[edge.to].as_ref());
                edges[edge.from][edge.axis] = ((64.0 * place) as u8) << 2 | softness;
            }
        }
        edges
    }

    /// The part of the way between the texels of up to sixteen edges at which what is hit changes.
    fn bisect(
        &self,
        tracer: &Tracer,
        (n, bisections): (usize, u32),
        occluders: &[Option<Occluder>],
        edges: &[MapEdge],
    ) -> [f32; LANES] {
        let lanes = ALL >> (LANES - edges.len());
        let edge = |lane: usize| &edges[lane.min(edges.len() - 1)];
        let (mut low, mut high) = ([0.0; LANES], [1.0; LANES]);
        for _ in 0..bisections {
            let middle: [f32; LANES] = std::array::from_fn(|lane| 0.5 * (low[lane] + high[lane]));
            let places = std::array::from_fn(|lane| {
                self.place(n, edge(lane).from).lerp(self.place(n, edge(lane).to), middle[lane])
            });
            for (lane, there) in self.at_places(tracer, &places, lanes).iter().enumerate().take(edges.len()) {
                let [from, to] =
                    [edge(lane).from, edge(lane).to].map(|k| mismatch(occluders[k].as_ref(), there.as_ref()));
                if from <= to { low[lane] = middle[lane] } else { high[lane] = middle[lane] }
            }
        }
        std::array::from_fn(|lane| 0.5 * (low[lane] + high[lane]))
    }

    /// The width of a penumbra: an edge shifts against what is behind it when seen from end to end of the sample.
    fn softness(&self, n: usize, from: Option<&Occluder>, to: Option<&Occluder>) -> u8 {
        let nearness = |occluder: Option<&Occluder>| occluder.map_or(0.0, |m| m.point.length_recip());
        let angle = self.piece.extent * (nearness(from) - nearness(to)).abs();
        // A half-space has 2π sr.
        let texel = std::f32::consts::TAU.sqrt() / n as f32;
        (4.0 * angle / texel).max(1.0).log2().round().min(2.0) as u8
    }

    fn at_hit(&self, hit: &Hit) -> Occluder {
        let local = |v: Vec3| Vec3::from(self.axes.map(|axis| axis.dot(v)));
        let (point, normal) = (local(hit.position - self.piece.position), local(hit.face_normal));
        // At grazing angles the plane almost passes through the sample and would occlude nothing beyond the point.
        let distance = point.dot(normal).min(-MIN_OCCLUDER_COSINE * point.length());
        Occluder { point, normal, plane: normal / distance, object: hit.object }
    }
}

/// Planes hit at a smaller cosine are tilted to this one.
pub const MIN_OCCLUDER_COSINE: f32 = 1e-3;

/// A receiver is occluded if it lies behind the plane by more than this fraction of the distance.
pub const BEHIND: f32 = 0.001;
/// An edge halfway, as soft as can be: plain linear interpolation.
pub const MIDDLE: u8 = 32 << 2 | 2;

/// Stores edges in the last bits of a number that needs few of them.
fn with_edges(value: f32, [u, v]: [u8; 2]) -> f32 {
    f32::from_bits(value.to_bits() & 0xffff_0000 | u32::from(u) << 8 | u32::from(v))
}

/// Whether two texels see one smooth surface, or both the environment.
fn same_surface(a: Option<&Occluder>, b: Option<&Occluder>) -> bool {
    match (a, b) {
        (None, None) => true,
        (Some(a), Some(b)) => {
            let on_plane = |a: &Occluder, b: &Occluder| (a.plane.dot(b.point) - 1.0).abs() <= a.fall_to(b) + BEHIND;
            a.object == b.object && on_plane(a, b) && on_plane(b, a)
        }
        _ => false,
    }
}

/// Distance of a hit from the surface that a texel sees, relative to the plane's distance.
fn mismatch(texel: Option<&Occluder>, hit: Option<&Occluder>) -> f32 {
    match (texel, hit) {
        (None, None) => 0.0,
        (Some(texel), Some(hit)) => (texel.plane.dot(hit.point) - 1.0).abs(),
        _ => f32::INFINITY,
    }
}

/// How far the same surface lies in front of (negative) and behind texel k's plane at the neighbouring texels, relative to the
/// plane's distance.
fn depths(occluders: &[Option<Occluder>], n: usize, k: usize) -> [f32; 2] {
    let Some(own) = &occluders[k] else { return [0.0; 2] };
    let (i, j) = (k % n, k / n);
    let near = |c: usize| c.saturating_sub(1)..=(c + 1).min(n - 1);
    let neighbours =
        near(j).flat_map(|y| near(i).map(move |x| y * n + x)).filter_map(|other| occluders[other].as_ref());
    let depth = |other: &Occluder| {
        let depth = own.plane.dot(other.point) - 1.0;
        if other.object == own.object && depth.abs() <= own.fall_to(other) { depth } else { 0.0 }
    };
    neighbours.map(depth).fold([0.0; 2], |[low, high], depth| [low.min(depth), high.max(depth)])
}

/// The direction of a place on a map, both coordinates from 0 to 1; never quite at the horizon.
fn direction(place: Vec2) -> Vec3 {
    let [a, b] = place.clamp(Vec2::splat(0.002), Vec2::splat(0.998)).to_array().map(|c| 2.0 * c - 1.0);
    let (x, y) = (0.5 * (a + b), 0.5 * (a - b));
    Vec3::new(x, y, (1.0 - x.abs() - y.abs()).max(1e-4)).normalize()
}

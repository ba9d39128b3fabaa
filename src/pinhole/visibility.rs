//! What each sample sees around itself: a small map over the half-space of its side, traced by rays.
//!
//! A texel holds the plane of what its ray met, or nothing where that is the environment. The plane says whether a receiver in
//! that direction is hidden (the leg from the mirror to the receiver; Wand & Straßer, Section 5, propose depth maps); the
//! bits of all texels say what part of a footprint the environment shines through (the leg from the environment to the
//! mirror). Planes, unlike distances, do not shadow the surface that they were taken from.
//!
//! Layout (octahedral): for a direction (x, y, z) in the sample's frame, k = 1/(|x| + |y| + z), u = ½(x + y)k + ½,
//! v = ½(x − y)k + ½. Look-ups: `shaders/shared/visibility.wgsl`, `cpu::visibility`.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::PinholeSample;
use crate::scene::{Scene, Sides};
use crate::tracing::{Hit, Piece, Tracer};

/// What the samples see. Map k's texel (i, j) is `k·resolution² + j·resolution + i`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VisibilityMaps {
    /// Texels along an edge.
    pub resolution: u32,
    /// m with m·l = 1 for points l of the plane met, in the sample's frame from the sample on, 1/m, or 0 where nothing was
    /// met. The fourth is 1 less than the m·l up to which a point is no longer hidden by that surface; its last 16 bits are
    /// two numbers of 8, for the way to the next texel along u and along v: six bits say where on it, in 64ths, what is
    /// met changes, and two, s, how softly: within 2ˢ/4 of the way.
    pub planes: Vec<[f32; 4]>,
    /// A word for each row of each map: bit i is set where texel i sees the environment. Where on the way to the next texel that
    /// changes the planes' bits say, too.
    pub open: Vec<u32>,
}

/// Maps of more than this many texels in all (128 MiB, what every WebGPU device binds) are made coarser.
const MOST_TEXELS: usize = 1 << 23;
/// Texels along an edge: from the finest to the coarsest.
const RESOLUTIONS: [u32; 5] = [32, 24, 16, 8, 4];

/// The frame of a sample, from its unit normal: two tangents (Duff et al. 2017, *Building an Orthonormal Basis, Revisited*).
pub(super) fn frame(n: Vec3) -> [Vec3; 2] {
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    [Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y)]
}

impl VisibilityMaps {
    /// Lets every sample look around and notes in it which map is its own. Two-sided samples get two, the back's second.
    pub fn trace(scene: &Scene, tracer: &Tracer, samples: &mut [PinholeSample]) -> Self {
        let mut count = 0;
        for sample in samples.iter_mut() {
            sample.set_map(count, phase(count));
            count += if sample.two_sided() { 2 } else { 1 };
        }
        let resolution = resolution_of(count as usize);
        let views: Vec<View> = samples.iter().flat_map(|s| View::of_sample(scene, s)).collect();
        let traced: Vec<(Vec<[f32; 4]>, Vec<u32>)> = views.par_iter().map(|v| v.trace(tracer, resolution)).collect();
        let mut maps = Self { resolution, ..Self::default() };
        for (planes, open) in traced {
            maps.planes.extend(planes);
            maps.open.extend(open);
        }
        maps
    }
}

fn resolution_of(maps: usize) -> u32 {
    let fits = |r: &&u32| maps * (**r * **r) as usize <= MOST_TEXELS;
    *RESOLUTIONS.iter().find(fits).unwrap_or(&RESOLUTIONS[RESOLUTIONS.len() - 1])
}

/// Where the texels of map k lie, from −½ to ½ of a texel: each map's elsewhere (Roberts' R2 sequence), so that their edges
/// do not line up.
fn phase(k: u32) -> Vec2 {
    let part = |step: f64| ((f64::from(k) * step).fract() - 0.5) as f32;
    Vec2::new(part(0.754_877_666_246_692_8), part(0.569_840_290_998_053_2))
}

/// One side of a sample.
struct View {
    piece: Piece,
    axes: [Vec3; 3],
    phase: Vec2,
}

/// What a texel's ray met, in the frame.
struct Met {
    point: Vec3,
    normal: Vec3,
    plane: Vec3,
    object: u32,
}

impl Met {
    /// A smooth surface falls away by no more than its normals turn on the way, here relative to the plane's distance;
    /// anything further is another part of it.
    fn fall_to(&self, other: &Self) -> f32 {
        self.plane.length() * (other.point - self.point).length() * (other.normal - self.normal).length()
    }
}

impl View {
    fn of_sample(scene: &Scene, sample: &PinholeSample) -> Vec<Self> {
        let n = sample.normal();
        let [t, b] = frame(n);
        let of_mesh = scene.objects[sample.object() as usize].reflector.is_none_or(|r| r.sides != Sides::Back);
        let extent = sample.side_1().length().max(sample.side_2().length());
        let view = |back: bool| Self {
            piece: Piece { position: sample.position(), object: sample.object(), front: of_mesh != back, extent },
            axes: [t, b, if back { -n } else { n }],
            phase: sample.texel_jitter(),
        };
        if sample.two_sided() { vec![view(false), view(true)] } else { vec![view(false)] }
    }

    fn trace(&self, tracer: &Tracer, resolution: u32) -> (Vec<[f32; 4]>, Vec<u32>) {
        let n = resolution as usize;
        let met: Vec<Option<Met>> = (0..n * n).map(|k| self.look(tracer, self.place(n, k))).collect();
        let plane = |k: usize| {
            let plane = met[k].as_ref().map_or(Vec3::ZERO, |m| m.plane);
            let edges = [(1, k % n + 1 < n), (n, k / n + 1 < n)]
                .map(|(step, inside)| if inside { self.edge(tracer, n, &met, k, k + step) } else { MIDDLE });
            plane.extend(with_edges(BEHIND + tolerance(&met, n, k), edges)).to_array()
        };
        let row = |j: usize| (0..n).filter(|i| met[j * n + i].is_none()).fold(0, |bits, i| bits | 1 << i);
        ((0..n * n).map(plane).collect(), (0..n).map(row).collect())
    }

    /// Where texel k lies on the map.
    fn place(&self, n: usize, k: usize) -> Vec2 {
        (Vec2::new((k % n) as f32, (k / n) as f32) + 0.5 + self.phase) / n as f32
    }

    fn look(&self, tracer: &Tracer, place: Vec2) -> Option<Met> {
        let [x, y, z] = direction(place).to_array();
        let hit = tracer.seen_by(&self.piece, x * self.axes[0] + y * self.axes[1] + z * self.axes[2])?;
        Some(self.met(&hit))
    }

    /// Where between two texels what is met changes, found by halving, and how softly.
    fn edge(&self, tracer: &Tracer, n: usize, met: &[Option<Met>], from: usize, to: usize) -> u8 {
        if same_surface(met[from].as_ref(), met[to].as_ref()) {
            return MIDDLE;
        }
        let (start, end) = (self.place(n, from), self.place(n, to));
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let there = self.look(tracer, start.lerp(end, middle));
            let is_first = unlike(met[from].as_ref(), there.as_ref()) <= unlike(met[to].as_ref(), there.as_ref());
            if is_first { low = middle } else { high = middle }
        }
        let place = (32.0 * (low + high)) as u8;
        place << 2 | self.softness(n, met[from].as_ref(), met[to].as_ref())
    }

    /// Seen from end to end of the piece an edge moves before what is behind it: that is how wide its shadow's edge is.
    fn softness(&self, n: usize, from: Option<&Met>, to: Option<&Met>) -> u8 {
        let nearness = |met: Option<&Met>| met.map_or(0.0, |m| m.point.length_recip());
        let angle = self.piece.extent * (nearness(from) - nearness(to)).abs();
        // A half-space has 2π sr.
        let texel = std::f32::consts::TAU.sqrt() / n as f32;
        (4.0 * angle / texel).max(1.0).log2().round().min(2.0) as u8
    }

    fn met(&self, hit: &Hit) -> Met {
        let local = |v: Vec3| Vec3::from(self.axes.map(|axis| axis.dot(v)));
        let (point, normal) = (local(hit.position - self.piece.position), local(hit.face_normal));
        // Grazing: the plane is as good as through the sample, and hides nothing beyond the point.
        let distance = point.dot(normal).min(-LEAST_COSINE * point.length());
        Met { point, normal, plane: normal / distance, object: hit.object }
    }
}

/// Planes met at a smaller cosine than this are turned to it.
const LEAST_COSINE: f32 = 1e-3;

/// A receiver is hidden if it lies behind what was met by more than this part of the distance.
const BEHIND: f32 = 0.001;
/// Halvings of the way between texels that see different things.
const HALVINGS: u32 = 4;
/// Halfway, and all the way: plain interpolation.
const MIDDLE: u8 = 32 << 2 | 2;

/// Notes where the edges are in the bits of a number that needs few of them.
fn with_edges(value: f32, [u, v]: [u8; 2]) -> f32 {
    f32::from_bits(value.to_bits() & 0xffff_0000 | u32::from(u) << 8 | u32::from(v))
}

/// Whether two texels see one smooth surface, or both the environment.
fn same_surface(a: Option<&Met>, b: Option<&Met>) -> bool {
    match (a, b) {
        (None, None) => true,
        (Some(a), Some(b)) => {
            let on_plane = |a: &Met, b: &Met| (a.plane.dot(b.point) - 1.0).abs() <= a.fall_to(b) + BEHIND;
            a.object == b.object && on_plane(a, b) && on_plane(b, a)
        }
        _ => false,
    }
}

/// How little what was met somewhere is like what a texel sees.
fn unlike(texel: Option<&Met>, there: Option<&Met>) -> f32 {
    match (texel, there) {
        (None, None) => 0.0,
        (Some(texel), Some(there)) => (texel.plane.dot(there.point) - 1.0).abs(),
        _ => f32::INFINITY,
    }
}

/// How far behind texel k's plane the same surface lies at the neighbouring texels, relative to the plane's distance.
fn tolerance(met: &[Option<Met>], n: usize, k: usize) -> f32 {
    let Some(own) = &met[k] else { return 0.0 };
    let (i, j) = (k % n, k / n);
    let near = |c: usize| c.saturating_sub(1)..=(c + 1).min(n - 1);
    let neighbours = near(j).flat_map(|y| near(i).map(move |x| y * n + x)).filter_map(|other| met[other].as_ref());
    let behind = |other: &Met| {
        let part = own.plane.dot(other.point) - 1.0;
        if other.object == own.object && part <= own.fall_to(other) { part } else { 0.0 }
    };
    neighbours.map(behind).fold(0.0, f32::max)
}

/// The direction of a place on a map, both coordinates from 0 to 1; never quite at the horizon.
fn direction(place: Vec2) -> Vec3 {
    let [a, b] = place.clamp(Vec2::splat(0.002), Vec2::splat(0.998)).to_array().map(|c| 2.0 * c - 1.0);
    let (x, y) = (0.5 * (a + b), 0.5 * (a - b));
    Vec3::new(x, y, (1.0 - x.abs() - y.abs()).max(1e-4)).normalize()
}

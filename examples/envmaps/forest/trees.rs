//! Trunks and branches: leaning, tapering stems on a jittered grid.

use glam::{IVec3, Vec3};

use super::{EYE, Hit, SUN_TOWARDS, forward_scatter};
use crate::noise::{fbm, gradient, random, random3, smoothstep};

/// Distance between neighbouring trees, metres.
const SPACING: f32 = 3.3;
/// Height of a trunk's top above the floor.
const TOP: f32 = 26.0;
/// Rows of trees on each side of the viewer.
const RINGS: i32 = 14;
const BRANCHES: i32 = 9;
/// Branches of farther trees are hidden by leaves anyway.
const BRANCH_REACH: f32 = 17.0;
const SEED: u32 = 300;

pub struct Tree {
    foot: Vec3,
    lean: Vec3,
    radius: f32,
    distance: f32,
    branches: Vec<Branch>,
}

struct Branch {
    root: Vec3,
    span: Vec3,
    radius: f32,
}

/// All trees, near to far.
pub fn grow() -> Vec<Tree> {
    let side = 2 * RINGS + 1;
    let cells = (0..side * side).map(|k| IVec3::new(k % side - RINGS, 0, k / side - RINGS));
    let mut trees: Vec<Tree> = cells.filter_map(Tree::of).collect();
    trees.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    trees
}

/// The nearest trunk or branch in `direction`.
pub fn meet(trees: &[Tree], direction: Vec3) -> Option<Hit> {
    let mut nearest: Option<Hit> = None;
    for tree in trees {
        let best = nearest.as_ref().map_or(f32::INFINITY, |hit| hit.distance);
        if tree.distance - 4.0 > best {
            break;
        }
        let trunk = tree.meet_trunk(direction);
        let branches = tree.branches.iter().map(|b| b.meet(direction));
        let hits = branches.chain([trunk]).flatten();
        nearest = hits.chain(nearest).reduce(|a, b| if a.distance < b.distance { a } else { b });
    }
    nearest
}

/// How much of the sky the feet of near trees hide from a place on the floor.
pub fn open_around(trees: &[Tree], place: Vec3) -> f32 {
    let near = trees.iter().take(60);
    near.map(|tree| {
        let gap = (place - tree.foot).length() / tree.radius;
        smoothstep(0.8, 4.5, gap)
    })
    .product()
}

impl Tree {
    fn of(cell: IVec3) -> Option<Self> {
        let pick = random3(cell, SEED);
        let jitter = (random3(cell, SEED + 1) - 0.5) * 2.6;
        let level = cell.as_vec3() * SPACING + Vec3::new(jitter.x, 0.0, jitter.z);
        let distance = level.length();
        if pick.x > 0.62 || distance < 3.4 {
            return None;
        }
        let mut tree = Self {
            foot: level - Vec3::Y * EYE,
            lean: (random3(cell, SEED + 2) - 0.5) * Vec3::new(0.10, 0.0, 0.10),
            radius: 0.09 + 0.24 * pick.y * pick.y,
            distance,
            branches: Vec::new(),
        };
        if distance < BRANCH_REACH {
            let order = 0..BRANCHES;
            tree.branches = order.map(|k| tree.branch(cell + IVec3::Y * k)).collect();
        }
        Some(tree)
    }

    fn branch(&self, key: IVec3) -> Branch {
        let pick = random3(key, SEED + 3);
        let height = 3.0 + 11.0 * pick.x;
        let (sin, cos) = (pick.y * std::f32::consts::TAU).sin_cos();
        let length = 1.2 + 2.6 * random(key, SEED + 4);
        Branch {
            root: self.centre(height),
            span: Vec3::new(cos, 0.25 + 0.7 * pick.z, sin) * length,
            radius: self.radius * taper(height) * 0.42,
        }
    }

    /// The middle of the trunk at a height above the floor.
    fn centre(&self, height: f32) -> Vec3 {
        self.foot + (self.lean + Vec3::Y) * height
    }

    fn meet_trunk(&self, direction: Vec3) -> Option<Hit> {
        let level = direction.x.hypot(direction.z);
        if direction.dot(self.foot - Vec3::Y * self.foot.y) <= 0.0 {
            return None;
        }
        // The trunk's lean is small: its place at about the right height will do.
        let height = (EYE + self.distance * direction.y / level).clamp(0.0, TOP);
        let centre = self.centre(height);
        let sideways = (centre.x * direction.z - centre.z * direction.x) / level;
        let flare = 1.0 + 0.7 * (-height / 0.22).exp();
        let even = self.radius * taper(height) * flare;
        if sideways.abs() > 1.2 * even || height >= TOP {
            return None;
        }
        let wobble = 1.0 + 0.10 * gradient(Vec3::new(self.foot.x, height * 0.9, sideways), 91);
        let radius = even * wobble;
        if sideways.abs() > radius {
            return None;
        }
        let ahead = (centre.x * direction.x + centre.z * direction.z) / level;
        let depth = (radius * radius - sideways * sideways).sqrt();
        let distance = (ahead - depth) / level;
        let place = direction * distance;
        let normal = (place - centre) * Vec3::new(1.0, 0.0, 1.0);
        Some(Hit { distance, radiance: bark(place, normal.normalize_or(-direction), direction) })
    }
}

/// Share of its foot's radius that a trunk has at a height.
fn taper(height: f32) -> f32 {
    1.0 - 0.033 * height
}

impl Branch {
    /// Closest approach of the ray to the branch's axis.
    fn meet(&self, direction: Vec3) -> Option<Hit> {
        let along = direction.dot(self.span);
        let squared = self.span.length_squared();
        let flat = squared - along * along;
        let part = along * direction.dot(self.root) - self.span.dot(self.root);
        let t = (part / flat.max(1e-6)).clamp(0.0, 1.0);
        // A slight sag makes the axis a curve.
        let axis = self.root + self.span * t - Vec3::Y * (0.3 * t * (1.0 - t));
        let distance = direction.dot(axis);
        let radius = self.radius * (1.0 - 0.85 * t);
        let gap = axis - direction * distance;
        if distance < 0.5 || gap.length_squared() > radius * radius {
            return None;
        }
        Some(Hit { distance, radiance: bark(direction * distance, -gap / radius, direction) * 0.6 })
    }
}

/// Bark in shade, with moss at the foot, flecks of sun on the sunny side, and
/// a bright rim against the sun.
fn bark(place: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let height = place.y + EYE;
    let grain = fbm(place * Vec3::new(9.0, 1.6, 9.0), 3, 92);
    let wood = Vec3::new(0.115, 0.088, 0.062) * (1.0 + 0.7 * grain);
    let moss = Vec3::new(0.07, 0.10, 0.025);
    let mossy = smoothstep(0.1, 0.5, gradient(place * 1.1, 93) + 0.5 * (-height / 1.2).exp());
    let albedo = wood.lerp(moss, 0.75 * mossy);
    let fleck = smoothstep(0.12, 0.3, fbm(place * 1.3, 3, 94));
    let sunny = normal.dot(SUN_TOWARDS).max(0.0);
    let ambient = 0.45 + 0.10 * (height / 4.0).min(2.5);
    let edge = (1.0 + normal.dot(direction)).clamp(0.0, 1.0).powi(3);
    let rim = 9.0 * edge * forward_scatter(direction) * sunny;
    albedo * (Vec3::new(0.85, 1.0, 0.75) * ambient + Vec3::new(1.0, 0.9, 0.7) * (13.0 * fleck * sunny + rim))
}

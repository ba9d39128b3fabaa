//! Power spectra of point sets on surfaces with an isometric parameterization over a rectangle (Ulichney 1987; Lagae & Dutré 2008): the radially
//! averaged power, and how much it differs between directions.

use glam::{DVec2, DVec3};

use super::{Surface, SurfacePoint};
use crate::parallel;

/// An isometric parameterization of a surface over a rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameterization {
    /// A rectangle: a corner and the unit directions of its edges.
    Plane {
        /// Corner.
        origin: DVec3,
        /// Unit directions of the edges.
        edges: [DVec3; 2],
        /// Lengths of the edges, m.
        size: DVec2,
    },
    /// A whole circular cylinder: a point of its axis at one end, and the axis.
    Cylinder {
        /// The axis' end.
        origin: DVec3,
        /// Unit axis.
        axis: DVec3,
        /// Radius, m.
        radius: f64,
        /// Length, m.
        height: f64,
    },
    /// A torus about +Y at the origin; only nearly isometric: areas are kept, lengths differ by up to tube/radius.
    Torus {
        /// Radius of the circle inside the tube, m.
        radius: f64,
        /// Radius of the tube, m.
        tube: f64,
    },
}

impl Parameterization {
    /// Recognises a flat rectangle and a whole cylinder.
    pub fn of(surface: &Surface) -> Option<Self> {
        plane(surface).or_else(|| cylinder(surface))
    }

    /// The rectangle's size, m.
    pub fn size(&self) -> DVec2 {
        match *self {
            Self::Plane { size, .. } => size,
            Self::Cylinder { radius, height, .. } => DVec2::new(std::f64::consts::TAU * radius, height),
            Self::Torus { radius, tube } => std::f64::consts::TAU * DVec2::new(radius, tube),
        }
    }

    /// The place of a point of the surface on the rectangle, m.
    pub fn place_of(&self, point: DVec3) -> DVec2 {
        match *self {
            Self::Plane { origin, edges, .. } => {
                DVec2::new((point - origin).dot(edges[0]), (point - origin).dot(edges[1]))
            }
            Self::Cylinder { origin, axis, radius, .. } => {
                let (u, v) = axis.any_orthonormal_pair();
                let d = point - origin;
                DVec2::new(radius * d.dot(v).atan2(d.dot(u)), d.dot(axis))
            }
            Self::Torus { radius, tube } => {
                let around = point.z.atan2(point.x);
                let along = point.y.atan2(point.x.hypot(point.z) - radius);
                // The area up to an angle of the tube goes with angle + (tube/radius)·sin.
                DVec2::new(radius * around, tube * (along + tube / radius * along.sin()))
            }
        }
    }
}

fn corners(surface: &Surface) -> impl Iterator<Item = (DVec3, DVec3)> {
    surface.triangles().iter().flat_map(|t| (0..3).map(|k| (t.corners[k].as_dvec3(), t.normals[k].as_dvec3())))
}

fn plane(surface: &Surface) -> Option<Parameterization> {
    let (_, normal) = corners(surface).next()?;
    if !corners(surface).all(|(_, n)| n.dot(normal) > 1.0 - 1e-6) {
        return None;
    }
    // Some edge of some triangle runs along the rectangle.
    let edges =
        surface.triangles().iter().flat_map(|t| (0..3).map(|k| (t.corners[(k + 1) % 3] - t.corners[k]).as_dvec3()));
    edges.take(3).find_map(|edge| {
        let edges = [edge.normalize(), normal.cross(edge).normalize()];
        let place = |p: DVec3| DVec2::new(p.dot(edges[0]), p.dot(edges[1]));
        let (low, high) = corners(surface).fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), (p, _)| {
            (low.min(place(p)), high.max(place(p)))
        });
        let size = high - low;
        let height = corners(surface).next().map_or(0.0, |(p, _)| p.dot(normal));
        let origin = low.x * edges[0] + low.y * edges[1] + height * normal;
        ((size.x * size.y / surface.area() - 1.0).abs() < 1e-3).then_some(Parameterization::Plane {
            origin,
            edges,
            size,
        })
    })
}

fn cylinder(surface: &Surface) -> Option<Parameterization> {
    let (p0, n0) = corners(surface).next()?;
    let (p1, n1) = corners(surface).max_by(|a, b| n0.cross(a.1).length().total_cmp(&n0.cross(b.1).length()))?;
    let axis = n0.cross(n1).try_normalize()?;
    let across = |p: DVec3| p - axis * p.dot(axis);
    // Points on one circle differ as their normals do, times the radius (negative where normals point inwards).
    let signed = (across(p1) - across(p0)).dot(n1 - n0) / (n1 - n0).length_squared();
    let centre = across(p0) - signed * n0;
    let radius = signed.abs();
    let fits =
        |(p, n): (DVec3, DVec3)| n.dot(axis).abs() < 1e-3 && (across(p) - centre - signed * n).length() < 1e-3 * radius;
    let (low, high) = corners(surface)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (p, _)| (l.min(p.dot(axis)), h.max(p.dot(axis))));
    let whole = (std::f64::consts::TAU * radius * (high - low) / surface.area() - 1.0).abs() < 1e-2;
    let found = Parameterization::Cylinder { origin: centre + low * axis, axis, radius, height: high - low };
    (whole && corners(surface).all(fits)).then_some(found)
}

/// The mean power spectrum of several point sets. Frequencies are in units of √(N/A): 1 is that of a square grid.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Spectrum {
    /// (frequency, power averaged over directions); 1 is the power of white noise.
    pub radial: Vec<[f64; 2]>,
    /// (frequency, variance between directions over the squared mean, dB). An isotropic pattern has −10 dB for ten sets.
    pub anisotropy: Vec<[f64; 2]>,
    /// Mean power below half the frequency of the radial peak: 0 is the best blue noise.
    pub low_power: f64,
    /// Anisotropy over all frequencies, weighted by power, dB.
    pub anisotropy_db: f64,
    /// The spectrum itself, `2·half + 1` on each axis, frequency 0 in the middle (and set to 0).
    #[serde(skip)]
    pub power: Vec<f64>,
    /// Frequencies on either side of 0, across and upwards.
    #[serde(skip)]
    pub half: [usize; 2],
}

/// How far the spectrum reaches.
const HIGHEST: f64 = 2.5;

impl Spectrum {
    /// Analyses sets of about equal size on one surface.
    pub fn of(sets: &[Vec<SurfacePoint>], parameterization: &Parameterization) -> Self {
        let size = parameterization.size();
        let count = sets.iter().map(Vec::len).sum::<usize>() as f64 / sets.len() as f64;
        let unit = (count / (size.x * size.y)).sqrt();
        // Whole waves on the rectangle, so that its outline has no power of its own.
        let half = [size.x, size.y].map(|s| (HIGHEST * unit * s).floor() as usize);
        let spectra: Vec<Vec<f64>> = parallel::map(sets, &|set| {
            let points = set.iter().map(|p| parameterization.place_of(p.position.as_dvec3()) / size);
            periodogram(&points.collect::<Vec<_>>(), half)
        });
        let power: Vec<f64> =
            (0..spectra[0].len()).map(|k| spectra.iter().map(|s| s[k]).sum::<f64>() / sets.len() as f64).collect();
        let frequency = |k: usize| {
            let (i, j) = (k % (2 * half[0] + 1), k / (2 * half[0] + 1));
            let f = DVec2::new(i as f64 - half[0] as f64, j as f64 - half[1] as f64) / size;
            f.length() / unit
        };
        Self::averaged(power, half, frequency, count)
    }

    fn averaged(power: Vec<f64>, half: [usize; 2], frequency: impl Fn(usize) -> f64, count: f64) -> Self {
        // Rings one wave of the (square) rectangle wide.
        let width = 1.0 / count.sqrt();
        let rings = (HIGHEST / width) as usize;
        let (mut n, mut sum, mut squares) = (vec![0.0; rings], vec![0.0; rings], vec![0.0; rings]);
        for (k, p) in power.iter().enumerate() {
            let ring = (frequency(k) / width) as usize;
            // Ring 0 holds frequency 0.
            if (1..rings).contains(&ring) {
                n[ring] += 1.0;
                sum[ring] += p;
                squares[ring] += p * p;
            }
        }
        let at = |ring: usize| (ring as f64 + 0.5) * width;
        let mean = |ring: usize| sum[ring] / n[ring];
        let variance = |ring: usize| (squares[ring] - sum[ring] * mean(ring)) / (n[ring] - 1.0);
        let used: Vec<usize> = (1..rings).filter(|ring| n[*ring] > 3.0).collect();
        let radial: Vec<[f64; 2]> = used.iter().map(|r| [at(*r), mean(*r)]).collect();
        let dented = used.iter().filter(|r| mean(**r) > 1e-9);
        let anisotropy = dented.map(|r| [at(*r), 10.0 * (variance(*r) / mean(*r).powi(2)).log10()]).collect();
        let peak = radial.iter().copied().max_by(|a, b| a[1].total_cmp(&b[1])).map_or(1.0, |p| p[0]);
        let low: Vec<usize> = used.iter().copied().filter(|r| at(*r) < 0.5 * peak).collect();
        let low_power = low.iter().map(|r| sum[*r]).sum::<f64>() / low.iter().map(|r| n[*r]).sum::<f64>().max(1.0);
        let total = |f: &dyn Fn(usize) -> f64| used.iter().map(|r| n[*r] * f(*r)).sum::<f64>();
        let anisotropy_db = 10.0 * (total(&variance) / total(&|r| mean(r).powi(2))).log10();
        Self { radial, anisotropy, low_power, anisotropy_db, power, half }
    }
}

/// |Σ exp(−2πi k·x)|² / N for all whole k within `half` on either side, for points in units of the rectangle.
fn periodogram(points: &[DVec2], half: [usize; 2]) -> Vec<f64> {
    let [across, down] = half.map(|h| 2 * h + 1);
    let mut sums = vec![DVec2::ZERO; across * down];
    let times = |a: DVec2, b: DVec2| DVec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
    let turn = |angle: f64| DVec2::from_angle(-std::f64::consts::TAU * angle);
    for point in points {
        let row: Vec<DVec2> = (0..across).map(|i| turn((i as f64 - half[0] as f64) * point.x)).collect();
        // The spectrum of real weights is symmetric: one half is enough.
        for j in 0..=half[1] {
            let column = turn((j as f64 - half[1] as f64) * point.y);
            for (sum, wave) in sums[j * across..(j + 1) * across].iter_mut().zip(&row) {
                *sum += times(*wave, column);
            }
        }
    }
    let mut power: Vec<f64> = sums.iter().map(|s| s.length_squared() / points.len().max(1) as f64).collect();
    for k in 0..half[1] * across {
        power[across * down - 1 - k] = power[k];
    }
    power[half[1] * across + half[0]] = 0.0;
    power
}

//! Photons where they land, in a strip of the grid of the light's view that they were emitted in.

use std::ops::{Mul, Range, Sub};

use glam::Vec3;

use super::strips::Strip;

/// A photon on a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photon {
    /// Where it lands, metres.
    pub position: Vec3,
    /// Unit normal of the receiver's triangle, towards the photon.
    pub normal: Vec3,
    /// Unit direction in which it travels.
    pub direction: Vec3,
    /// Unit direction in which light would arrive that nothing has turned.
    pub undeflected: Vec3,
    /// Its flux, W.
    pub flux: Vec3,
    /// The receiver.
    pub object: u32,
    /// The object that reflected or refracted it.
    pub caster: u32,
    /// Its way.
    pub way: Way,
}

/// The way of a photon from the light to a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// From the light to the first surface, metres; infinite from far away.
    pub before: f32,
    /// Within a closed object, metres; 0 without one.
    pub within: f32,
    /// From the last surface to the receiver, metres.
    pub beyond: f32,
    /// Where it is reflected or refracted first.
    pub first: SurfacePoint,
    /// Where it is refracted last; the same point if there is only one.
    pub last: SurfacePoint,
}

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Metres.
    pub position: Vec3,
    /// Unit normal, interpolated, on the side that light comes from.
    pub normal: Vec3,
}

/// What lies between photons and their neighbours.
const EMPTY: u32 = u32::MAX;

/// Photons of one light that took the same kind of way, in the grid of its view. Places without a photon are free.
#[derive(Clone, Debug)]
pub struct PhotonGrid {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Row by row.
    pub photons: Vec<Photon>,
    /// The column and row of each photon.
    pub texels: Vec<[u32; 2]>,
    /// Of photons that are in no grid: how their places on the receiver change over the part of the view that each stands for, along both of
    /// its axes, metres. Empty in grids.
    pub sides: Vec<Option<[Vec3; 2]>>,
    /// Photons that are to be added to maps; the others are their neighbours.
    pub own: Range<usize>,
    /// Where the rows are in the view.
    pub(crate) strip: Strip,
    indices: Vec<u32>,
}

impl PhotonGrid {
    /// From rows of photons with their columns.
    pub(crate) fn new(width: u32, strip: Strip, rows: impl Iterator<Item = Vec<(u32, Photon)>>) -> Self {
        let height = strip.rows;
        let mut indices = vec![EMPTY; width as usize * height as usize];
        let (mut photons, mut texels) = (Vec::new(), Vec::new());
        for (y, row) in (0..).zip(rows) {
            for (x, photon) in row {
                indices[y as usize * width as usize + x as usize] = photons.len() as u32;
                photons.push(photon);
                texels.push([x, y]);
            }
        }
        let first_in = |row: u32| texels.partition_point(|[_, y]: &[u32; 2]| *y < row);
        let own = first_in(strip.first_own_row)..first_in(strip.first_own_row + strip.own_rows);
        Self { size: [width, height], photons, texels, sides: Vec::new(), own, strip, indices }
    }

    /// Photons without neighbours, each with how its place changes over the part of the view that it stands for.
    pub fn scattered(photons: Vec<(Photon, Option<[Vec3; 2]>)>) -> Self {
        let (photons, sides): (Vec<Photon>, Vec<_>) = photons.into_iter().unzip();
        let (own, texels) = (0..photons.len(), vec![[0; 2]; photons.len()]);
        Self { size: [0; 2], texels, photons, sides, own, strip: Strip::default(), indices: Vec::new() }
    }

    /// The photons for which a list does not say `true`, in their places.
    #[must_use]
    pub fn without(&self, is_left_out: &[bool]) -> Self {
        if self.indices.is_empty() {
            let all = self.photons.iter().zip(&self.sides).zip(is_left_out);
            return Self::scattered(
                all.filter(|(_, left)| !**left).map(|((photon, sides), _)| (*photon, *sides)).collect(),
            );
        }
        let mut rows = vec![Vec::new(); self.size[1] as usize];
        for ((photon, [x, y]), _) in self.photons.iter().zip(&self.texels).zip(is_left_out).filter(|(_, left)| !**left)
        {
            rows[*y as usize].push((*x, *photon));
        }
        Self::new(self.size[0], self.strip, rows.into_iter())
    }

    /// The photons that are to be added to maps.
    pub fn own_photons(&self) -> &[Photon] {
        &self.photons[self.own.clone()]
    }

    /// The index of the photon at a place, if there is one.
    pub fn index_at(&self, x: i64, y: i64) -> Option<usize> {
        let [width, height] = self.size.map(i64::from);
        if !(0..width).contains(&x) || !(0..height).contains(&y) {
            return None;
        }
        let index = self.indices[(y * width + x) as usize];
        (index != EMPTY).then_some(index as usize)
    }

    /// How a value of photons changes from one column and from one row to the next at one of them: half the difference between its
    /// neighbours or, where one of them is missing or none of its own, that to the other one. `None` without a neighbour.
    pub fn differences<T: Copy + Sub<Output = T> + Mul<f64, Output = T>>(
        &self,
        index: usize,
        is_neighbour: impl Fn(usize, usize) -> bool,
        value: impl Fn(usize) -> T,
    ) -> [Option<T>; 2] {
        let [x, y] = self.texels[index].map(i64::from);
        [(1, 0), (0, 1)].map(|(dx, dy)| {
            let neighbour =
                |k: i64| self.index_at(x + k * dx, y + k * dy).filter(|other| is_neighbour(index, *other)).map(&value);
            match (neighbour(-1), neighbour(1)) {
                (Some(before), Some(after)) => Some((after - before) * 0.5),
                (Some(before), None) => Some(value(index) - before),
                (None, Some(after)) => Some(after - value(index)),
                (None, None) => None,
            }
        })
    }
}

//! Sixteen receivers, lane by lane. Knows no sample.

use glam::Vec3;

use crate::lanes::{F, LANES, Simd, V3, lanes};
use crate::pinhole::Receivers;

/// The object of a lane without a receiver.
pub(super) const NO_OBJECT: u32 = u32::MAX;

/// Sixteen receivers, lane by lane, in memory.
pub(super) struct ReceiverGroup {
    pub position: [[f32; LANES]; 3],
    pub normal: [[f32; LANES]; 3],
    pub object: [u32; LANES],
    /// Towards the viewer, where there is one.
    pub view: Option<[Vec3; LANES]>,
    /// Of parts of rays, metres.
    pub length: Option<[f32; LANES]>,
}

/// The same in registers.
pub(super) struct Receiver<'a, S: Simd> {
    pub position: V3<S>,
    pub normal: V3<S>,
    pub object: &'a [u32; LANES],
    pub view: Option<&'a [Vec3; LANES]>,
    /// Where receivers are parts of rays, metres; their normals are the directions towards the viewer.
    pub length: Option<F<S>>,
}

impl ReceiverGroup {
    #[inline(always)]
    pub fn in_lanes<S: Simd>(&self, simd: S) -> Receiver<'_, S> {
        Receiver {
            position: V3::load(simd, &self.position),
            normal: V3::load(simd, &self.normal),
            object: &self.object,
            view: self.view.as_ref(),
            length: self.length.map(|length| lanes(simd, length)),
        }
    }
}

impl<S: Simd> Receiver<'_, S> {
    /// Where receivers are parts of rays: from one end to the other, metres.
    #[inline(always)]
    pub fn segment(&self) -> Option<V3<S>> {
        self.length.map(|length| self.normal * length)
    }

    /// The lanes that have a receiver.
    #[inline(always)]
    pub fn occupied(&self) -> u32 {
        (0..LANES).filter(|&lane| self.object[lane] != NO_OBJECT).fold(0, |bits, lane| bits | 1 << lane)
    }
}

/// Up to sixteen consecutive receivers.
pub(super) fn load_receivers(receivers: &Receivers, start: usize, count: usize) -> ReceiverGroup {
    load_at(receivers, |lane| (lane < count).then_some(start + lane))
}

/// The receivers at sixteen indices. Lanes without one get a normal of zero, so that nothing reaches them.
pub(super) fn load_at(receivers: &Receivers, index: impl Fn(usize) -> Option<usize>) -> ReceiverGroup {
    let mut group = ReceiverGroup {
        position: [[0.0; LANES]; 3],
        normal: [[0.0; LANES]; 3],
        object: [NO_OBJECT; LANES],
        view: receivers.view_directions.as_ref().map(|_| [Vec3::ZERO; LANES]),
        length: receivers.lengths.as_ref().map(|_| [0.0; LANES]),
    };
    for lane in 0..LANES {
        let Some(index) = index(lane) else { continue };
        let Some(object) = receivers.object(index) else { continue };
        let (p, n) = (receivers.positions[index], receivers.normals[index]);
        group.object[lane] = object;
        for axis in 0..3 {
            group.position[axis][lane] = p[axis];
            group.normal[axis][lane] = n[axis];
        }
        if let (Some(views), Some(view)) = (&mut group.view, &receivers.view_directions) {
            views[lane] = Vec3::from_slice(&view.directions[index]);
        }
        if let (Some(lengths), Some(of_receivers)) = (&mut group.length, &receivers.lengths) {
            lengths[lane] = of_receivers[index];
        }
    }
    group
}

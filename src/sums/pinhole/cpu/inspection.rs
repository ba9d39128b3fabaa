//! The sum at one receiver taken apart: what each sample adds to it, and from which directions.

use glam::Vec3;

use super::filters::CpuFilter;
use super::pair::ReceiverCellPair;
use super::receiver::load_receivers;
use super::{Gather, Lights, ReceiverGroup, irradiance_of};
use crate::lanes::{Simd, V3, dispatch, level};
use crate::pinhole::{Params, PinholeParts, PinholeSample, Pinholes, Receivers};

/// What a sample adds to the irradiance of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// W/m², for an environment of intensity 1.
    pub irradiance: Vec3,
    /// The unit direction in the world whose light the sample reflects to the receiver,
    pub direction: Vec3,
    /// and the full sides of the footprint around it, radians.
    pub sides: [Vec3; 2],
}

/// What each sample that faces it adds to a receiver of all lights, given by its position, unit normal and object. The parts add up to what
/// the sums of [`gather`](super::gather) and of near light return with the anisotropic filter.
pub fn contributions_to(
    receiver: (Vec3, Vec3, u32),
    pinholes: &Pinholes,
    lights: &Lights,
    params: &Params,
) -> Vec<Contribution> {
    let gathers = lights.gathers(pinholes, params);
    let group = load_receivers(&Receivers::from_points(&[receiver], 1), 0, 1);
    let part = |sample: &PinholeSample| dispatch!(level(), simd => contribution(simd, &gathers, sample, &group));
    pinholes.samples.iter().filter_map(part).collect()
}

#[inline(always)]
fn contribution<S: Simd>(
    simd: S,
    gathers: &[Gather],
    sample: &PinholeSample,
    group: &ReceiverGroup,
) -> Option<Contribution> {
    let receiver = group.in_lanes(simd);
    let parts = PinholeParts::from(sample);
    let pair = ReceiverCellPair::new(simd, &parts, &receiver);
    if pair.lit() & 1 == 0 {
        return None;
    }
    let sum = irradiance_of(simd, (gathers, CpuFilter::Anisotropic), sample, &receiver);
    let footprint = pair.footprint(simd, &parts);
    let [r, v1, v2] = [footprint.r, footprint.v1, footprint.v2].map(
        #[inline(always)]
        |v: V3<S>| Vec3::from(v.to_arrays().map(|lanes| lanes[0])),
    );
    Some(Contribution { irradiance: sum[0].truncate(), direction: r, sides: [v1, v2] })
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;
    use crate::differential::differentials;
    use crate::environment::CubeMap;
    use crate::pinhole::{Filter, Footprint, cpu, pinholes};
    use crate::sampling::{Options, Strategy, Surface, sample};
    use pinspot_base::NoProgress;

    #[test]
    fn contributions_add_up_to_the_sum() {
        let scene = crate::scene::load::<toml::Table>("ring").unwrap().scene;
        let options = Options { samples: 300, strategy: Strategy::Neighbourhood, seed: 2 };
        let set = sample(&Surface::of_scene(&scene), &options).unwrap();
        let mut pinholes = pinholes(&scene, &differentials(&set), Footprint::Cells);
        pinholes.trace_visibility(&scene, &crate::tracing::Tracer::new(&scene), &NoProgress);
        let cube = CubeMap::from_radiance(64, None, |d| Vec3::new(1.0 + d.x, 1.5 + d.y, 2.0 - d.z));
        let params = Params { filter: Filter::Anisotropic, environment_rotation_rad: 0.4, ..Params::default() };
        let lamp = crate::scene::Lamp {
            name: String::new(),
            position: Vec3::new(0.3, 0.5, 0.1),
            radius: 0.1,
            intensity: Vec3::new(1.0, 2.0, 3.0),
            beam: None,
            is_distant: false,
        };
        let lights = Lights { lamps: std::slice::from_ref(&lamp), ..Lights::environment(&cube) };
        for x in [0.0, 0.5, -1.4] {
            let receiver = (Vec3::new(x, 0.0, 0.2), Vec3::Y, 1);
            let parts = contributions_to(receiver, &pinholes, &lights, &params);
            let receivers = Receivers::from_points(&[receiver], 1);
            let of_environment = cpu::gather(&receivers, &pinholes, &cube, &params, &NoProgress).unwrap()[0];
            let of_lamp =
                Vec4::from(cpu::gather_lamp(&receivers, &pinholes, &lamp, &params, &NoProgress)[0]).truncate();
            assert!(x < -1.0 || of_lamp.min_element() > 0.0, "{of_lamp}");
            let whole = Vec4::from(of_environment).truncate() + of_lamp;
            let sum: Vec3 = parts.iter().map(|part| part.irradiance).sum();
            assert!(sum.abs_diff_eq(whole, 1e-4 * (1.0 + sum.x)), "{sum} {whole}");
            assert!(parts.iter().all(|part| part.direction.is_normalized() && part.irradiance.min_element() >= 0.0));
        }
    }
}

//! The surface of water in a basin: wave trains that travel as fast as their lengths let them.
//!
//! A train of wave number k on water of depth d has the angular frequency √(g k tanh(k d)), for waves long enough that gravity rules them
//! (Airy's linear theory). Frequencies are rounded to whole multiples of 2π over the period, so that the waves come back to where they were
//! (Tessendorf, *Simulating Ocean Water*, SIGGRAPH course notes 2001, Section 4.2).

use std::f64::consts::TAU;

use glam::DVec2;

use super::height_field::height_field;
use super::{Parts, Water};

/// Quads along each edge.
const QUADS: u32 = 128;
/// Number of trains.
const TRAINS: u32 = 20;
/// Acceleration of free fall, m/s².
const GRAVITY: f64 = 9.81;
/// The shortest and the longest waves, relative to the dominant ones.
const LENGTHS: [f64; 2] = [0.45, 1.8];
/// Directions of travel, on either side of +X, radians.
const SPREAD_RAD: f64 = 1.3;

/// A train of waves.
struct Train {
    /// Radians per metre along X and Z.
    wave_vector: DVec2,
    /// Metres.
    amplitude: f64,
    /// At the origin, radians.
    phase: f64,
}

pub(super) fn water(water: &Water) -> Parts {
    let trains = trains(water);
    height_field(water.size, QUADS, |place| surface(&trains, place))
}

fn trains(water: &Water) -> Vec<Train> {
    // Evenly spread numbers from 0 to 1 (Roberts' R2 and golden-ratio sequences).
    let spread = |k: u32, step: f64| (0.5 + f64::from(k) * step).fract();
    let seconds = f64::from(water.phase_deg) / 360.0 * f64::from(water.period);
    let mut trains: Vec<Train> = (0..TRAINS)
        .map(|k| {
            let [shortest, longest] = LENGTHS;
            let relative = shortest * (longest / shortest).powf(spread(k, 0.754_877_666_246_692_8));
            let wave_number = TAU / (f64::from(water.wavelength) * relative);
            let direction = DVec2::from_angle(SPREAD_RAD * (2.0 * spread(k, 0.569_840_290_998_053_2) - 1.0));
            let frequency = (GRAVITY * wave_number * (wave_number * f64::from(water.depth)).tanh()).sqrt();
            let first = TAU / f64::from(water.period);
            let frequency = (frequency / first).round().max(1.0) * first;
            Train {
                wave_vector: wave_number * direction,
                // The dominant waves are the highest; across the wind they are lower.
                amplitude: (-2.0 * relative.ln().powi(2)).exp() * relative * (0.3 + direction.x),
                phase: TAU * spread(k, 0.618_033_988_749_894_9) - frequency * seconds,
            }
        })
        .collect();
    // Independent trains: half the squares of their amplitudes add up.
    let mean_square: f64 = trains.iter().map(|train| 0.5 * train.amplitude * train.amplitude).sum();
    let scale = f64::from(water.amplitude) / mean_square.sqrt();
    for train in &mut trains {
        train.amplitude *= scale;
    }
    trains
}

/// Height above y = 0 and its gradient along x and z.
fn surface(trains: &[Train], place: DVec2) -> (f64, DVec2) {
    trains.iter().fold((0.0, DVec2::ZERO), |(height, slope), train| {
        let (sine, cosine) = (train.wave_vector.dot(place) + train.phase).sin_cos();
        (height + train.amplitude * sine, slope + train.amplitude * cosine * train.wave_vector)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn height(water: &Water, place: DVec2) -> f64 {
        surface(&trains(water), place).0
    }

    #[test]
    fn waves_come_back_after_a_period() {
        let at = |phase_deg: f32| height(&Water { phase_deg, ..Water::default() }, DVec2::new(0.3, -0.2));
        assert!((at(0.0) - at(360.0)).abs() < 1e-9);
        assert!((at(0.0) - at(60.0)).abs() > 1e-4);
    }

    #[test]
    fn the_root_mean_square_of_the_height_is_the_amplitude() {
        let water = Water::default();
        let trains = trains(&water);
        let places = (0..200).flat_map(|i| (0..200).map(move |j| DVec2::new(f64::from(i), f64::from(j)) * 0.173));
        let squares: f64 = places.map(|place| surface(&trains, place).0.powi(2)).sum();
        let rms = (squares / 40_000.0).sqrt();
        assert!((rms / f64::from(water.amplitude) - 1.0).abs() < 0.05, "{rms}");
    }

    /// Slopes are the derivatives of heights.
    #[test]
    fn slopes_are_finite_differences() {
        let trains = trains(&Water { phase_deg: 40.0, ..Water::default() });
        let (place, step) = (DVec2::new(0.4, 0.1), 1e-6);
        let (_, slope) = surface(&trains, place);
        let difference = |axis: DVec2| {
            (surface(&trains, place + step * axis).0 - surface(&trains, place - step * axis).0) / (2.0 * step)
        };
        assert!(slope.abs_diff_eq(DVec2::new(difference(DVec2::X), difference(DVec2::Y)), 1e-6));
    }

    /// Long waves travel faster than short ones, and slower in shallow water.
    #[test]
    fn frequencies_follow_the_dispersion_relation() {
        let speed = |depth: f32| {
            let water = Water { depth, period: 1e4, ..Water::default() };
            let later = Water { phase_deg: 360.0e-4, ..water };
            let (before, after) = (trains(&water), trains(&later));
            let of = |k: usize| (before[k].phase - after[k].phase) / before[k].wave_vector.length();
            let mut speeds: Vec<(f64, f64)> =
                (0..before.len()).map(|k| (before[k].wave_vector.length(), of(k))).collect();
            speeds.sort_by(|a, b| a.0.total_cmp(&b.0));
            speeds
        };
        let (deep, shallow) = (speed(10.0), speed(0.02));
        let (wave_number, first) = deep[0];
        assert!((first - (GRAVITY / wave_number).sqrt()).abs() < 1e-3 * first, "{first}");
        assert!(deep.first().unwrap().1 > deep.last().unwrap().1 && shallow[0].1 < 0.6 * first);
    }
}

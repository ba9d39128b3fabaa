//! A rectangular sheet in waves: two trains that cross each other, the second twice as fast as the first.

use std::f64::consts::TAU;

use glam::DVec2;

use super::height_field::height_field;
use super::{Parts, Sheet};

/// Quads along each edge.
const QUADS: u32 = 96;
/// Direction of travel and share of the amplitude of each train.
const TRAINS: [(DVec2, f64); 2] = [(DVec2::new(1.0, 0.0), 0.6), (DVec2::new(0.6, 0.8), 0.4)];

pub(super) fn sheet(sheet: &Sheet) -> Parts {
    height_field(sheet.size, QUADS, |place| surface(sheet, place))
}

/// Height above y = 0 and its gradient along x and z.
fn surface(sheet: &Sheet, place: DVec2) -> (f64, DVec2) {
    let wave_number = TAU / f64::from(sheet.wavelength);
    let (mut height, mut slope) = (0.0, DVec2::ZERO);
    for (k, (direction, share)) in TRAINS.into_iter().enumerate() {
        let phase = wave_number * direction.dot(place) - (k + 1) as f64 * f64::from(sheet.phase_deg).to_radians();
        let amplitude = share * f64::from(sheet.amplitude);
        height += amplitude * phase.sin();
        slope += amplitude * wave_number * phase.cos() * direction;
    }
    (height, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_come_back_after_a_period() {
        let at = |phase_deg: f32| surface(&Sheet { phase_deg, ..Sheet::default() }, DVec2::new(0.3, -0.2)).0;
        assert!((at(0.0) - at(360.0)).abs() < 1e-9);
        assert!((at(0.0) - at(90.0)).abs() > 1e-3);
    }
}

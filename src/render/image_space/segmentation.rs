//! Divides an environment into directional lights of about equal power (Tandianus, Johan and Seah 2010, Section 5): the region with most of
//! it is split again and again. Texels are weighted by their solid angles, which differ fivefold in a cube map.

use glam::Vec3;

use crate::environment::{CubeMap, FACES, face_direction, texel_solid_angle_sr};

/// Faces are resolved into at most this many texels along an edge.
const FINEST: u32 = 128;

/// Light from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Unit direction towards the light: the mean over its region, weighted by radiance.
    pub towards: Vec3,
    /// ∫ L dω over its region: the irradiance on a surface that faces it, W/m².
    pub irradiance: Vec3,
}

/// A rectangle of texels of a face: from its first column and row up to before the last ones.
#[derive(Clone, Copy, Debug)]
struct Rectangle {
    face: usize,
    low: [u32; 2],
    high: [u32; 2],
}

/// Rectangles that one light stands for: at first all faces.
#[derive(Clone, Debug)]
struct Region {
    parts: Vec<Rectangle>,
    power: f64,
}

impl Region {
    fn can_be_split(&self) -> bool {
        let extent = |part: &Rectangle| [0, 1].map(|axis| part.high[axis] - part.low[axis]);
        self.parts.len() > 1 || self.parts.iter().any(|part| extent(part) != [1, 1])
    }
}

/// At most `count` directional lights that together shine like an environment; fewer if it has no more texels that shine.
pub fn segmented(cube: &CubeMap, count: u32) -> Vec<Direction> {
    let texels = Texels::of(cube);
    let face = |face| Rectangle { face, low: [0; 2], high: [texels.size; 2] };
    let mut regions = vec![texels.region((0..FACES).map(face).collect())];
    while regions.len() < count as usize {
        let strongest = (0..regions.len())
            .filter(|&k| regions[k].power > 0.0 && regions[k].can_be_split())
            .max_by(|&a, &b| regions[a].power.total_cmp(&regions[b].power).then(b.cmp(&a)));
        let Some(strongest) = strongest else { break };
        let halves = texels.split(&regions.swap_remove(strongest));
        regions.extend(halves);
    }
    regions.iter().filter(|region| region.power > 0.0).map(|region| texels.direction(region)).collect()
}

/// Radiance times solid angle of all texels.
struct Texels {
    size: u32,
    power: Vec<Vec3>,
}

impl Texels {
    fn of(cube: &CubeMap) -> Self {
        let level = (0..cube.level_count()).find(|level| cube.size() >> level <= FINEST).unwrap_or(0);
        let size = cube.size() >> level;
        let mut power = Vec::new();
        for (row, texels) in cube.rows(level).enumerate() {
            let y = row as u32 % size;
            let of_texel = |(x, texel): (u32, &glam::Vec4)| {
                texel.truncate().max(Vec3::ZERO) * texel_solid_angle_sr(size, x, y) as f32
            };
            power.extend((0..).zip(texels).map(of_texel));
        }
        Self { size, power }
    }

    fn at(&self, face: usize, x: u32, y: u32) -> Vec3 {
        self.power[(face * self.size as usize + y as usize) * self.size as usize + x as usize]
    }

    fn region(&self, parts: Vec<Rectangle>) -> Region {
        let power = parts.iter().map(|part| self.power_of(part)).sum();
        Region { parts, power }
    }

    fn power_of(&self, part: &Rectangle) -> f64 {
        self.texels_of(part).map(|(_, power)| power.as_dvec3().element_sum()).sum()
    }

    /// The directions of a rectangle's texels, and their power.
    fn texels_of(&self, part: &Rectangle) -> impl Iterator<Item = (Vec3, Vec3)> {
        let Rectangle { face, low, high } = *part;
        let texels = (low[1]..high[1]).flat_map(move |y| (low[0]..high[0]).map(move |x| (x, y)));
        texels.map(move |(x, y)| {
            let place = |k: u32| (2.0 * k as f32 + 1.0) / self.size as f32 - 1.0;
            (face_direction(face, place(x), place(y)).normalize(), self.at(face, x, y))
        })
    }

    /// Two halves of a region: of one rectangle by the line across its longer side that divides its power most evenly, of several ones
    /// by sharing them out.
    fn split(&self, region: &Region) -> [Region; 2] {
        if let [part] = region.parts[..] {
            return self.split_rectangle(&part).map(|half| self.region(vec![half]));
        }
        let mut parts: Vec<(f64, Rectangle)> = region.parts.iter().map(|part| (self.power_of(part), *part)).collect();
        parts.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut halves = [const { Vec::new() }; 2];
        let mut powers = [0.0; 2];
        for (power, part) in parts {
            let weaker =
                usize::from(powers[1] < powers[0] || powers[1] == powers[0] && halves[1].len() < halves[0].len());
            halves[weaker].push(part);
            powers[weaker] += power;
        }
        halves.map(|parts| self.region(parts))
    }

    fn split_rectangle(&self, part: &Rectangle) -> [Rectangle; 2] {
        let [width, height] = [0, 1].map(|axis| part.high[axis] - part.low[axis]);
        let axis = usize::from(height > width);
        let lines = part.low[axis] + 1..part.high[axis];
        let before = |line: u32| {
            let mut half = *part;
            half.high[axis] = line;
            half
        };
        let whole = self.power_of(part);
        let mut sum = 0.0;
        let mut best = (f64::INFINITY, part.low[axis] + 1);
        for line in lines {
            let mut row = before(line);
            row.low[axis] = line - 1;
            sum += self.power_of(&row);
            let difference = (2.0 * sum - whole).abs();
            if difference < best.0 {
                best = (difference, line);
            }
        }
        let mut after = *part;
        after.low[axis] = best.1;
        [before(best.1), after]
    }

    fn direction(&self, region: &Region) -> Direction {
        let texels = || region.parts.iter().flat_map(|part| self.texels_of(part));
        let irradiance = texels().map(|(_, power)| power).sum();
        let mean: Vec3 = texels().map(|(towards, power)| towards * power.element_sum()).sum();
        let brightest = || texels().max_by(|a, b| a.1.element_sum().total_cmp(&b.1.element_sum())).map(|(d, _)| d);
        let towards = mean.try_normalize().or_else(brightest).unwrap_or(Vec3::Y);
        Direction { towards, irradiance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dim sky with a bright spot.
    fn sky() -> CubeMap {
        let spot = Vec3::new(0.6, 0.7, -0.3).normalize();
        CubeMap::from_radiance(64, None, |d| {
            Vec3::new(1.0, 0.8, 0.6) + 300.0 * (-200.0 * (d - spot).length_squared()).exp()
        })
    }

    #[test]
    fn regions_have_all_the_light() {
        let cube = sky();
        let expected: Vec3 = Texels::of(&cube).power.iter().sum();
        for count in [1, 2, 6, 24, 48] {
            let lights = segmented(&cube, count);
            assert_eq!(lights.len(), count as usize);
            let found: Vec3 = lights.iter().map(|light| light.irradiance).sum();
            assert!((found / expected - 1.0).abs().max_element() < 1e-5, "{count}: {found} {expected}");
        }
    }

    /// Halves differ by a line of texels at most, and lights gather where the light is.
    #[test]
    fn regions_are_halved_by_power() {
        let cube = sky();
        let texels = Texels::of(&cube);
        let face = Rectangle { face: 2, low: [0; 2], high: [64; 2] };
        let [one, other] = texels.split_rectangle(&face);
        let (difference, line) = ((texels.power_of(&one) - texels.power_of(&other)).abs(), one.high[0]);
        let beside = |x: u32| texels.power_of(&Rectangle { low: [x, 0], high: [x + 1, 64], ..face });
        assert!(difference <= beside(line - 1).max(beside(line)), "{difference}");
        let spot = Vec3::new(0.6, 0.7, -0.3).normalize();
        let lights = segmented(&cube, 24);
        let near = lights.iter().filter(|light| light.towards.dot(spot) > 0.97).count();
        assert!(near >= 6, "{near}");
    }

    #[test]
    fn dark_environments_have_no_lights() {
        assert!(segmented(&CubeMap::from_radiance(16, None, |_| Vec3::ZERO), 24).is_empty());
    }
}

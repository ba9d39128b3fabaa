//! Divides an environment into directional lights of about equal power (Tandianus, Johan and Seah 2010, Section 5): the region with most of
//! it is split again and again. Texels are weighted by their solid angles, which differ fivefold in a cube map.

use std::sync::Arc;

use glam::{UVec2, Vec2, Vec3};

use crate::environment::{CubeMap, FACES, face_direction, texel_solid_angle_sr};

/// Faces are resolved into at most this many texels along an edge.
const FINEST: u32 = 256;

/// A part is as small as the sun if it has no more than so many of the finest texels.
const NARROW: f32 = 4.0;

/// Light from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Unit direction towards the light: the mean over its region, weighted by radiance.
    pub towards: Vec3,
    /// ∫ L dω over its region: the irradiance on a surface that faces it, W/m².
    pub irradiance: Vec3,
}

/// A part of an environment, out of which directions are drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// All of it as light from one direction.
    pub whole: Direction,
    /// Its texels that shine, with the sum of their power and that of those before them.
    texels: Arc<[(Texel, f64)]>,
}

/// A texel of a cube map: its face, its middle and half its width on it, and ∫ L dω over it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Texel {
    face: usize,
    middle: Vec2,
    half: f32,
    irradiance: Vec3,
}

impl Texel {
    /// The unit direction towards its middle, and its light.
    fn light(self) -> (Vec3, Vec3) {
        (face_direction(self.face, self.middle.x, self.middle.y).normalize(), self.irradiance)
    }
}

impl Segment {
    /// Whether it is about as small as the sun, so that its caustic is as sharp.
    pub fn is_narrow(&self) -> bool {
        let finest = (1.0 / FINEST as f32).powi(2);
        self.texels.iter().map(|(texel, _)| texel.half * texel.half).sum::<f32>() <= NARROW * finest
    }

    /// A direction for a number from 0 to 1, the more numbers the more power comes from there, and a point of the unit square, which tells where
    /// in its texel it lies. The mean over all of them shines like the segment.
    pub fn draw(&self, number: f32, within: Vec2) -> Direction {
        let Some((_, power)) = self.texels.last() else { return self.whole };
        let chosen = self.texels.partition_point(|(_, sum)| *sum <= f64::from(number) * power);
        let Some((Texel { face, middle, half, irradiance }, _)) = self.texels.get(chosen) else { return self.whole };
        let place = *middle + *half * (2.0 * within - 1.0);
        let towards = face_direction(*face, place.x, place.y).normalize();
        let own = irradiance.as_dvec3().element_sum();
        Direction { towards, irradiance: *irradiance * (power / own) as f32 }
    }
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

/// At most `count` segments of about equal power; fewer if it has no more texels that shine.
pub fn segments(cube: &CubeMap, count: u32) -> Vec<Segment> {
    let texels = Texels::of(cube);
    texels.regions(count).iter().map(|region| texels.segment(region)).collect()
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

    /// Regions of about equal power.
    fn regions(&self, count: u32) -> Vec<Region> {
        let face = |face| Rectangle { face, low: [0; 2], high: [self.size; 2] };
        let mut regions = vec![self.region((0..FACES).map(face).collect())];
        while regions.len() < count as usize {
            let strongest = (0..regions.len())
                .filter(|&k| regions[k].power > 0.0 && regions[k].can_be_split())
                .max_by(|&a, &b| regions[a].power.total_cmp(&regions[b].power).then(b.cmp(&a)));
            let Some(strongest) = strongest else { break };
            let halves = self.split(&regions.swap_remove(strongest));
            regions.extend(halves);
        }
        regions.retain(|region| region.power > 0.0);
        regions
    }

    fn region(&self, parts: Vec<Rectangle>) -> Region {
        let power = parts.iter().map(|part| self.power_of(part)).sum();
        Region { parts, power }
    }

    fn power_of(&self, part: &Rectangle) -> f64 {
        self.texels_of(part).map(|texel| texel.irradiance.as_dvec3().element_sum()).sum()
    }

    fn texels_of(&self, part: &Rectangle) -> impl Iterator<Item = Texel> {
        let Rectangle { face, low, high } = *part;
        let texels = (low[1]..high[1]).flat_map(move |y| (low[0]..high[0]).map(move |x| (x, y)));
        texels.map(move |(x, y)| {
            let half = 1.0 / self.size as f32;
            let middle = half * (2.0 * UVec2::new(x, y).as_vec2() + 1.0) - 1.0;
            Texel { face, middle, half, irradiance: self.at(face, x, y) }
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

    fn segment(&self, region: &Region) -> Segment {
        let mut sum = 0.0;
        let mut texels = Vec::new();
        for texel in region.parts.iter().flat_map(|part| self.texels_of(part)) {
            let power = texel.irradiance.as_dvec3().element_sum();
            sum += power;
            texels.extend((power > 0.0).then_some((texel, sum)));
        }
        Segment { whole: self.direction(region), texels: texels.into() }
    }

    fn direction(&self, region: &Region) -> Direction {
        let texels = || region.parts.iter().flat_map(|part| self.texels_of(part)).map(Texel::light);
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
            let lights: Vec<Direction> = segments(&cube, count).into_iter().map(|segment| segment.whole).collect();
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
        let parts = segments(&cube, 24);
        let near = parts.iter().filter(|part| part.whole.towards.dot(spot) > 0.97).count();
        assert!(near >= 6, "{near}");
    }

    /// Many directions together shine like the part that they are drawn from, and lie in it.
    #[test]
    fn directions_are_drawn_by_their_light() {
        let parts = segments(&sky(), 6);
        for part in &parts {
            let drawn =
                |k: u32| part.draw((k as f32 * 0.618_034).fract(), Vec2::new((k as f32 * 0.754_878).fract(), 0.5));
            let count = 4096;
            let mean = (0..count).map(|k| drawn(k).irradiance).sum::<Vec3>() / count as f32;
            assert!((mean / part.whole.irradiance - 1.0).abs().max_element() < 0.01, "{mean} {:?}", part.whole);
            let towards: Vec3 = (0..count).map(|k| drawn(k).towards * drawn(k).irradiance.element_sum()).sum();
            assert!(towards.normalize().dot(part.whole.towards) > 0.9999, "{towards} {:?}", part.whole);
        }
    }

    #[test]
    fn dark_environments_have_no_lights() {
        assert!(segments(&CubeMap::from_radiance(16, None, |_| Vec3::ZERO), 24).is_empty());
    }
}

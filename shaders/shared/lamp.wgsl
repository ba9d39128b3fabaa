// A lamp as the light of a gather: the part of a footprint that its disc fills, in place of a look-up in the environment.
// CPU twins: src/sums/pinhole/cpu/lamp.rs, src/sums/pinhole/disc.rs, src/sums/pinhole/cell_shapes.rs and src/base/scene/lamp.rs.

#import frame
#import footprint
#import gather_inputs

// Widths of a rough mirror's lobe within which lamps are seen in it.
const TAIL_REACH: f32 = 0.75 * LOBE_TAIL_WIDTH;
const HALF_PI: f32 = 1.57079633;

// The lamp, seen from a point.
struct SeenLamp {
    // Unit vector.
    towards: vec3f,
    distance: f32,
    // Twice the sine of half its angular radius.
    chord: f32,
}

fn lamp_seen_from(point: vec3f) -> SeenLamp {
    let to = uniforms.lamp.position - point;
    let distance = max(length(to), 1.2e-38);
    return SeenLamp(to / distance, distance, chord_of_sphere(min(uniforms.lamp.radius / distance, 1.0)));
}

fn chord_of_sphere(sine: f32) -> f32 {
    let cosine = sqrt(max(1.0 - sine * sine, 0.0));
    return sine * sqrt(2.0 / (1.0 + cosine));
}

// Directions from any point within a radius to any point of the lamp are at most this far from that of the centres, radians.
fn lamp_spread(point: vec3f, radius: f32) -> f32 {
    let nearest = length(uniforms.lamp.position - point) - radius;
    let sine = (radius + uniforms.lamp.radius) / nearest;
    // An arc is at most π/2 times its sine.
    return select(WHOLE_SPHERE_RAD, sine * HALF_PI, nearest > 0.0 && sine < 1.0);
}

// Bounds of what a cell within a radius sees of the lamp: its maximum and its contrast. Directions are within `spread` of one so far from
// that of the lamp's centre, both from the same point of the cell. `may_be_even`: the lamp may fill them from all over the cell.
fn lamp_bounds(seen: SeenLamp, radius: f32, apart: f32, spread: f32, may_be_even: bool) -> vec2f {
    let bright = uniforms.lamp.max_radiance;
    let nearest = seen.distance - radius;
    if !(nearest > uniforms.lamp.radius) {
        return vec2f(bright);
    }
    let largest = chord_of_sphere(uniforms.lamp.radius / nearest);
    let least = chord_of_sphere(uniforms.lamp.radius / (seen.distance + radius));
    if apart > spread + largest {
        return vec2f(0.0);
    }
    // Beams differ by direction.
    let is_even = may_be_even && uniforms.lamp.beam == BEAM_NONE && apart + spread < least;
    return vec2f(bright, select(bright, 0.0, is_even));
}

// Whether a cone of directions from any point of a cell of this area, within a radius of its middle, meets the lamp.
fn meets_lamp(area: f32, point: vec3f, radius: f32, direction: vec3f, cone_radius: f32) -> bool {
    // A chord is shorter than its arc.
    let apart = distance(direction, lamp_seen_from(point).towards);
    return apart <= blurred_reach(area) * (cone_radius + lamp_spread(point, radius));
}

// A footprint, without a lobe, of directions to points at the lamp's distance: the lamp is seen from another place along the sides of the
// surface.
fn footprint_towards_lamp(
    seen: SeenLamp, surface: FootprintSides, r: vec3f, reflected: FootprintSides,
) -> FootprintSides {
    let side_1 = surface.v1 / seen.distance;
    let side_2 = surface.v2 / seen.distance;
    return FootprintSides(reflected.v1 + side_1 - dot(side_1, r) * r, reflected.v2 + side_2 - dot(side_2, r) * r);
}

// Where the light comes from, relative to a piece of a surface: the middle of what a footprint and the lamp's disc share, as if both were
// normal distributions of their variances. A wide footprint gets the lamp's light from its centre, a narrow one from where it points.
fn middle_of_shared(seen: SeenLamp, r: vec3f, footprint: FootprintSides, lobe: f32) -> vec3f {
    let squares = dot(footprint.v1, footprint.v1) + dot(footprint.v2, footprint.v2);
    // Of both directions together.
    let of_footprint = squares / 12.0 + 2.0 * lobe * lobe;
    let of_disc = max(0.5 * seen.chord * seen.chord, 1.2e-38);
    let off = r - seen.towards;
    let apart = max(length(off), 1.2e-38);
    // Not beyond the disc.
    let part = min(of_disc / (of_footprint + of_disc), seen.chord / apart);
    return seen.distance * normalize(seen.towards + part * off);
}

// The sides of an even cell in place of those of the footprint of a cell of this area: see EvenSides in src/sums/pinhole/cell_shapes.rs.
fn even_sides(area: f32, surface: FootprintSides, changes: FootprintSides, footprint: FootprintSides) -> FootprintSides {
    let turn = 4.0 * uniforms.reach * uniforms.reach;
    let g11 = dot(surface.v1, surface.v1) + turn * dot(changes.v1, changes.v1);
    let g12 = dot(surface.v1, surface.v2) + turn * dot(changes.v1, changes.v2);
    let g22 = dot(surface.v2, surface.v2) + turn * dot(changes.v2, changes.v2);
    let root = max(max(sqrt(max(g11 * g22 - g12 * g12, 0.0)), (g11 + g22) / MAX_EVEN_ASPECT), 1.2e-38);
    let parallelogram = max(max(length(cross(surface.v1, surface.v2)), MIN_EVEN_PART * area), 1.2e-38);
    let scale = typical_area(area) / parallelogram / root;
    // Cholesky's factor of scale · det G · G⁻¹.
    let first = max(sqrt(g22 * scale), 1.2e-38);
    let mixed = -g12 * scale / first;
    let second = sqrt(max(g11 * scale - mixed * mixed, 0.0));
    return FootprintSides(first * footprint.v1 + mixed * footprint.v2, second * footprint.v2);
}

// The mean area of the cells of the level to which one of this area belongs. Levels differ by powers of four.
fn typical_area(area: f32) -> f32 {
    if uniforms.cell_area <= 0.0 {
        return area;
    }
    return uniforms.cell_area * exp2(2.0 * floor(0.5 * log2(area / uniforms.cell_area) + 0.4));
}

// How much farther than the footprint of a cell of this area its blur reaches.
fn blurred_reach(area: f32) -> f32 {
    return 1.0 + (BLURRED_REACH - 1.0) * sqrt(typical_area(area) / max(area, 1.2e-38));
}

// Mean radiance over footprints, seen from a piece of a surface; a = fetches. `even`: the sides over which light is blurred.
fn mean_of_lamp(
    place: vec3f, n: vec3f, surface: FootprintSides, seen: SeenLamp, look_ups: LookUps, even: FootprintSides,
) -> vec4f {
    // What is blurred must not reach below the horizon.
    if dot(look_ups.r, n) * dot(seen.towards, n) <= 0.0 {
        return vec4f(0.0, 0.0, 0.0, f32(look_ups.count));
    }
    var radiance = lamp_over_footprint(place, surface, seen, look_ups.r, look_ups.first, even);
    if look_ups.count == 2u {
        radiance = 0.5 * (radiance + lamp_over_footprint(place, surface, seen, look_ups.r, look_ups.second, even));
    }
    return vec4f(radiance, f32(look_ups.count));
}

fn lamp_over_footprint(
    place: vec3f, surface: FootprintSides, seen: SeenLamp, r: vec3f, footprint: FootprintSides, even: FootprintSides,
) -> vec3f {
    // Cells are not exact parallelograms, and small lamps would show the gaps between them. Parts of rays lie end to end exactly.
    let part = softly_filled_part(r, footprint, even, seen.towards, seen.chord);
    if !(part > 0.0) {
        return vec3f(0.0);
    }
    return part * lamp_radiance_at(lit_place(place, surface, r, footprint, seen));
}

// The place on a piece of a surface from which light goes to the receiver.
fn lit_place(place: vec3f, surface: FootprintSides, r: vec3f, footprint: FootprintSides, seen: SeenLamp) -> vec3f {
    let a = footprint.v1;
    let b = footprint.v2;
    let off = seen.towards - r;
    let aa = dot(a, a);
    let ab = dot(a, b);
    let bb = dot(b, b);
    let determinant = max(aa * bb - ab * ab, 1.2e-38);
    let x = (dot(off, a) * bb - dot(off, b) * ab) / determinant;
    let y = (dot(off, b) * aa - dot(off, a) * ab) / determinant;
    return place + clamp(x, -0.5, 0.5) * surface.v1 + clamp(y, -0.5, 0.5) * surface.v2;
}

// Radiance of the lamp's disc as it is seen from a point, W/(m²·sr).
fn lamp_radiance_at(point: vec3f) -> vec3f {
    if uniforms.lamp.beam == BEAM_NONE {
        return uniforms.lamp.radiance;
    }
    return uniforms.lamp.radiance * beam_transmittance(uniforms.lamp, normalize(point - uniforms.lamp.position));
}

// The part of a footprint around a unit direction that a disc fills, from 0 to 1: blurred over the sides `even` where the footprint is much
// larger than the disc.
fn softly_filled_part(direction: vec3f, sides: FootprintSides, even: FootprintSides, towards: vec3f, chord: f32) -> f32 {
    let frame = tangent_frame(direction);
    let scale = max(chord, max(length(sides.v1), length(sides.v2)));
    let a = vec2f(dot(sides.v1, frame.u), dot(sides.v1, frame.v)) / scale;
    let b = vec2f(dot(sides.v2, frame.u), dot(sides.v2, frame.v)) / scale;
    let blur_1 = vec2f(dot(even.v1, frame.u), dot(even.v1, frame.v)) * (BLUR_RADIUS / scale);
    let blur_2 = vec2f(dot(even.v2, frame.u), dot(even.v2, frame.v)) * (BLUR_RADIUS / scale);
    let stretch = sqrt(2.0 / max(1.0 + dot(direction, towards), 1e-6)) / scale;
    let disc = stretch * vec2f(dot(towards, frame.u), dot(towards, frame.v));
    let blurred = blurred_disc(chord / scale, blur_1, blur_2);
    return blurred.radiance * part_in_unit_disc(to_unit(blurred, disc), to_unit(blurred, a), to_unit(blurred, b));
}

// An ellipse in place of a disc, which is the unit disc in coordinates of its own.
struct BlurredDisc {
    // Cholesky's factor of its moments.
    l11: f32,
    l21: f32,
    l22: f32,
    // Relative to the disc's.
    radiance: f32,
}

fn blurred_disc(radius: f32, a: vec2f, b: vec2f) -> BlurredDisc {
    let g11 = a.x * a.x + b.x * b.x;
    let g12 = a.x * a.y + b.x * b.y;
    let g22 = a.y * a.y + b.y * b.y;
    // The square of the moments, and these as its root.
    let own = radius * radius * radius * radius;
    let m11 = own + g11 * g11 + g12 * g12;
    let m12 = g12 * (g11 + g22);
    let m22 = own + g12 * g12 + g22 * g22;
    let of_blur = g11 * g22 - g12 * g12;
    let determinant = sqrt(own * (m11 + m22 - own) + of_blur * of_blur);
    let inverse_trace = 1.0 / sqrt(m11 + m22 + 2.0 * determinant);
    let l11 = sqrt((m11 + determinant) * inverse_trace);
    let area = max(sqrt(determinant), radius * radius);
    return BlurredDisc(l11, m12 * inverse_trace / l11, area / l11, radius * radius / area);
}

fn to_unit(disc: BlurredDisc, v: vec2f) -> vec2f {
    let x = v.x / disc.l11;
    return vec2f(x, (v.y - disc.l21 * x) / disc.l22);
}

// The part of a parallelogram around the origin that a unit disc fills.
fn part_in_unit_disc(disc: vec2f, full_a: vec2f, full_b: vec2f) -> f32 {
    var a = full_a;
    var b = full_b;
    let off = length(disc);
    let reach = 0.5 * (length(a) + length(b));
    let longest = max(dot(a, a), dot(b, b));
    if off >= 1.0 + reach {
        return 0.0;
    }
    if off + reach <= 1.0 || longest < MIN_DISC_LENGTH * MIN_DISC_LENGTH {
        return select(0.0, 1.0, off < 1.0);
    }
    if abs(cross_2d(a, b)) < MIN_SLENDERNESS * longest {
        if dot(a, a) >= dot(b, b) {
            b += MIN_SLENDERNESS * vec2f(-a.y, a.x);
        } else {
            a += MIN_SLENDERNESS * vec2f(-b.y, b.x);
        }
    }
    let sum = 0.5 * (a + b);
    let difference = 0.5 * (a - b);
    let area = area_in_unit_disc(sum - disc, -difference - disc) + area_in_unit_disc(-difference - disc, -sum - disc)
        + area_in_unit_disc(-sum - disc, difference - disc) + area_in_unit_disc(difference - disc, sum - disc);
    return saturate(area / cross_2d(a, b));
}

fn cross_2d(a: vec2f, b: vec2f) -> f32 {
    return a.x * b.y - a.y * b.x;
}

fn sector(a: vec2f, b: vec2f) -> f32 {
    return 0.5 * atan2(cross_2d(a, b), dot(a, b));
}

// The area, positive counter-clockwise, that the unit disc around the origin shares with the triangle from there to an edge.
fn area_in_unit_disc(from_corner: vec2f, to_corner: vec2f) -> f32 {
    let edge = to_corner - from_corner;
    let squared = dot(edge, edge);
    if squared == 0.0 {
        return 0.0;
    }
    // Where the edge is inside, from one part of its length to another.
    let middle = -dot(from_corner, edge) / squared;
    let off = cross_2d(from_corner, edge);
    let distance2 = off * off / squared;
    let half = sqrt(max(1.0 - distance2, 0.0) / squared);
    let first = max(middle - half, 0.0);
    let last = min(middle + half, 1.0);
    if distance2 >= 1.0 || first >= last {
        return sector(from_corner, to_corner);
    }
    let enters = from_corner + first * edge;
    let leaves = from_corner + last * edge;
    var area = 0.5 * cross_2d(enters, leaves);
    if first > 0.0 {
        area += sector(from_corner, enters);
    }
    if last < 1.0 {
        area += sector(leaves, to_corner);
    }
    return area;
}

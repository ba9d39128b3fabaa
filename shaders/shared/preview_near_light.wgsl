// The direct light of lamps and near emitters in previews, with soft shadows. CPU twin: src/render/stages/direct_near_light.rs. The importing
// shader declares `objects` and `unfinished`.

#import preview_lamps
#import preview_gloss
#import rays

// Shadow rays towards a lamp: first so many, and where some of them are blocked and others not, so many in all.
const FIRST_LAMP_RAYS: u32 = 16u;
const LAMP_RAYS: u32 = 64u;

// What a point gets of near light.
struct NearLight {
    // W/m².
    irradiance: vec3f,
    // What glossy points reflect of it to the camera, W/(m²·sr).
    reflected: vec3f,
}

// A part of a near emitter.
struct EmitterPart {
    position: vec3f,
    // Whether only its front is seen.
    is_closed: bool,
    // The integral of the unit normal over it, m².
    area: vec3f,
    // W/(m²·sr).
    radiance: vec3f,
}

fn near_light_on(point: SurfacePoint) -> NearLight {
    var light = NearLight(vec3f(0.0), vec3f(0.0));
    let view = view_of(point);
    for (var k = 0u; k < preview.lamp_count; k++) {
        add_lamp(load_lamp(k), point, view, &light);
    }
    for (var k = 0u; k < preview.part_count; k++) {
        add_part(load_part(k), point, view, &light);
    }
    return light;
}

fn load_part(index: u32) -> EmitterPart {
    let first = preview.lamp_count * LAMP_TEXELS + index * PART_TEXELS;
    let a = near_light_texel(first);
    return EmitterPart(a.xyz, a.w != 0.0, near_light_texel(first + 1u).xyz, near_light_texel(first + 2u).xyz);
}

// Close by, the solid angle is that of a disc seen from its axis, which stays finite.
fn add_part(part: EmitterPart, point: SurfacePoint, view: vec3f, light: ptr<function, NearLight>) {
    let to = part.position - point.position;
    let distance = length(to);
    let direction = to / max(distance, 1.2e-38);
    let towards = -dot(part.area, direction);
    let facing = select(abs(towards), max(towards, 0.0), part.is_closed);
    let arriving = facing / (distance * distance + length(part.area) / PI) * max(dot(direction, point.normal), 0.0);
    if arriving > 0.0 && is_open(point, direction, distance) {
        let irradiance = arriving * passed(distance) * part.radiance;
        (*light).irradiance += irradiance;
        (*light).reflected += irradiance * glossy_brdf(point, direction, view);
    }
}

// Sums over directions to a lamp.
struct LampSum {
    // Of the cosines, for all directions, and for those in which it is not hidden.
    all_cosines: f32,
    open_cosines: f32,
    // For these, of the cosine times the BRDF.
    reflected: vec3f,
    open_count: u32,
}

// A lamp that is at least partly above a point.
struct SeenLamp {
    towards: vec3f,
    across: vec3f,
    around: vec3f,
    distance: f32,
    // Twice the sine of half its angular radius.
    chord: f32,
}

fn add_lamp(lamp: PreviewLamp, point: SurfacePoint, view: vec3f, light: ptr<function, NearLight>) {
    let to = lamp.position - point.position;
    let distance = length(to);
    let height = dot(to, point.normal);
    if !(height > -lamp.radius && distance > lamp.radius) {
        return;
    }
    let towards = to / distance;
    let frame = orthonormal_pair(towards);
    let seen = SeenLamp(towards, frame[0], frame[1], distance, chord_of_sphere(lamp.radius / distance));
    var count = FIRST_LAMP_RAYS;
    var sum = sum_over_lamp(seen, point, view, count);
    if sum.open_count != 0u && sum.open_count != count {
        count = LAMP_RAYS;
        sum = sum_over_lamp(seen, point, view, count);
    }
    let solid_angle = PI * seen.chord * seen.chord / f32(count);
    let radiance = passed(distance) * lamp_radiance(lamp, point.position);
    var irradiance = sum.open_cosines * solid_angle * radiance;
    if height >= lamp.radius && sum.all_cosines > 0.0 {
        // What arrives without shadows is known exactly.
        irradiance = sum.open_cosines / sum.all_cosines * dot(towards, point.normal) * passed(distance)
            * lamp_intensity(lamp, -towards) / (distance * distance);
    }
    (*light).irradiance += irradiance;
    (*light).reflected += radiance * solid_angle * sum.reflected;
}

fn sum_over_lamp(seen: SeenLamp, point: SurfacePoint, view: vec3f, count: u32) -> LampSum {
    var sum = LampSum(0.0, 0.0, vec3f(0.0), 0u);
    for (var k = 0u; k < count; k++) {
        let direction = direction_to_lamp(seen, k, count);
        let cosine = max(dot(direction, point.normal), 0.0);
        sum.all_cosines += cosine;
        if is_open(point, direction, seen.distance) {
            sum.open_count += 1u;
            sum.open_cosines += cosine;
            sum.reflected += cosine * glossy_brdf(point, direction, view);
        }
    }
    return sum;
}

// One of so many directions that are spread evenly over the disc, along Vogel's spiral.
fn direction_to_lamp(seen: SeenLamp, k: u32, count: u32) -> vec3f {
    let chord = seen.chord * sqrt((f32(k) + 0.5) / f32(count));
    let turn = 2.0 * PI * fract(f32(k) * 0.381966);
    // Lambert's projection, backwards.
    let from_axis = chord * sqrt(1.0 - 0.25 * chord * chord);
    return (1.0 - 0.5 * chord * chord) * seen.towards
        + from_axis * (cos(turn) * seen.across + sin(turn) * seen.around);
}

fn chord_of_sphere(sine: f32) -> f32 {
    let cosine = sqrt(max(1.0 - sine * sine, 0.0));
    return sine * sqrt(2.0 / (1.0 + cosine));
}

// Two unit vectors perpendicular to a third (Duff et al. 2017).
fn orthonormal_pair(n: vec3f) -> array<vec3f, 2> {
    let sign = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    return array(vec3f(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), vec3f(b, sign + n.y * n.y * a, -n.y));
}

// Whether nothing lies between a point and a place that far away.
fn is_open(point: SurfacePoint, direction: vec3f, distance: f32) -> bool {
    if preview.is_shadowed == 0u {
        return true;
    }
    let met = trace(free_ray(point.position), direction, distance, true);
    if !met.is_complete {
        atomicAdd(&unfinished, 1u);
    }
    return met.triangle == NO_TRIANGLE;
}

// The part of light that gets this far through a medium that fills all space.
fn passed(distance: f32) -> vec3f {
    return select(vec3f(1.0), exp(-distance * preview.extinction), (preview.medium_flags & FILLS_SPACE) != 0u);
}

// 0 where a point is not glossy.
fn glossy_brdf(point: SurfacePoint, direction: vec3f, view: vec3f) -> vec3f {
    if (point.flags & IS_GLOSSY) == 0u {
        return vec3f(0.0);
    }
    return brdf_with_lobe(objects[point.object], point.normal, direction, view);
}

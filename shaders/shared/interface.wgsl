// Interfaces between two media: how light is reflected to receivers in front of them and refracted to those behind. The formulas are
// derived in src/sums/pinhole/interface.rs; CPU twin: src/sums/pinhole/cpu/crossing.rs.

#import constants

// Whether any sample is on an interface; without, nothing of this is compiled.
override REFRACTION: bool = false;

// What an interface does with the light for a receiver that sees it at a cosine: negative in front of it, positive behind.
struct Crossing {
    ratio: f32,
    bend: f32,
    slope: f32,
    // On the radiance.
    factor: f32,
}

// What it does at most.
struct CrossingBounds {
    // How much more than the direction from the receiver that of the light turns, and how much more than the normal.
    per_direction: f32,
    per_normal: f32,
    // How much more than the cosines at the interface its factor changes.
    per_cosine: f32,
    factor: f32,
    // Both sides may be seen, or total reflection.
    is_unbounded: bool,
    // All receivers are behind the interface.
    is_behind: bool,
    // The cosines to the normal of the steepest and of the flattest refracted direction.
    steep: f32,
    flattest: f32,
}

// A cone of directions to the light.
struct LightCone {
    axis: vec3f,
    radius: f32,
}

fn refracted_cosine(eta: f32, cosine: f32) -> f32 {
    return sqrt(max(1.0 - eta * eta * (1.0 - cosine * cosine), 0.0));
}

fn crossing_factor(eta: f32, is_fresnel: bool, cosine: f32) -> f32 {
    let is_behind = cosine > 0.0;
    let passed = refracted_cosine(eta, cosine);
    if !is_fresnel {
        return select(0.0, eta * eta, is_behind && passed > 0.0);
    }
    let front = select(-cosine, passed, is_behind);
    let behind = select(refracted_cosine(1.0 / eta, cosine), cosine, is_behind);
    let s = (front - eta * behind) / max(front + eta * behind, 1e-30);
    let p = (eta * front - behind) / max(eta * front + behind, 1e-30);
    let reflected = select(0.5 * (s * s + p * p), 1.0, front <= 0.0 || behind <= 0.0);
    return select(reflected, eta * eta * (1.0 - reflected), is_behind);
}

fn crossing_of(eta: f32, is_fresnel: bool, cosine: f32) -> Crossing {
    let is_behind = cosine > 0.0;
    let ratio = select(1.0, eta, is_behind);
    let refracted = select(-cosine, refracted_cosine(eta, cosine), is_behind);
    let bend = refracted - ratio * cosine;
    let slope = -ratio * bend / max(refracted, MIN_REFRACTED_COSINE);
    return Crossing(ratio, bend, slope, crossing_factor(eta, is_fresnel, cosine));
}

// The unit direction to the light, for the unit direction to a sample.
fn crossed_direction(crossing: Crossing, towards: vec3f, n: vec3f) -> vec3f {
    return crossing.ratio * towards + crossing.bend * n;
}

// How it changes along a side of a cell.
fn crossed_side(crossing: Crossing, side: vec3f, change: vec3f, towards: vec3f, n: vec3f, inverse_l: f32) -> vec3f {
    let turn = (side - towards * dot(towards, side)) * inverse_l;
    return crossing.ratio * turn + crossing.bend * change + crossing.slope * (dot(turn, n) + dot(towards, change)) * n;
}

// The widths of a bend's blur that is `lobe` wide where a mirror reflects: in the plane of incidence, and across it.
fn crossed_blur(crossing: Crossing, lobe: f32) -> vec2f {
    return lobe * vec2f(min(0.5 * abs(crossing.slope), MAX_REFRACTED_BLUR), 0.5 * abs(crossing.bend));
}

// For receivers that see the interface at a cosine between these.
fn crossing_bounds(eta: f32, is_fresnel: bool, least: f32, most: f32) -> CrossingBounds {
    let is_in_front = least < 0.0;
    let reflected = select(0.0, crossing_factor(eta, is_fresnel, min(most, 0.0)), is_in_front);
    let refracted = select(0.0, crossing_factor(eta, is_fresnel, most), most > 0.0);
    let factor = max(reflected, refracted);
    if most <= 0.0 || is_in_front {
        return CrossingBounds(1.0, 2.0, 1.0, factor, most > 0.0, false, 1.0, 1.0);
    }
    let steep = refracted_cosine(eta, most);
    let flattest = refracted_cosine(eta, least);
    let turns = max(crossing_turns(eta, most, steep), crossing_turns(eta, least, flattest));
    let is_unbounded = flattest <= MIN_REFRACTED_COSINE;
    return CrossingBounds(turns.x, turns.y, max(turns.x / eta, 1.0), factor, is_unbounded, true, steep, flattest);
}

// How much more than the direction and than the normal that of the refracted light turns.
fn crossing_turns(eta: f32, cosine: f32, refracted: f32) -> vec2f {
    let along = eta * cosine / max(refracted, MIN_REFRACTED_COSINE);
    return vec2f(max(along, eta), max(abs(along - 1.0), abs(refracted - eta * cosine)));
}

// A cone around the light for bundles of directions and normals of these radii; r is the light's direction for the axes of both.
fn crossed_cone(bounds: CrossingBounds, r: vec3f, towards: vec3f, n: vec3f, directions: f32, normals: f32) -> LightCone {
    let turned = min(bounds.per_direction * directions + bounds.per_normal * normals, WHOLE_SPHERE_RAD);
    let radius = select(turned, WHOLE_SPHERE_RAD, bounds.is_unbounded);
    // From the range of angles from the normal, which is narrower next to total reflection.
    let across = towards - dot(towards, n) * n;
    let sine = max(length(across), 1e-30);
    let azimuth = (directions + normals) / sine;
    if !bounds.is_behind || azimuth > MAX_AZIMUTH_SINE {
        return LightCone(r, radius);
    }
    let steep = vec2f(sqrt(max(1.0 - bounds.steep * bounds.steep, 0.0)), bounds.steep);
    let flattest = vec2f(sqrt(max(1.0 - bounds.flattest * bounds.flattest, 0.0)), bounds.flattest);
    let middle = normalize(steep + flattest);
    let half = HALF_ANGLE_PER_CHORD * 0.5 * length(steep - flattest);
    let of_angles = CONE_PER_AXES * length(vec2f(half, AZIMUTH_PER_SINE * azimuth)) + normals;
    if of_angles < radius {
        return LightCone(middle.x / sine * across + middle.y * n, of_angles);
    }
    return LightCone(r, radius);
}

// A cosine at a sample, times any length, by the sides on which its flags say that it lights receivers.
fn facing(flags: u32, dn: f32) -> f32 {
    let lights = flags & (LIGHTS_FRONT | LIGHTS_BACK);
    return select(select(-dn, dn, lights == LIGHTS_BACK), abs(dn), lights == (LIGHTS_FRONT | LIGHTS_BACK));
}

fn is_interface(flags: u32) -> bool {
    return REFRACTION && (flags & IS_INTERFACE) != 0u;
}

// Whether a sample has a visibility map for each side.
fn has_two_maps(flags: u32) -> bool {
    return is_interface(flags) || (flags & (LIGHTS_FRONT | LIGHTS_BACK)) == (LIGHTS_FRONT | LIGHTS_BACK);
}

// The side (1 or -1) of a sample on which a receiver lies.
fn receiver_side(flags: u32, dn: f32) -> f32 {
    return select(1.0, -1.0, has_two_maps(flags) && dn > 0.0);
}

// The side from which the light for this receiver comes: always in front of an interface.
fn sky_side(flags: u32, dn: f32) -> f32 {
    return select(receiver_side(flags, dn), 1.0, is_interface(flags));
}

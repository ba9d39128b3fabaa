// Follows photons from a light's view to the receivers. CPU twins: src/render/image_space/emission.rs, lights.rs and projection.rs.

#import constants
#import beam
#import frame
#import hits
#import image_hits
#import photons
#import plane
#import sobol

// A light's view, and the part of it that is emitted.
struct PhotonView {
    plane: Plane,
    // Of parallel views on a surface that faces the light, W/m²; of lamps where their beam is brightest, W/sr.
    power: vec3f,
    // Standard deviation of directional lights, radians, or radius of lamps, metres; 0: all light comes from the view's rays.
    extent: f32,
    lamp: Lamp,
    // The channels that count.
    channels: vec3f,
    // Rays of extended lights are turned about points at this distance along the view axis, metres.
    pivot: f32,
    // CHAIN_R and so on.
    chain: u32,
    // The channel whose refractive index counts.
    channel: u32,
    // It is a face of a cube, with a border whose photons have no flux.
    is_cube: u32,
    columns: u32,
    // Rows that are emitted, and which of them are accounted for.
    first_row: u32,
    rows: u32,
    first_own_row: u32,
    own_rows: u32,
    steps_per_watt: f32,
    // The ways are needed.
    has_ways: u32,
    // Of the points where photons leave extended lights.
    seed: u32,
    // Rows of the view.
    all_rows: u32,
    // The number of clusters; 0 where rows are emitted.
    cluster_count: u32,
    // Flux is that of Wyman and Davis 2006, Equations 3 and 9.
    is_papers: u32,
    // Where in their texels photons leave.
    offset: vec2f,
    // The radiance of directional lights is even up to twice the standard deviation, not a Gaussian.
    is_disc: u32,
}

// Photons find what they meet in images of what the light sees; otherwise they are traced.
override IN_IMAGES: bool = false;

@group(0) @binding(0) var<uniform> view: PhotonView;
@group(0) @binding(1) var<storage, read_write> photons: array<Photon>;
@group(0) @binding(2) var<storage, read_write> ways: array<PhotonWay>;
@group(0) @binding(3) var<storage, read_write> ledger: array<atomic<u32>>;
// Clusters of 2×2 photons, by their columns and rows in 16 bits each.
@group(0) @binding(4) var<storage, read> clusters: array<u32>;
@group(1) @binding(0) var<storage, read> surfaces: array<PhotonSurface>;
// Reflectance by the cosine of the angle of incidence, from 0 to 1, CURVE_POINTS for each curve.
@group(1) @binding(1) var<storage, read> reflectances: array<vec4f>;
@group(1) @binding(2) var<storage, read> sobol_vectors: array<vec2u>;
@group(1) @binding(3) var slide: texture_2d<f32>;

// A photon on its way.
struct Flight {
    origin: vec3f,
    direction: vec3f,
    flux: vec3f,
    is_alive: bool,
}

// What an interface does to a photon.
struct Division {
    reflectance: f32,
    // Of what is refracted, if anything is.
    direction: vec3f,
    is_refracted: bool,
}

@compute @workgroup_size(8, 8)
fn emit(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if view.cluster_count > 0u {
        emit_of_cluster(id.y * CLUSTER_ROW + id.x);
    } else if id.x < view.columns && id.y < view.rows {
        let is_own = id.y >= view.first_own_row && id.y < view.first_own_row + view.own_rows;
        emit_photon(id.y * view.columns + id.x, vec2u(id.x, view.first_row + id.y), is_own);
    }
    close_account(local_index);
}

fn emit_of_cluster(index: u32) {
    if index < 4u * view.cluster_count {
        let cluster = clusters[index / 4u];
        let texel = 2u * vec2u(cluster & 0xffffu, cluster >> 16u) + vec2u(index & 1u, index >> 1u & 1u);
        emit_photon(index, texel, view.own_rows > 0u);
    } else if index < CLUSTER_ROW * view.rows {
        photons[index] = no_photon();
    }
}

fn no_photon() -> Photon {
    return Photon(vec3f(0.0), NO_OBJECT, vec3f(0.0), NO_OBJECT, 0u, 0u, 0.0, 0.0);
}

// Follows the photon of a texel of the view.
fn emit_photon(index: u32, texel: vec2u, is_own: bool) {
    var photon = no_photon();
    var flight = flight_from_light(texel);
    let in_view = (vec2f(texel) + view.offset) / vec2f(f32(view.columns), f32(view.all_rows));
    var start: Hit;
    if IN_IMAGES {
        start = first_in_image(in_view, flight.direction);
    } else {
        start = traced_hit(flight, is_own);
    }
    if start.object != NO_OBJECT {
        let distance = length(start.position - flight.origin);
        flight = scattered(flight, start);
        if flight.is_alive {
            var way = PhotonWay(start.position, 0.0, start.normal, start.position, start.normal);
            if view.chain != CHAIN_TTTT {
                account_if_own(CAST, flight.flux, is_own);
            }
            flight = passed_through_solids(flight, start.object, &way, is_own);
            if flight.is_alive {
                photon = land(flight, is_own);
                photon.caster = start.object;
                if is_own && photon.object != NO_OBJECT {
                    add_to_account(LANDED, Steps(1u, 0u));
                }
                photon.inverse_before = select(1.0 / max(distance, 1e-30), 0.0, view.plane.is_parallel != 0u);
                if view.has_ways != 0u {
                    ways[index] = way;
                }
            }
        }
    }
    photons[index] = photon;
}

fn account_if_own(entry: u32, flux: vec3f, is_own: bool) {
    if is_own {
        account_for(entry, sum_of_channels(flux), view.steps_per_watt);
    }
}

// The ray of a photon, and its flux.
fn flight_from_light(place: vec2u) -> Flight {
    let at = on_plane_at(view.plane, vec2f(place) + view.offset);
    let offset = at.x * view.plane.right + at.y * view.plane.down;
    let origin_in_light = disc_point(place);
    if view.plane.is_parallel != 0u {
        let flux = view.power * view.plane.texel * view.plane.texel;
        return directional(Flight(view.plane.origin + offset, view.plane.forward, flux, true), origin_in_light);
    }
    let direction = normalize(view.plane.forward + offset);
    let middle = on_plane_at(view.plane, vec2f(place) + 0.5);
    var flux = view.power * beam_transmittance(view.lamp, direction) * solid_angle(middle);
    if view.is_cube != 0u && max(abs(at.x), abs(at.y)) > 1.0 {
        flux = vec3f(0.0);
    }
    if view.extent == 0.0 {
        return Flight(view.plane.origin, direction, flux, true);
    }
    let frame = tangent_frame(direction);
    let origin = view.plane.origin + view.extent * (origin_in_light.x * frame.u + origin_in_light.y * frame.v);
    let pivot = view.plane.origin + max(view.pivot, 2.0 * view.extent) * direction;
    return Flight(origin, normalize(pivot - origin), flux, true);
}

// A point of the unit disc.
fn disc_point(place: vec2u) -> vec2f {
    if view.extent == 0.0 {
        return vec2f(0.0);
    }
    let index = place.y * view.columns + place.x;
    let part = sobol_point(index & 0xffffu, view.seed + (index >> 16u));
    let angle = 6.28318531 * part.y;
    return sqrt(part.x) * vec2f(cos(angle), sin(angle));
}

// A ray of a directional light with an extent; the grid is seen at an angle.
fn directional(central: Flight, place: vec2f) -> Flight {
    if view.extent == 0.0 {
        return central;
    }
    let towards = -central.direction;
    let frame = tangent_frame(towards);
    let r = min(length(place), 1.0 - 1e-6);
    let deviations = select(sqrt(-2.0 * log(1.0 - r * r)), 2.0 * r, view.is_disc != 0u);
    let angle = min(view.extent * deviations, MAX_SPREAD_RAD);
    let across = select(vec2f(1.0, 0.0), place / max(length(place), 1e-30), r > 0.0);
    let back = normalize(cos(angle) * towards + sin(angle) * (across.x * frame.u + across.y * frame.v));
    let factor = select(1.0, sin(angle) / angle, angle > 0.0);
    let cosine = dot(back, towards);
    let pivot = central.origin + view.pivot * central.direction;
    return Flight(pivot + view.pivot / cosine * back, -back, central.flux * factor * cosine, true);
}

// The solid angle of a texel around a place, sr, by four points (Gauss–Legendre): differences of arctangents would lose all digits.
fn solid_angle(at: vec2f) -> f32 {
    let step = 0.28867513 * view.plane.texel;
    let x2 = vec2f((at.x - step) * (at.x - step), (at.x + step) * (at.x + step));
    let y2 = vec2f((at.y - step) * (at.y - step), (at.y + step) * (at.y + step));
    let squared = 1.0 + vec4f(x2.x + y2.x, x2.y + y2.x, x2.x + y2.y, x2.y + y2.y);
    let density = 1.0 / (squared * sqrt(squared));
    return 0.25 * view.plane.texel * view.plane.texel * (density.x + density.y + density.z + density.w);
}

// What a photon meets by its ray; NO_OBJECT: nothing.
fn traced_hit(flight: Flight, is_own: bool) -> Hit {
    let met = trace_some(free_ray(flight.origin), flight.direction, ray_uniforms.offset, 3e38, false, MEETS_FOR_LIGHT);
    if is_own && !met.is_complete {
        add_to_account(UNFINISHED, Steps(1u, 0u));
    }
    if met.triangle == NO_TRIANGLE {
        return Hit(NO_OBJECT, vec3f(0.0), vec3f(0.0), vec3f(0.0), false);
    }
    return describe(met, flight.direction);
}

// What the first surface makes of a photon.
fn scattered(flight: Flight, hit: Hit) -> Flight {
    let surface = surfaces[hit.object];
    var factor = vec3f(0.0);
    var direction = flight.direction;
    if view.chain == CHAIN_R {
        direction = reflected(flight.direction, hit);
        if (surface.flags & (REFLECTS_IN_FRONT | REFLECTS_BEHIND)) != 0u {
            if (surface.flags & select(REFLECTS_BEHIND, REFLECTS_IN_FRONT, hit.is_front)) != 0u {
                factor = reflectance_at(surface.curve, -dot(flight.direction, hit.normal));
            }
        } else if hit.is_front && (surface.flags & IS_FRESNEL_SURFACE) != 0u {
            for (var channel = 0u; channel < 3u; channel++) {
                factor[channel] = divided(surface, surface.eta[channel], hit, flight.direction).reflectance;
            }
        }
    } else if hit.is_front && (surface.flags & select(IS_SOLID, IS_SURFACE, view.chain == CHAIN_T)) != 0u {
        let division = divided(surface, surface.eta[view.channel], hit, flight.direction);
        if division.is_refracted {
            direction = division.direction;
            factor = vec3f(1.0 - division.reflectance);
        }
    }
    factor *= view.channels;
    return Flight(hit.position, direction, flight.flux * factor, any(factor != vec3f(0.0)));
}

// A photon that has entered a closed object leaves it and, in chains of four refractions, passes another one. What does not get to the
// second one is lost to light that is refracted twice.
fn passed_through_solids(entered: Flight, first: u32, way: ptr<function, PhotonWay>, is_own: bool) -> Flight {
    let crossings = select(select(0u, 1u, view.chain == CHAIN_TT), 3u, view.chain == CHAIN_TTTT);
    var flight = entered;
    var object = first;
    for (var k = 0u; k < crossings; k++) {
        let is_counted = is_own && (crossings == 1u || k > 0u);
        flight = crossed_next(flight, k == 1u, &object, way, is_counted);
        if !flight.is_alive {
            break;
        }
    }
    return flight;
}

// A photon beyond the interface that it meets next: that of the closed object that it leaves or, with `enters`, of another one.
fn crossed_next(
    flight: Flight, enters: bool, object: ptr<function, u32>, way: ptr<function, PhotonWay>, is_counted: bool,
) -> Flight {
    let nothing = Flight(flight.origin, flight.direction, vec3f(0.0), false);
    let hit = next_hit(flight, select(TO_LEAVE, TO_ENTER, enters), *object, is_counted);
    var lost = TOTALLY_REFLECTED;
    var division = Division(1.0, vec3f(0.0), false);
    if hit.object == NO_OBJECT {
        lost = MISSED;
    } else if (surfaces[hit.object].flags & IS_SOLID) == 0u || hit.is_front != enters {
        lost = NOT_RECEIVED;
    } else {
        let surface = surfaces[hit.object];
        division = divided(surface, surface.eta[view.channel], hit, flight.direction);
    }
    let passed = (1.0 - division.reflectance) * flight.flux;
    if enters {
        account_if_own(CAST, passed, is_counted);
    } else {
        account_if_own(lost, division.reflectance * flight.flux, is_counted);
    }
    if !division.is_refracted {
        return nothing;
    }
    (*way).within += length(hit.position - flight.origin);
    if !enters {
        (*way).last = hit.position;
        (*way).last_normal = hit.normal;
    }
    *object = hit.object;
    return Flight(hit.position, division.direction, passed, true);
}

// What a photon meets next, by its ray or in images.
fn next_hit(flight: Flight, purpose: u32, object: u32, is_own: bool) -> Hit {
    if IN_IMAGES {
        return next_in_images(flight.origin, flight.direction, purpose, object);
    }
    return traced_hit(flight, is_own);
}

fn land(flight: Flight, is_own: bool) -> Photon {
    let hit = next_hit(flight, TO_LAND, NO_OBJECT, is_own);
    if hit.object == NO_OBJECT {
        account_if_own(MISSED, flight.flux, is_own);
        return no_photon();
    }
    if (surfaces[hit.object].flags & RECEIVES_PHOTONS) == 0u {
        account_if_own(NOT_RECEIVED, flight.flux, is_own);
        return no_photon();
    }
    let beyond = length(hit.position - flight.origin);
    let normal = packed_unit(hit.face_normal);
    var flux = flight.flux;
    if view.is_papers != 0u {
        let undeflected = select(normalize(hit.position - view.plane.origin), view.plane.forward, view.plane.is_parallel != 0u);
        let ratio = dot(flight.direction, hit.face_normal) / -max(-dot(undeflected, hit.face_normal), MIN_DIRECT_COSINE);
        flux *= ratio;
    }
    return Photon(hit.position, hit.object, flux, NO_OBJECT, normal, packed_unit(flight.direction), 0.0, beyond);
}

// The mirrored direction; an interpolated normal may mirror it through the triangle at grazing angles.
fn reflected(direction: vec3f, hit: Hit) -> vec3f {
    let mirrored = direction - 2.0 * dot(direction, hit.normal) * hit.normal;
    let height = dot(mirrored, hit.face_normal);
    return normalize(mirrored + max(MIN_HEIGHT - height, 0.0) * hit.face_normal);
}

fn reflectance_at(curve: u32, cosine: f32) -> vec3f {
    let place = saturate(cosine) * f32(CURVE_POINTS - 1u);
    let first = min(u32(place), CURVE_POINTS - 2u);
    let start = curve * CURVE_POINTS + first;
    return mix(reflectances[start].rgb, reflectances[start + 1u].rgb, place - f32(first));
}

// A photon divided at an interface, for light of the relative refractive index `eta`. CPU twin: src/render/stages/refraction.rs.
fn divided(surface: PhotonSurface, eta: f32, hit: Hit, direction: vec3f) -> Division {
    // The index of the medium that the photon enters over that of the one that it leaves.
    let entered = select(1.0 / eta, eta, hit.is_front);
    let cosine = saturate(-dot(direction, hit.normal));
    let beyond2 = 1.0 - (1.0 - cosine * cosine) / (entered * entered);
    if beyond2 <= 0.0 {
        return Division(1.0, vec3f(0.0), false);
    }
    let beyond = sqrt(beyond2);
    let s = (cosine - entered * beyond) / (cosine + entered * beyond);
    let p = (entered * cosine - beyond) / (entered * cosine + beyond);
    let reflectance = select(0.0, 0.5 * (s * s + p * p), (surface.flags & IS_FRESNEL_SURFACE) != 0u);
    let bent = normalize(direction / entered + (cosine / entered - beyond) * hit.normal);
    // An interpolated normal may refract back through the triangle, at grazing angles.
    let depth = -dot(bent, hit.face_normal);
    return Division(reflectance, normalize(bent - max(MIN_HEIGHT - depth, 0.0) * hit.face_normal), true);
}

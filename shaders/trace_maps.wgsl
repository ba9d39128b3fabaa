// Traces visibility maps, a workgroup for each. CPU twin, and what is stored: src/sums/pinhole/visibility.rs.

#import constants
#import frame
#import rays

// One side of a sample.
struct Hemisphere {
    // World position, metres.
    position: vec3f,
    // From end to end, metres.
    extent: f32,
    // Unit normal of the sample.
    normal: vec3f,
    // Four times the object's index; plus 2 where it looks to the side that the mesh's normals point to; plus 1 on the side that the
    // sample's normal does not point to.
    object_sides: u32,
    // How far the texels are shifted.
    texel_jitter: vec2f,
}

struct MapUniforms {
    // The first map of this dispatch.
    first_map: u32,
    resolution: u32,
    // Of the way between texels that see different things.
    bisections: u32,
}

@group(0) @binding(0) var<uniform> maps: MapUniforms;
@group(0) @binding(1) var<storage, read> hemispheres: array<Hemisphere>;
@group(0) @binding(2) var<storage, read_write> planes: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> sky_masks: array<u32>;
// See `load_doubt` in shared/doubts.wgsl.
@group(0) @binding(4) var doubts: texture_storage_2d<rg32uint, write>;
// Rays that the adapter did not let be finished.
@group(0) @binding(5) var<storage, read_write> unfinished: atomic<u32>;

// What a texel's ray hit, in the sample's frame.
struct Occluder {
    // NO_OBJECT: the environment.
    object: u32,
    point: vec3f,
    // Towards the sample.
    normal: vec3f,
    // m with m·l = 1 for the points l of the plane, 1/m.
    plane: vec3f,
}

const MAX_RESOLUTION: u32 = 32u;

// By texel: the triangle and the first texel of its object, and how far away it was hit.
var<workgroup> triangles: array<vec2u, MAX_RESOLUTION * MAX_RESOLUTION>;
var<workgroup> distances: array<f32, MAX_RESOLUTION * MAX_RESOLUTION>;

// A hemisphere and its frame; the last axis points to the side in question.
struct View {
    origin: RayOrigin,
    axes: mat3x3f,
    texel_jitter: vec2f,
}

fn view_of(hemisphere: Hemisphere) -> View {
    let n = hemisphere.normal;
    let frame = tangent_frame(n);
    let is_front = (hemisphere.object_sides & 2u) != 0u;
    let is_back = (hemisphere.object_sides & 1u) != 0u;
    let origin = RayOrigin(
        hemisphere.position, hemisphere.object_sides >> 2u, select(-1.0, 1.0, is_front), hemisphere.extent,
    );
    return View(origin, mat3x3f(frame.u, frame.v, select(n, -n, is_back)), hemisphere.texel_jitter);
}

@compute @workgroup_size(MAP_WORKGROUP_SIZE)
fn trace_map(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let map = maps.first_map + workgroup.x;
    let view = view_of(hemispheres[map]);
    let n = maps.resolution;
    for (var k = lane; k < n * n; k += MAP_WORKGROUP_SIZE) {
        let hit = trace(view.origin, view.axes * direction_at(place_of(k, view)), 3e38, false);
        triangles[k] = vec2u(hit.triangle, hit.instance);
        distances[k] = hit.distance;
        if !hit.is_complete {
            atomicAdd(&unfinished, 1u);
        }
    }
    workgroupBarrier();
    for (var k = lane; k < n * n; k += MAP_WORKGROUP_SIZE) {
        store_texel(map, k, view);
    }
    for (var row = lane; row < n; row += MAP_WORKGROUP_SIZE) {
        var mask = 0u;
        for (var i = 0u; i < n; i++) {
            mask |= select(0u, 1u << i, triangles[row * n + i].x == NO_TRIANGLE);
        }
        sky_masks[map * n + row] = mask;
    }
}

fn store_texel(map: u32, k: u32, view: View) {
    let own = occluder_at(k, view);
    let depths = depths_around(k, own, view);
    let edges = edge_between(k, 0u, own, view) << 8u | edge_between(k, 1u, own, view);
    let behind = (bitcast<u32>(BEHIND + depths.y) & 0xffff0000u) | edges;
    let index = map * maps.resolution * maps.resolution + k;
    planes[index] = vec4f(own.plane, bitcast<f32>(behind));
    // Rounding adds to m·l; no distance is the same throughout a texel.
    let is_curved = own.object != NO_OBJECT && depths.y - depths.x >= BEHIND;
    let reach2 = select(3e38, 1.5625 * dot(own.point, own.point), is_curved);
    let doubt = vec2u(
        bitcast<u32>(1.0 + 1.2 * BEHIND + depths.x), (bitcast<u32>(reach2) & 0xffff0000u) | (own.object & 0xffffu),
    );
    textureStore(doubts, vec2u(index % DOUBTS_ROW, index / DOUBTS_ROW), vec4u(doubt, 0u, 0u));
}

// Centre of texel k on the map.
fn place_of(k: u32, view: View) -> vec2f {
    let n = maps.resolution;
    return (vec2f(f32(k % n), f32(k / n)) + 0.5 + view.texel_jitter) / f32(n);
}

// The direction of a place on a map, in the sample's frame; never quite at the horizon.
fn direction_at(place: vec2f) -> vec3f {
    let a = 2.0 * clamp(place, vec2f(0.002), vec2f(0.998)) - 1.0;
    let x = 0.5 * (a.x + a.y);
    let y = 0.5 * (a.x - a.y);
    return normalize(vec3f(x, y, max(1.0 - abs(x) - abs(y), 1e-4)));
}

fn occluder_at(k: u32, view: View) -> Occluder {
    let hit = RayHit(distances[k], triangles[k].x, triangles[k].y, vec2f(0.0), true, 0u);
    return occluder(hit, direction_at(place_of(k, view)), view);
}

// What a ray in a direction of the sample's frame hit.
fn occluder(hit: RayHit, direction: vec3f, view: View) -> Occluder {
    if hit.triangle == NO_TRIANGLE {
        return Occluder(NO_OBJECT, vec3f(0.0), vec3f(0.0), vec3f(0.0));
    }
    var normal = normalize(face_normal(hit)) * view.axes;
    normal = select(normal, -normal, dot(normal, direction) > 0.0);
    let point = hit.distance * direction;
    // At grazing angles the plane almost passes through the sample and would occlude nothing beyond the point.
    let height = min(dot(point, normal), -MIN_OCCLUDER_COSINE * hit.distance);
    return Occluder(load_instance(hit.instance).object, point, normal, normal / height);
}

// How far a smooth surface falls away from its plane at another point, at most, relative to the plane's distance: no more than its
// normals turn on the way. Anything further is another part of the surface.
fn fall_to(a: Occluder, b: Occluder) -> f32 {
    return length(a.plane) * distance(a.point, b.point) * distance(a.normal, b.normal);
}

// How far the same surface lies in front of (negative) and behind texel k's plane at the neighbouring texels, relative to the plane's
// distance.
fn depths_around(k: u32, own: Occluder, view: View) -> vec2f {
    var depths = vec2f(0.0);
    if own.object == NO_OBJECT {
        return depths;
    }
    let n = i32(maps.resolution);
    let place = vec2i(i32(k) % n, i32(k) / n);
    for (var step = 0; step < 9; step++) {
        let neighbour = place + vec2i(step % 3, step / 3) - 1;
        if any(neighbour < vec2i(0)) || any(neighbour >= vec2i(n)) || step == 4 {
            continue;
        }
        let other = occluder_at(u32(neighbour.y * n + neighbour.x), view);
        let depth = dot(own.plane, other.point) - 1.0;
        if other.object == own.object && abs(depth) <= fall_to(own, other) {
            depths = vec2f(min(depths.x, depth), max(depths.y, depth));
        }
    }
    return depths;
}

// Whether two texels see one smooth surface, or both the environment.
fn is_same_surface(a: Occluder, b: Occluder) -> bool {
    return a.object == b.object
        && (a.object == NO_OBJECT
            || (abs(dot(a.plane, b.point) - 1.0) <= fall_to(a, b) + BEHIND
                && abs(dot(b.plane, a.point) - 1.0) <= fall_to(b, a) + BEHIND));
}

// Distance of a hit from the surface that a texel sees, relative to the plane's distance.
fn mismatch(texel: Occluder, hit: Occluder) -> f32 {
    if texel.object == NO_OBJECT || hit.object == NO_OBJECT {
        return select(3e38, 0.0, texel.object == hit.object);
    }
    return abs(dot(texel.plane, hit.point) - 1.0);
}

// Where between texel k and the next along an axis what is hit changes, and how softly, in eight bits.
fn edge_between(k: u32, axis: u32, own: Occluder, view: View) -> u32 {
    let n = maps.resolution;
    let next = k + select(1u, n, axis == 1u);
    if select(k % n, k / n, axis == 1u) + 1u == n {
        return MIDDLE_EDGE;
    }
    let other = occluder_at(next, view);
    if is_same_surface(own, other) {
        return MIDDLE_EDGE;
    }
    var low = 0.0;
    var high = 1.0;
    for (var step = 0u; step < maps.bisections; step++) {
        let middle = 0.5 * (low + high);
        let direction = direction_at(mix(place_of(k, view), place_of(next, view), middle));
        let hit = trace(view.origin, view.axes * direction, 3e38, false);
        if !hit.is_complete {
            atomicAdd(&unfinished, 1u);
        }
        let there = occluder(hit, direction, view);
        if mismatch(own, there) <= mismatch(other, there) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return u32(32.0 * (low + high)) << 2u | softness(own, other, view);
}

// The width of a penumbra: an edge shifts against what is behind it when seen from end to end of the sample.
fn softness(a: Occluder, b: Occluder, view: View) -> u32 {
    let angle = view.origin.extent * abs(nearness(a) - nearness(b));
    // A half-space has 2π sr.
    let texel = sqrt(6.2831853) / f32(maps.resolution);
    return u32(min(round(log2(max(4.0 * angle / texel, 1.0))), 2.0));
}

fn nearness(occluder: Occluder) -> f32 {
    return select(inverseSqrt(dot(occluder.point, occluder.point)), 0.0, occluder.object == NO_OBJECT);
}

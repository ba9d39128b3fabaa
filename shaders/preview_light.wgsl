// Light on the points that pixels of a preview see: at nodes some pixels apart, between them interpolated along surfaces, and computed
// where it cannot be, first half as far apart, then in every pixel. The caustic is added by the gather, between these passes. CPU twin: src/render/engine/preview/nodes.rs and mod.rs.

#import preview
#import hits
#import light_direction
#import preview_gloss
#import preview_near_light

@group(0) @binding(0) var<uniform> preview: PreviewUniforms;
// Of one kind, one or none in each pixel.
@group(0) @binding(1) var<storage, read> points: array<SurfacePoint>;
// W/m², of glossy points W/(m²·sr), and one of the states below.
@group(0) @binding(2) var<storage, read_write> light: array<vec4f>;
@group(0) @binding(3) var<storage, read> directions: array<LightDirection>;
@group(0) @binding(4) var irradiance_cube: texture_cube<f32>;
@group(0) @binding(5) var trilinear: sampler;
// Rays that the adapter did not let be finished.
@group(0) @binding(6) var<storage, read_write> unfinished: atomic<u32>;
@group(0) @binding(7) var<storage, read> objects: array<PreviewObject>;
@group(0) @binding(8) var environment: texture_cube<f32>;
@group(0) @binding(9) var<storage, read> near_light: array<vec4u>;

// The other layer: for points in mirrors, what the camera sees directly, and the light there.
@group(1) @binding(0) var<storage, read> other_points: array<SurfacePoint>;
@group(1) @binding(1) var<storage, read> other_light: array<vec4f>;

// Receivers of the gather, and what it gathers.
@group(2) @binding(0) var receiver_positions: texture_storage_2d<rgba32float, write>;
@group(2) @binding(1) var receiver_normals: texture_storage_2d<rgba32float, write>;
@group(2) @binding(2) var caustic: texture_2d<f32>;
@group(2) @binding(3) var<uniform> grid: PreviewGrid;

struct PreviewGrid {
    // Pixels from receiver to receiver.
    spacing: u32,
    // The same of the grid before, whose light is known.
    coarser: u32,
}

const UNKNOWN: f32 = 0.0;
const KNOWN: f32 = 1.0;
// Direct light is known; the caustic is what the gathers find next, one for each light.
const COMPUTED: f32 = 2.0;

@compute @workgroup_size(8, 8)
fn begin(@builtin(global_invocation_id) id: vec3u) {
    if all(id.xy < preview.size) {
        light[pixel_index(id.xy)] = vec4f(0.0, 0.0, 0.0, UNKNOWN);
    }
}

// Takes over light of places that the camera sees directly, too.
@compute @workgroup_size(8, 8)
fn begin_behind_mirrors(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= preview.size) {
        return;
    }
    let pixel = pixel_index(id.xy);
    light[pixel] = vec4f(0.0, 0.0, 0.0, UNKNOWN);
    let point = points[pixel];
    if point.object == NO_OBJECT {
        return;
    }
    let offset = point.position - preview.camera_position;
    let depth = dot(offset, preview.camera_forward);
    if depth <= 0.0 {
        return;
    }
    let half_height = preview.half_height * select(1.0, depth, preview.is_perspective != 0u);
    let p = vec2f(dot(offset, preview.camera_right), dot(offset, preview.camera_up)) / half_height;
    let size = vec2f(preview.size);
    let at = 0.5 * vec2f(p.x * size.y + size.x, size.y - p.y * size.y);
    if any(at < vec2f(0.0)) || any(at >= size) {
        return;
    }
    let there = pixel_index(vec2u(at));
    let seen = other_points[there];
    let width = 2.0 * half_height / size.y;
    if seen.object == point.object && (seen.flags & (IS_FRONT | IS_GLOSSY)) == (point.flags & IS_FRONT)
        && distance(seen.position, point.position) <= MAX_PIXELS_APART * width
        && dot(seen.normal, point.normal) >= MIN_SEEN_COSINE {
        light[pixel] = vec4f(other_light[there].rgb, KNOWN);
    }
}

// Direct light at nodes, which become the receivers of the gather.
@compute @workgroup_size(8, 8)
fn light_nodes(@builtin(global_invocation_id) id: vec3u) {
    let place = id.xy * grid.spacing;
    if any(place >= preview.size) {
        return;
    }
    let pixel = pixel_index(place);
    let point = points[pixel];
    let is_open = point.object != NO_OBJECT && light[pixel].w == UNKNOWN;
    write_receiver(id.xy, point, is_open);
    if is_open {
        light[pixel] = vec4f(direct_and_gloss(point), COMPUTED);
    }
}

// Light between the pixels of the coarser grid, or direct light where theirs does not tell.
@compute @workgroup_size(8, 8)
fn light_between(@builtin(global_invocation_id) id: vec3u) {
    let place = id.xy * grid.spacing;
    if any(place >= preview.size) {
        return;
    }
    let pixel = pixel_index(place);
    let point = points[pixel];
    if point.object == NO_OBJECT || light[pixel].w != UNKNOWN {
        write_receiver(id.xy, point, false);
        if light[pixel].w == COMPUTED {
            light[pixel].w = KNOWN;
        }
        return;
    }
    let found = interpolated(place, point);
    write_receiver(id.xy, point, found.w == UNKNOWN);
    if found.w == UNKNOWN {
        light[pixel] = vec4f(direct_and_gloss(point), COMPUTED);
    } else {
        light[pixel] = found;
    }
}

// What was gathered of one light. The gather leaves nothing where there is no receiver.
@compute @workgroup_size(8, 8)
fn add_caustic(@builtin(global_invocation_id) id: vec3u) {
    let place = id.xy * grid.spacing;
    if any(place >= preview.size) {
        return;
    }
    let pixel = pixel_index(place);
    if light[pixel].w == COMPUTED {
        let gathered = preview.caustic_gain * textureLoad(caustic, id.xy, 0).rgb;
        light[pixel] = vec4f(light[pixel].rgb + reflected(points[pixel], gathered), COMPUTED);
    }
}

fn write_receiver(texel: vec2u, point: SurfacePoint, is_open: bool) {
    let receives = is_open && (point.flags & RECEIVES) != 0u;
    textureStore(receiver_positions, texel, vec4f(point.position, select(-1.0, f32(point.object), receives)));
    textureStore(receiver_normals, texel, vec4f(point.normal, 0.0));
}

fn direct_and_gloss(point: SurfacePoint) -> vec3f {
    let near = near_light_on(point);
    let direct = reflected(point, direct_light(point) + near.irradiance);
    if (point.flags & IS_GLOSSY) == 0u {
        return direct;
    }
    let lobe_of_near = max(near.reflected - reflected(point, near.irradiance), vec3f(0.0));
    return direct + environment_in_lobe(point, objects[point.object]) + lobe_of_near;
}

// An irradiance or, of glossy points, what they reflect of it diffusely.
fn reflected(point: SurfacePoint, irradiance: vec3f) -> vec3f {
    if (point.flags & IS_GLOSSY) == 0u {
        return irradiance;
    }
    return irradiance * mean_diffuse(objects[point.object], dot(point.normal, view_of(point)));
}

// The unoccluded irradiance times the part of it that shadow rays find unblocked.
fn direct_light(point: SurfacePoint) -> vec3f {
    let open = preview.irradiance_scale
        * textureSampleLevel(irradiance_cube, trilinear, environment_from_world(point.normal), 0.0).rgb;
    if all(open == vec3f(0.0)) {
        return open;
    }
    var arriving = vec3f(0.0);
    var all_light = vec3f(0.0);
    for (var k = 0u; k < preview.direction_count; k++) {
        let direction = directions[k].direction;
        let cosine = dot(direction, point.normal);
        if cosine <= 0.0 {
            continue;
        }
        let irradiance = cosine * directions[k].radiance;
        all_light += irradiance;
        let hit = trace(free_ray(point.position), direction, 3e38, true);
        if !hit.is_complete {
            atomicAdd(&unfinished, 1u);
        }
        if hit.triangle == NO_TRIANGLE {
            arriving += irradiance;
        }
    }
    // Where there is no light, there is no shadow.
    return open * select(vec3f(1.0), arriving / all_light, all_light > vec3f(0.0));
}

// The light in a pixel from the nodes around it, if there are enough on the same surface and they agree; from nodes one step farther,
// if the four around it lie on other surfaces. UNKNOWN if there is none.
fn interpolated(pixel: vec2u, own: SurfacePoint) -> vec4f {
    let step = grid.coarser;
    let corner = pixel / step * step;
    let part = vec2f(pixel - corner) / f32(step);
    var sum = vec3f(0.0);
    var weights = 0.0;
    var least = 3e38;
    var most = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let right = k & 1u;
        let down = k >> 1u;
        let weight = select(1.0 - part.x, part.x, right == 1u) * select(1.0 - part.y, part.y, down == 1u);
        let place = corner + step * vec2u(right, down);
        if weight == 0.0 || any(place >= preview.size) {
            continue;
        }
        let node = pixel_index(place);
        if light[node].w == UNKNOWN || !is_same_surface(own, points[node]) {
            continue;
        }
        let there = light[node].rgb;
        sum += weight * there;
        weights += weight;
        let brightness = there.r + there.g + there.b;
        least = min(least, brightness);
        most = max(most, brightness);
    }
    if weights < MIN_WEIGHT {
        return beyond_nodes(pixel / step, own);
    }
    if most - least > MAX_CONTRAST * most {
        return vec4f(0.0, 0.0, 0.0, UNKNOWN);
    }
    return vec4f(sum / weights, KNOWN);
}

// The mean over the nodes of the same surface in the square of four by four around a pixel.
fn beyond_nodes(cell: vec2u, own: SurfacePoint) -> vec4f {
    var sum = vec3f(0.0);
    var weights = 0.0;
    for (var k = 0u; k < 16u; k++) {
        let node_of = vec2i(cell) + vec2i(i32(k % 4u), i32(k / 4u)) - 1;
        let place = node_of * i32(grid.coarser);
        if any(place < vec2i(0)) || any(place >= vec2i(preview.size)) {
            continue;
        }
        let node = pixel_index(vec2u(place));
        let other = points[node];
        if light[node].w != UNKNOWN && is_same_surface(own, other) {
            let step = other.position - own.position;
            let weight = 1.0 / (1e-12 + dot(step, step));
            sum += weight * light[node].rgb;
            weights += weight;
        }
    }
    if weights > 0.0 {
        return vec4f(sum / weights, KNOWN);
    }
    return vec4f(0.0, 0.0, 0.0, UNKNOWN);
}

fn is_same_surface(own: SurfacePoint, other: SurfacePoint) -> bool {
    let step = other.position - own.position;
    return own.object == other.object && (own.flags & IS_FRONT) == (other.flags & IS_FRONT) && own.path == other.path
        && dot(own.normal, other.normal) >= MIN_NORMAL_COSINE
        && abs(dot(step, own.normal)) <= MAX_OFF_PLANE * length(step);
}

// The radiance that pixels of a preview show, and the exposure that suits it. CPU twin: src/render/engine/preview/shading.rs.

#import preview
#import hits
#import cube

@group(0) @binding(0) var<uniform> preview: PreviewUniforms;
@group(0) @binding(1) var<storage, read> surfaces: array<SurfacePoint>;
@group(0) @binding(2) var<storage, read> mirrored: array<SurfacePoint>;
@group(0) @binding(3) var<storage, read> escapes: array<Escape>;
@group(0) @binding(4) var<storage, read> own_light: array<vec4f>;
@group(0) @binding(5) var<storage, read> mirrored_light: array<vec4f>;
// Radiance of surfaces, and of the environment where the camera sees it directly, pixel by pixel.
@group(0) @binding(6) var<storage, read_write> shaded: array<vec4f>;
@group(0) @binding(7) var environment: texture_cube<f32>;
// What the eye sees of the environment without emitters.
@group(0) @binding(8) var background: texture_cube<f32>;
@group(0) @binding(9) var trilinear: sampler;
@group(0) @binding(10) var<storage, read> objects: array<PreviewObject>;
// How many pixels have a luminance, by the first bits of its number: of surfaces, then of everything.
@group(0) @binding(11) var<storage, read_write> histogram: array<atomic<u32>>;
// What a medium scatters along some rays, and the lengths of their ways through it.
@group(0) @binding(12) var scattered: texture_2d<f32>;

// A whole picture takes sixteen microfacets for a lobe, a preview one look-up, which is as much wider.
const ROUGH_WIDTH: f32 = 4.0;

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= preview.size) {
        return;
    }
    let pixel = pixel_index(id.xy);
    var surface = surfaces[pixel].factor * own_light[pixel].rgb + mirrored[pixel].factor * mirrored_light[pixel].rgb;
    var behind = vec3f(0.0);
    let escape = escapes[pixel];
    if escape.alpha == EMITTED {
        behind = escape.factor;
    } else if escape.alpha != NO_ESCAPE {
        behind = escape.factor * environment_at(escape, footprint(id.xy, escape));
    }
    if escape.path != 0u {
        surface += behind;
        behind = vec3f(0.0);
    }
    if preview.scattering_spacing != 0u {
        surface += scattered_at(id.xy, way_through_medium(surfaces[pixel]));
    }
    surface *= preview.intensity;
    behind *= preview.intensity;
    shaded[2u * pixel] = vec4f(surface, 0.0);
    shaded[2u * pixel + 1u] = vec4f(behind, 0.0);
    if (preview.exposure_flags & IS_METERED) != 0u {
        if any(surface != vec3f(0.0)) {
            atomicAdd(&histogram[2u * HISTOGRAM_BINS], 1u);
            count(surface, 0u);
        }
        count(surface + behind, HISTOGRAM_BINS);
    }
}

// From the camera to what it sees first, or as far as anything is seen.
fn way_through_medium(point: SurfacePoint) -> f32 {
    if (point.flags & IS_FIRST) == 0u {
        return preview.sight;
    }
    let offset = point.position - preview.camera_position;
    let distance = select(dot(offset, preview.camera_forward), length(offset), preview.is_perspective != 0u);
    return min(distance, preview.sight);
}

// Scattered light in a pixel whose way through the medium is so long. CPU twin: src/render/engine/preview/scattering.rs.
fn scattered_at(pixel: vec2u, way: f32) -> vec3f {
    let last = textureDimensions(scattered) - 1u;
    let node = pixel / preview.scattering_spacing;
    let part = vec2f(pixel % preview.scattering_spacing) / f32(preview.scattering_spacing);
    var sum = vec3f(0.0);
    var weights = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let step = vec2u(k & 1u, k >> 1u);
        let ray = textureLoad(scattered, min(node + step, last), 0);
        let between = select(1.0 - part, part, step == vec2u(1u));
        let ratio = max(way, ray.w) / max(min(way, ray.w), 1.2e-38);
        let likeness = max((MAX_LENGTH_RATIO - ratio) / (MAX_LENGTH_RATIO - 1.0), MIN_RAY_WEIGHT);
        sum += between.x * between.y * likeness * ray.rgb;
        weights += between.x * between.y * likeness;
    }
    return sum / weights;
}

fn count(radiance: vec3f, first: u32) {
    let luminance = dot(radiance, vec3f(0.2126, 0.7152, 0.0722));
    if luminance >= 1.1754944e-38 && luminance < 3e38 {
        atomicAdd(&histogram[first + (bitcast<u32>(luminance) >> HISTOGRAM_SHIFT)], 1u);
    }
}

// How far the direction in which a pixel's path leaves the scene turns from pixel to pixel, radians.
fn footprint(pixel: vec2u, escape: Escape) -> f32 {
    let place = vec2i(pixel);
    let across = min(turn(place - vec2i(1, 0), escape), turn(place + vec2i(1, 0), escape));
    let down = min(turn(place - vec2i(0, 1), escape), turn(place + vec2i(0, 1), escape));
    return max(select(across, 0.0, across > 8.0), select(down, 0.0, down > 8.0));
}

// More than 8: nothing is there, or it is seen by way of other mirrors.
fn turn(place: vec2i, escape: Escape) -> f32 {
    if any(place < vec2i(0)) || any(place >= vec2i(preview.size)) {
        return 9.0;
    }
    let other = escapes[pixel_index(vec2u(place))];
    return select(9.0, distance(other.direction, escape.direction), other.alpha != NO_ESCAPE && other.path == escape.path);
}

fn environment_at(escape: Escape, footprint_rad: f32) -> vec3f {
    let direction = environment_from_world(escape.direction);
    if escape.path == 0u {
        return background_at(direction);
    }
    // Texels cover a smaller solid angle towards a face's corners.
    let texel = texel_width(direction, preview.texel_rad);
    if escape.alpha > 0.0 {
        return environment_level(direction, level_of(ROUGH_WIDTH * escape.alpha, texel));
    }
    if footprint_rad > texel {
        return environment_level(direction, log2(footprint_rad / texel));
    }
    if preview.has_emitters != 0u {
        let hit = trace_some(free_ray(preview.light_centre), escape.direction, 0.0, 3e38, false, MEETS_DISTANT_EMITTERS);
        if hit.triangle != NO_TRIANGLE {
            return objects[load_instance(hit.instance).object].radiance;
        }
    }
    return background_at(direction);
}

fn environment_level(direction: vec3f, level: f32) -> vec3f {
    return preview.environment_scale * textureSampleLevel(environment, trilinear, direction, level).rgb;
}

fn background_at(direction: vec3f) -> vec3f {
    let texel = textureSampleLevel(background, trilinear, direction, 0.0).rgb;
    return preview.background_intensity * preview.background_scale * texel;
}

// From the radiance of a preview to what is displayed: exposure, tone mapping and edges. CPU twins: src/base/image/tone.rs and
// src/render/engine/preview/edges.rs.

#import preview
#import hits

@group(0) @binding(0) var<uniform> preview: PreviewUniforms;
@group(0) @binding(1) var<storage, read> shaded: array<vec4f>;
@group(0) @binding(2) var<storage, read> first: array<FirstSurface>;
@group(0) @binding(3) var<storage, read> histogram: array<u32>;
// Stops: of surfaces, of the background.
@group(0) @binding(4) var<storage, read_write> exposures: array<f32, 2>;
@group(0) @binding(5) var<storage, read_write> colours: array<vec4f>;
// Display-linear, and encoded as sRGB.
@group(0) @binding(6) var picture: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var shown: texture_storage_2d<rgba8unorm, write>;
// Rays that the adapter did not let be finished.
@group(0) @binding(8) var<storage, read_write> unfinished: atomic<u32>;

const METER_WORKGROUP: u32 = 256u;
var<workgroup> sums: array<u32, METER_WORKGROUP>;
// Luminance at the middle, and near the top.
var<workgroup> middle: u32;
var<workgroup> top: u32;

// One workgroup: the exposures, from the histogram of luminance if they are metered.
@compute @workgroup_size(METER_WORKGROUP)
fn meter(@builtin(local_invocation_index) lane: u32) {
    // Surfaces alone, unless they are less than a tenth of the picture.
    let is_background = 10u * histogram[2u * HISTOGRAM_BINS] < preview.size.x * preview.size.y;
    let first_bin = select(0u, HISTOGRAM_BINS, is_background);
    let run = HISTOGRAM_BINS / METER_WORKGROUP;
    var own = 0u;
    for (var k = 0u; k < run; k++) {
        own += histogram[first_bin + lane * run + k];
    }
    sums[lane] = own;
    workgroupBarrier();
    var before = 0u;
    var total = 0u;
    for (var k = 0u; k < METER_WORKGROUP; k++) {
        before += select(0u, sums[k], k < lane);
        total += sums[k];
    }
    if total > 0u {
        let ranks = vec2u(vec2f(0.5, 0.98) * f32(total - 1u));
        for (var k = 0u; k < run; k++) {
            let bin = lane * run + k;
            let count = histogram[first_bin + bin];
            if ranks.x >= before && ranks.x < before + count {
                middle = bin;
            }
            if ranks.y >= before && ranks.y < before + count {
                top = bin;
            }
            before += count;
        }
    }
    workgroupBarrier();
    if lane != 0u {
        return;
    }
    var metered = 0.0;
    if total > 0u {
        let stops = log2(min(MIDDLE_GREY / middle_of(middle), HIGHLIGHT / middle_of(top)));
        metered = clamp(stops, -64.0, 64.0);
    }
    let surface = select(preview.exposure, metered, (preview.exposure_flags & IS_METERED) != 0u);
    exposures[0] = surface;
    exposures[1] = select(preview.background_exposure, surface, (preview.exposure_flags & IS_SHARED) != 0u);
}

// The luminance in the middle of a bin.
fn middle_of(bin: u32) -> f32 {
    return bitcast<f32>((bin << HISTOGRAM_SHIFT) | (1u << (HISTOGRAM_SHIFT - 1u)));
}

@compute @workgroup_size(8, 8)
fn display(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= preview.size) {
        return;
    }
    let pixel = pixel_index(id.xy);
    let radiance = exp2(exposures[0]) * shaded[2u * pixel].rgb + exp2(exposures[1]) * shaded[2u * pixel + 1u].rgb;
    colours[pixel] = vec4f(tone_mapped(radiance), 1.0);
}

fn tone_mapped(radiance: vec3f) -> vec3f {
    if preview.tone_map == 1u {
        let x = 0.6 * clamp(radiance, vec3f(0.0), vec3f(1e6));
        return clamp((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), vec3f(0.0), vec3f(1.0));
    }
    if preview.tone_map == 2u {
        return clamp(radiance, vec3f(0.0), vec3f(1.0));
    }
    return neutral(radiance);
}

// Khronos PBR Neutral (2024).
fn neutral(radiance: vec3f) -> vec3f {
    let start = 0.8 - 0.04;
    let positive = max(radiance, vec3f(0.0));
    let least = min(positive.r, min(positive.g, positive.b));
    let offset = select(0.04, least - 6.25 * least * least, least < 0.08);
    let colour = positive - offset;
    let peak = max(colour.r, max(colour.g, colour.b));
    if peak < start {
        return colour;
    }
    let d = 1.0 - start;
    let new_peak = 1.0 - d * d / (peak + d - start);
    let towards_white = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
    return clamp(mix(colour * (new_peak / peak), vec3f(new_peak), towards_white), vec3f(0.0), vec3f(1.0));
}

// Mixes pixels at edges from the colours that their neighbours have of the surfaces that they share.
@compute @workgroup_size(8, 8)
fn smooth_edges(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= preview.size) {
        return;
    }
    var colour = colours[pixel_index(id.xy)];
    if is_edge(id.xy) {
        colour = vec4f(0.0);
        // No two in one row or column.
        let points = array(vec2f(-0.125, -0.375), vec2f(0.375, -0.125), vec2f(0.125, 0.375), vec2f(-0.375, 0.125));
        for (var k = 0u; k < 4u; k++) {
            colour += 0.25 * colours[pixel_with(id.xy, points[k])];
        }
    }
    textureStore(picture, id.xy, colour);
    textureStore(shown, id.xy, vec4f(encoded(colour.rgb), 1.0));
}

fn encoded(colour: vec3f) -> vec3f {
    let c = clamp(colour, vec3f(0.0), vec3f(1.0));
    return select(1.055 * pow(c, vec3f(1.0 / 2.4)) - 0.055, 12.92 * c, c <= vec3f(0.0031308));
}

fn is_like(a: FirstSurface, b: FirstSurface, min_cosine: f32) -> bool {
    return a.side == b.side && (a.side == NO_OBJECT || dot(a.normal, b.normal) >= min_cosine);
}

fn is_in_picture(place: vec2i) -> bool {
    return all(place >= vec2i(0)) && all(place < vec2i(preview.size));
}

fn is_edge(pixel: vec2u) -> bool {
    let own = first[pixel_index(pixel)];
    let steps = array(vec2i(1, 0), vec2i(-1, 0), vec2i(0, 1), vec2i(0, -1));
    for (var k = 0u; k < 4u; k++) {
        let place = vec2i(pixel) + steps[k];
        if is_in_picture(place) && !is_like(own, first[pixel_index(vec2u(place))], MIN_EVEN_COSINE) {
            return true;
        }
    }
    return false;
}

// The pixel nearest to a point of a pixel that shows the same surface: itself, or one of those around it.
fn pixel_with(pixel: vec2u, point: vec2f) -> u32 {
    let ray = camera_ray(vec2f(pixel) + 0.5 + point);
    let met = trace_some(free_ray(ray.origin), ray.direction, 0.0, 3e38, false, MEETS_FOR_CAMERA);
    if !met.is_complete {
        atomicAdd(&unfinished, 1u);
    }
    var surface = FirstSurface(vec3f(0.0), NO_OBJECT);
    if met.triangle != NO_TRIANGLE {
        let hit = describe(met, ray.direction);
        surface = FirstSurface(hit.normal, 2u * hit.object + select(0u, 1u, hit.is_front));
    }
    let own = pixel_index(pixel);
    if is_like(first[own], surface, MIN_EVEN_COSINE) {
        return own;
    }
    var nearest = own;
    var least = 3e38;
    for (var k = 0; k < 9; k++) {
        let step = vec2i(k % 3, k / 3) - 1;
        if !is_in_picture(vec2i(pixel) + step) {
            continue;
        }
        let there = pixel_index(vec2u(vec2i(pixel) + step));
        let other = first[there];
        if is_like(other, surface, MIN_SAME_COSINE) {
            // Of those on the same side of a crease, the nearest.
            let mismatch = distance(vec2f(step), point) - 4.0 * dot(other.normal, surface.normal);
            if mismatch < least {
                least = mismatch;
                nearest = there;
            }
        }
    }
    return nearest;
}

// What receivers reflect to their viewers. CPU twin: src/base/brdf/.

#import receivers
#import microfacets

override SHADING: bool = false;

struct Material {
    albedo: vec3f,
    kind: u32,
    specular: vec3f,
    // Phong's exponent, or GGX's α.
    width: f32,
    // The first entry of its table.
    table: u32,
}

// Never read without SHADING.
@group(1) @binding(2) var receiver_view: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> materials: array<Material>;
@group(1) @binding(4) var<storage, read> tables: array<vec4f>;

// Towards the viewer of a receiver.
fn view_direction(pixel: vec2u) -> vec3f {
    if SHADING {
        return textureLoad(receiver_view, pixel, 0).xyz;
    }
    return vec3f(0.0);
}

// The function of an object, 1/sr: n, l and v are the unit normal, towards the light and towards the viewer. Lobes are widened to
// what they are on average over light from `solid_angle` sr around l; tables are not.
fn brdf(object: u32, n: vec3f, l: vec3f, v: vec3f, solid_angle: f32) -> vec3f {
    let material = materials[object];
    if material.kind == MATERIAL_TABLE {
        if dot(n, l) <= 0.0 || dot(n, v) <= 0.0 {
            return vec3f(0.0);
        }
        return tabulated(material.table, n, l, v);
    }
    var width = material.width;
    if material.kind == MATERIAL_PHONG {
        // Variances add, that of cosᵉ being 1/e and that of a square its area's twelfth.
        width = width / (1.0 + width * solid_angle / 12.0);
    } else if material.kind == MATERIAL_GGX {
        // The half vector turns half as far as the light; α² is twice a variance.
        width = min(sqrt(width * width + solid_angle / 24.0), 1.0);
    }
    return lobe_brdf(material.kind, material.albedo, material.specular, width, n, l, v);
}

// Steps of θ_half, θ_diff and φ_diff of a table.
const STEPS: vec3u = vec3u(TABLE_THETA_HALF_STEPS, TABLE_THETA_DIFF_STEPS, TABLE_PHI_DIFF_STEPS);

fn tabulated(first: u32, n: vec3f, l: vec3f, v: vec3f) -> vec3f {
    let h = normalize(l + v);
    var across = cross(n, h);
    if dot(across, across) < 1e-14 {
        across = cross(n, select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(n.x) > 0.7));
    }
    across = normalize(across);
    let away = cross(across, h);
    let theta_half = acos(clamp(dot(n, h), -1.0, 1.0));
    let theta_diff = acos(clamp(dot(l, h), -1.0, 1.0));
    var phi = atan2(dot(l, across), dot(l, away)) / PI;
    phi = phi - floor(phi);
    let steps = vec3f(STEPS);
    let half = clamp(sqrt(max(2.0 * theta_half / PI, 0.0)) * steps.x - 0.5, 0.0, steps.x - 1.0);
    let diff = clamp(2.0 * theta_diff / PI * steps.y - 0.5, 0.0, steps.y - 1.0);
    let around = (phi * steps.z + steps.z - 0.5) % steps.z;
    let low = vec3u(u32(half), u32(diff), u32(around) % STEPS.z);
    let high = vec3u(min(low.x + 1u, STEPS.x - 1u), min(low.y + 1u, STEPS.y - 1u), (low.z + 1u) % STEPS.z);
    let part = vec3f(fract(half), fract(diff), fract(around));
    let near = mix(along_phi(first, low.x, low.y, low.z, high.z, part.z), along_phi(first, low.x, high.y, low.z, high.z, part.z), part.y);
    let far = mix(along_phi(first, high.x, low.y, low.z, high.z, part.z), along_phi(first, high.x, high.y, low.z, high.z, part.z), part.y);
    return mix(near, far, part.x);
}

fn along_phi(first: u32, i: u32, j: u32, k: u32, next: u32, part: f32) -> vec3f {
    let row = first + (i * STEPS.y + j) * STEPS.z;
    return mix(tables[row + k].rgb, tables[row + next].rgb, part);
}

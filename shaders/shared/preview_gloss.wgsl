// What glossy receivers reflect to the camera in previews: of the environment from sixteen microfacets, with shadows. CPU twin:
// src/render/engine/preview/gloss.rs. The importing shader declares `objects`, `environment`, `trilinear` and `unfinished`.

#import preview
#import rays
#import cube
#import microfacets

// The BRDF of an object with a lobe, 1/sr; n, l and v are the unit normal, towards the light and towards the viewer.
fn brdf_with_lobe(object: PreviewObject, n: vec3f, l: vec3f, v: vec3f) -> vec3f {
    return lobe_brdf(object.kind, object.albedo, object.specular, object.width, n, l, v);
}

// Microfacets along both coordinates of a lobe.
const ALONG: u32 = 4u;

fn view_of(point: SurfacePoint) -> vec3f {
    let towards_camera = normalize(preview.camera_position - point.position);
    return select(-preview.camera_forward, towards_camera, preview.is_perspective != 0u);
}

// The diffuse part of an object's BRDF, 1/sr, under even light, seen at a cosine to the normal.
fn mean_diffuse(object: PreviewObject, cos_v: f32) -> vec3f {
    let diffuse = object.albedo / PI;
    if object.kind != MATERIAL_GGX {
        return diffuse;
    }
    // The mean of Schlick's (1 − cos)⁵ over a diffuse hemisphere is 1/21.
    let arrives = (1.0 - object.specular) * (20.0 / 21.0);
    return diffuse * arrives * (1.0 - schlick(object.specular, cos_v));
}

// GGX width of the microfacets that are drawn for an object's lobe.
fn lobe_alpha(object: PreviewObject) -> f32 {
    return select(object.width, min(sqrt(8.0 / (object.width + 2.0)), 1.0), object.kind == MATERIAL_PHONG);
}

// A microfacet's unit normal, without the tail of the distribution.
fn likely_facet(normal: vec3f, view: vec3f, alpha: f32, at: vec2f) -> vec3f {
    let u = PART_OF_FACETS * at.x;
    let tangent = alpha * sqrt(u / (1.0 - u));
    let angle = 2.0 * PI * at.y;
    let in_plane = view - dot(view, normal) * normal;
    var t = in_plane / max(length(in_plane), 1e-20);
    if dot(in_plane, in_plane) < 1e-12 {
        t = any_tangent(normal);
    }
    return normalize(normal + tangent * (cos(angle) * t + sin(angle) * cross(normal, t)));
}

fn any_tangent(normal: vec3f) -> vec3f {
    return normalize(cross(normal, select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(normal.x) > 0.7)));
}

// The lobe times the cosine of the light, over the density of directions that microfacets reflect to the viewer.
fn lobe_weight(object: PreviewObject, n: vec3f, facet: vec3f, v: vec3f, l: vec3f) -> vec3f {
    let cos_l = dot(n, l);
    let cos_v = dot(n, v);
    if cos_l <= 0.0 || cos_v <= 0.0 {
        return vec3f(0.0);
    }
    let cos_facet = dot(n, facet);
    let over_distribution = 4.0 * dot(v, facet) * cos_l / max(cos_facet, 1e-4);
    let alpha = lobe_alpha(object);
    if object.kind == MATERIAL_GGX {
        return schlick(object.specular, dot(l, facet)) * masking(cos_l, cos_v, alpha) * over_distribution;
    }
    let mirrored = max(dot(2.0 * cos_l * n - l, v), 0.0);
    let lobe = (object.width + 2.0) / (2.0 * PI) * pow(max(mirrored, 1e-30), object.width);
    return object.specular * (lobe / max(distribution(cos_facet, alpha), 1e-9) * over_distribution);
}

fn environment_in_lobe(point: SurfacePoint, object: PreviewObject) -> vec3f {
    let view = view_of(point);
    let alpha = lobe_alpha(object);
    var sum = vec3f(0.0);
    for (var k = 0u; k < ALONG * ALONG; k++) {
        let at = (vec2f(vec2u(k, ALONG * (k % ALONG) + k / ALONG)) + 0.5) / f32(ALONG * ALONG);
        let facet = likely_facet(point.normal, view, alpha, at);
        let direction = normalize(2.0 * dot(view, facet) * facet - view);
        let weight = lobe_weight(object, point.normal, facet, view, direction);
        if all(weight == vec3f(0.0)) {
            continue;
        }
        if preview.is_shadowed != 0u {
            let met = trace(free_ray(point.position), direction, 3e38, true);
            if !met.is_complete {
                atomicAdd(&unfinished, 1u);
            }
            if met.triangle != NO_TRIANGLE {
                continue;
            }
        }
        let towards = environment_from_world(direction);
        let level = level_of(alpha, texel_width(towards, preview.texel_rad));
        sum += weight * preview.environment_scale * textureSampleLevel(environment, trilinear, towards, level).rgb;
    }
    return sum / f32(ALONG * ALONG);
}

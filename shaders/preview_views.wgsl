// What each pixel of a preview sees: a surface, what a mirror on it shows or lies behind an interface, or the environment. CPU twin:
// src/render/engine/preview/views.rs.

#import preview
#import hits
#import interface
#import preview_lamps

const INVERSE_PI: f32 = 0.31830989;

@group(0) @binding(0) var<uniform> preview: PreviewUniforms;
@group(0) @binding(1) var<storage, read> objects: array<PreviewObject>;
// Reflectance by the cosine of the angle of incidence, CURVE_POINTS for each object.
@group(0) @binding(2) var<storage, read> curves: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> surfaces: array<SurfacePoint>;
@group(0) @binding(4) var<storage, read_write> mirrored: array<SurfacePoint>;
@group(0) @binding(5) var<storage, read_write> escapes: array<Escape>;
@group(0) @binding(6) var<storage, read_write> first: array<FirstSurface>;
// Rays that the adapter did not let be finished.
@group(0) @binding(7) var<storage, read_write> unfinished: atomic<u32>;
@group(0) @binding(8) var<storage, read> near_light: array<vec4u>;

@compute @workgroup_size(8, 8)
fn trace_views(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= preview.size) {
        return;
    }
    let pixel = pixel_index(id.xy);
    var ray = camera_ray(vec2f(id.xy) + 0.5);
    var own = SurfacePoint(vec3f(0.0), NO_OBJECT, vec3f(0.0), 0u, vec3f(0.0), 0u);
    var behind = own;
    var escape = Escape(vec3f(0.0), 0u, vec3f(0.0), NO_ESCAPE);
    first[pixel] = FirstSurface(vec3f(0.0), NO_OBJECT);
    var throughput = vec3f(1.0);
    var alpha = 0.0;
    var path = 0u;
    var in_medium = (preview.medium_flags & CAMERA_IN_MEDIUM) != 0u;
    for (var mirror = 0u; mirror <= MAX_MIRRORS; mirror++) {
        let met = trace_some(
            free_ray(ray.origin), ray.direction, select(ray_uniforms.offset, 0.0, mirror == 0u), 3e38, false,
            select(MEETS_FOR_MIRRORS, MEETS_FOR_CAMERA, mirror == 0u),
        );
        if !met.is_complete {
            atomicAdd(&unfinished, 1u);
        }
        let is_hit = met.triangle != NO_TRIANGLE;
        let hit = hit_of(met, ray.direction);
        if mirror == 0u && is_hit {
            first[pixel] = FirstSurface(hit.normal, 2u * hit.object + select(0u, 1u, hit.is_front));
            own.position = hit.position;
            own.flags = IS_FIRST;
        }
        let extinction = select(vec3f(0.0), preview.extinction, in_medium);
        let shining = lamps_met(ray, select(3e38, met.distance, is_hit), extinction);
        if any(shining != vec3f(0.0)) {
            escape = Escape(ray.direction, path, throughput * shining, EMITTED);
            break;
        }
        if !is_hit {
            // What mirrors show of the environment is as bright as what they cast of it.
            let is_cast = (preview.medium_flags & FILLS_SPACE) != 0u && mirror > 0u;
            let passed = select(exp(-preview.sight * extinction), vec3f(1.0), is_cast);
            escape = Escape(ray.direction, path, throughput * passed, alpha);
            break;
        }
        throughput *= exp(-met.distance * extinction);
        let object = objects[hit.object];
        if (object.flags & IS_EMITTER) != 0u {
            escape = Escape(ray.direction, path, throughput * object.radiance, EMITTED);
            break;
        }
        if preview.is_plain == 0u && (object.flags & IS_REFRACTOR) != 0u {
            path = path * 1000003u + hit.object + 1u;
            let view = divided(object, hit, ray.direction);
            if view.reflectance > 0.0 && view.is_refracted && escape.alpha == NO_ESCAPE {
                let reflected = view.reflectance * throughput * exp(-preview.sight * extinction);
                escape = Escape(view.mirrored, path, reflected, alpha);
            }
            throughput *= select(1.0, view.factor, view.is_refracted);
            ray = Ray(hit.position, select(view.mirrored, view.refracted, view.is_refracted));
            // Behind interfaces there is the medium, in front of them none.
            in_medium = select(in_medium, hit.is_front, view.is_refracted);
            continue;
        }
        let mirrors = preview.is_plain == 0u && (object.flags & select(2u, 1u, hit.is_front)) != 0u;
        let albedo = select(object.albedo, object.mirror_albedo, mirrors);
        let receives = preview.is_plain == 0u && (object.flags & IS_RECEIVER) != 0u;
        let is_glossy = receives && path == 0u && !mirrors && has_lobe(object);
        if any(albedo > vec3f(0.0)) || is_glossy {
            let flags = select(0u, IS_FRONT, hit.is_front) | select(0u, RECEIVES, receives) | select(0u, IS_GLOSSY, is_glossy);
            let factor = throughput * select(albedo * INVERSE_PI, vec3f(1.0), is_glossy);
            let point = SurfacePoint(hit.position, hit.object, hit.normal, path, factor, flags);
            if path == 0u {
                own = point;
                own.flags |= IS_FIRST;
            } else if behind.object == NO_OBJECT {
                behind = point;
            }
        }
        if !mirrors {
            break;
        }
        throughput *= reflectance(hit.object, abs(dot(ray.direction, hit.normal)));
        alpha = max(alpha, object.alpha);
        path = path * 1000003u + hit.object + 1u;
        ray = Ray(hit.position, mirrored_direction(hit, ray.direction));
    }
    surfaces[pixel] = own;
    mirrored[pixel] = behind;
    escapes[pixel] = escape;
}

// What a ray meets; anything where it meets nothing.
fn hit_of(met: RayHit, direction: vec3f) -> Hit {
    if met.triangle == NO_TRIANGLE {
        return Hit();
    }
    return describe(met, direction);
}

// A ray divided by an interface. CPU twin: src/render/engine/refraction.rs.
struct Divided {
    mirrored: vec3f,
    reflectance: f32,
    // The rest of it, with the factor on the radiance that comes back, unless all is reflected.
    refracted: vec3f,
    factor: f32,
    is_refracted: bool,
}

fn divided(object: PreviewObject, hit: Hit, direction: vec3f) -> Divided {
    let eta = object.width;
    // The index of the medium that the ray enters over that of the one that it leaves.
    let entered = select(1.0 / eta, eta, hit.is_front);
    let towards = normalize(direction);
    let cosine = clamp(-dot(towards, hit.normal), 0.0, 1.0);
    let beyond = refracted_cosine(1.0 / entered, cosine);
    let reflects = (object.flags & REFLECTS) != 0u;
    let reflectance = select(0.0, crossing_factor(entered, true, -cosine), reflects);
    let refracted = normalize(towards / entered + (cosine / entered - beyond) * hit.normal);
    // An interpolated normal may refract back through the triangle, at grazing angles.
    let depth = -dot(refracted, hit.face_normal);
    let inwards = normalize(refracted - max(MIN_HEIGHT - depth, 0.0) * hit.face_normal);
    return Divided(
        mirrored_direction(hit, direction), reflectance, inwards, (1.0 - reflectance) / (entered * entered), beyond > 0.0,
    );
}

fn reflectance(object: u32, cosine: f32) -> vec3f {
    let place = min(cosine, 1.0) * f32(CURVE_POINTS - 1u);
    let step = min(u32(place), CURVE_POINTS - 2u);
    let start = object * CURVE_POINTS + step;
    return mix(curves[start].rgb, curves[start + 1u].rgb, place - f32(step));
}

// The unit direction in which a mirror reflects a ray, outwards: an interpolated normal may reflect into the triangle.
fn mirrored_direction(hit: Hit, direction: vec3f) -> vec3f {
    let mirrored = normalize(reflect(direction, hit.normal));
    let height = dot(mirrored, hit.face_normal);
    return normalize(mirrored + max(MIN_HEIGHT - height, 0.0) * hit.face_normal);
}

// What the passes of a preview share: the camera, and what pixels see. CPU twin: src/render/engine/preview/; Rust layout:
// src/render/engine/preview/on_gpu/layout.rs.

#import constants
#import ray_origin

struct PreviewUniforms {
    camera_position: vec3f,
    // Half the height of the picture: at a distance of 1 or, for parallel rays, in metres.
    half_height: f32,
    camera_forward: vec3f,
    is_perspective: u32,
    camera_right: vec3f,
    lamp_count: u32,
    camera_up: vec3f,
    // Of shadow rays.
    direction_count: u32,
    // From where emitters are seen as a part of the environment.
    light_centre: vec3f,
    has_emitters: u32,
    // Pixels.
    size: vec2u,
    // Cosine and sine of the environment's rotation about +Y.
    rotation: vec2f,
    // Factor on every radiance.
    intensity: f32,
    // Factor on the environment behind emitters.
    background_intensity: f32,
    // What texels of the cubes were divided by: of the environment, of the background, and of the irradiance.
    environment_scale: f32,
    background_scale: f32,
    irradiance_scale: f32,
    // 2 over the size of a face of the environment's cube.
    texel_rad: f32,
    caustic_gain: f32,
    // Everything is diffuse.
    is_plain: u32,
    // Stops; with IS_METERED, the surfaces' are found by metering, and with IS_SHARED the background's are those of the surfaces.
    exposure: f32,
    background_exposure: f32,
    exposure_flags: u32,
    // 0: neutral; 1: filmic; 2: linear.
    tone_map: u32,
    // Of the medium, channel by channel, 1/m; 0 without.
    extinction: vec3f,
    // Parts of near emitters.
    part_count: u32,
    // Whether shadow rays are traced.
    is_shadowed: u32,
    // FILLS_SPACE, CAMERA_IN_MEDIUM.
    medium_flags: u32,
    // Farther than this, metres, nothing is seen through the medium.
    sight: f32,
    // Pixels from ray to ray along which scattered light is known; 0: there is none.
    scattering_spacing: u32,
}

const FILLS_SPACE: u32 = 1u;
const CAMERA_IN_MEDIUM: u32 = 2u;

// An object's surface.
struct PreviewObject {
    // Albedo of the side that does not mirror, and of the side that does.
    albedo: vec3f,
    // 1: the front mirrors; 2: the back; then IS_RECEIVER and so on.
    flags: u32,
    mirror_albedo: vec3f,
    // GGX width of the mirror.
    alpha: f32,
    // Of an emitter.
    radiance: vec3f,
    // Of a receiver: Phong's exponent, or GGX's α; its specular reflectance, and the kind of its BRDF. Of an interface: its relative
    // refractive index.
    width: f32,
    specular: vec3f,
    kind: u32,
}

// Whether its BRDF is a lobe over a diffuse part.
fn has_lobe(object: PreviewObject) -> bool {
    return object.kind == MATERIAL_PHONG || object.kind == MATERIAL_GGX;
}

const IS_RECEIVER: u32 = 4u;
const IS_EMITTER: u32 = 8u;
const IS_REFRACTOR: u32 = 16u;
// Of refractors that reflect.
const REFLECTS: u32 = 32u;

const IS_METERED: u32 = 1u;
const IS_SHARED: u32 = 2u;

// A lit point of a surface.
struct SurfacePoint {
    position: vec3f,
    // NO_OBJECT: there is none.
    object: u32,
    // Towards the ray.
    normal: vec3f,
    // Tells points that are seen by way of different mirrors; 0 without a mirror.
    path: u32,
    // Factor on its irradiance, 1/sr; if it is glossy, on its radiance.
    factor: vec3f,
    // IS_FRONT, RECEIVES, IS_GLOSSY, IS_FIRST.
    flags: u32,
}

const IS_FRONT: u32 = 1u;
const RECEIVES: u32 = 2u;
// The camera sees it directly, and sees a lobe of its BRDF.
const IS_GLOSSY: u32 = 4u;
// The position is that of what the camera sees first, even if there is no lit surface.
const IS_FIRST: u32 = 8u;

// The environment at the end of a path, or an emitter.
struct Escape {
    direction: vec3f,
    // 0 where the camera sees it directly.
    path: u32,
    // Factor on its radiance; for an emitter, its radiance too.
    factor: vec3f,
    // Width of the roughest mirror on the way, or NO_ESCAPE or EMITTED.
    alpha: f32,
}

const NO_ESCAPE: f32 = -1.0;
const EMITTED: f32 = -2.0;

// What the camera sees first.
struct FirstSurface {
    normal: vec3f,
    // Twice the object, plus 1 from the front; NO_OBJECT: nothing.
    side: u32,
}

struct Ray {
    origin: vec3f,
    direction: vec3f,
}

// The ray through a place in the picture, pixels.
fn camera_ray(at: vec2f) -> Ray {
    let size = vec2f(preview.size);
    let p = vec2f(2.0 * at.x - size.x, size.y - 2.0 * at.y) / size.y;
    let offset = preview.half_height * (p.x * preview.camera_right + p.y * preview.camera_up);
    if preview.is_perspective != 0u {
        return Ray(preview.camera_position, normalize(preview.camera_forward + offset));
    }
    return Ray(preview.camera_position + offset, preview.camera_forward);
}

// A direction of the world in the environment's own frame.
fn environment_from_world(d: vec3f) -> vec3f {
    let c = preview.rotation.x;
    let s = preview.rotation.y;
    return vec3f(c * d.x - s * d.z, d.y, s * d.x + c * d.z);
}

fn pixel_index(pixel: vec2u) -> u32 {
    return pixel.y * preview.size.x + pixel.x;
}

// What a light's view shows, as images: the surfaces that photons meet first in the left half and, of the same draw, the farthest ones of
// closed objects in the right half, whose depths are turned around (Wyman and Nichols 2009, Section 3.1); or receivers alone, or one closed
// object. CPU twin:
// src/render/image_space/surface_images.rs, by rays.

#import constants
#import rays
#import photon_surface
#import plane

// A plane, and what is drawn into it.
struct ImageDraw {
    plane: Plane,
    // Texels along an edge.
    size: f32,
    // Along the view axis, metres.
    near: f32,
    far: f32,
    // The first texel of the object.
    instance: u32,
    // SHOWS_ALL and so on.
    shown: u32,
}

@group(0) @binding(0) var<uniform> drawn: ImageDraw;
@group(1) @binding(0) var<storage, read> surfaces: array<PhotonSurface>;

struct Corner {
    @builtin(position) clip: vec4f,
    @location(0) normal: vec3f,
    @location(1) depth: f32,
    @location(2) position: vec3f,
    @location(3) @interpolate(flat) face_normal: vec3f,
    @location(4) @interpolate(flat) object: u32,
    @location(5) @interpolate(flat) half: u32,
}

struct Shown {
    // The interpolated normal, towards the light, and the depth.
    @location(0) normal_depth: vec4f,
    // The triangle's packed normal, towards the light; the object; 1 in front of it; 1 where there is anything.
    @location(1) surface: vec4u,
}

@vertex
fn place(@builtin(vertex_index) vertex: u32, @builtin(instance_index) half: u32) -> Corner {
    let instance = load_instance(drawn.instance);
    let triangle = load_triangle(instance.first_texel + 2u * instance.node_count + 4u * (vertex / 3u));
    var corners = triangle.corners;
    var normals = triangle.normals;
    let scale2 = instance.units_per_metre * instance.units_per_metre;
    let position = world_from_units(corners[vertex % 3u] - instance.translation, instance) / scale2;
    let face = normalize(world_from_units(cross(corners[1] - corners[0], corners[2] - corners[0]), instance));
    let normal = normalize(world_from_units(normals[vertex % 3u], instance));
    let offset = position - drawn.plane.origin;
    let local = vec3f(dot(offset, drawn.plane.right), dot(offset, drawn.plane.down), dot(offset, drawn.plane.forward));
    let is_parallel = drawn.plane.is_parallel != 0u;
    let w = select(local.z, 1.0, is_parallel);
    // From −w to w across the window, y up.
    let across = 2.0 * (local.xy - vec2f(drawn.plane.low_x, drawn.plane.low_y) * w) / (drawn.plane.texel * drawn.size) - w;
    let range = drawn.far - drawn.near;
    let z = select(drawn.far * (local.z - drawn.near) / range, (local.z - drawn.near) / range, is_parallel);
    var clip = vec4f(across.x, -across.y, z, w);
    if drawn.shown == SHOWS_BACK {
        clip.z = w - clip.z;
    }
    if drawn.shown == SHOWS_FIRST_AND_LAST {
        clip.x = 0.5 * clip.x + select(-0.5, 0.5, half == 1u) * w;
        clip.z = select(clip.z, w - clip.z, half == 1u);
    }
    return Corner(clip, normal, local.z, position, face, instance.object, half);
}

@fragment
fn show(corner: Corner) -> Shown {
    let direction = select(normalize(corner.position - drawn.plane.origin), drawn.plane.forward, drawn.plane.is_parallel != 0u);
    let normal = normalize(corner.normal);
    let towards_normal = select(-corner.face_normal, corner.face_normal, dot(corner.face_normal, normal) >= 0.0);
    let is_front = dot(towards_normal, direction) <= 0.0;
    if drawn.shown == SHOWS_FRONT && !is_front || drawn.shown == SHOWS_BACK && is_front {
        discard;
    }
    if drawn.shown == SHOWS_FIRST_AND_LAST {
        // What lies across the middle belongs to the other half.
        let is_right = corner.clip.x >= drawn.size;
        let is_solid = (surfaces[corner.object].flags & IS_SOLID) != 0u;
        if is_right != (corner.half == 1u) || is_right && (is_front || !is_solid) {
            discard;
        }
    }
    let facing = select(-1.0, 1.0, is_front);
    let surface = vec4u(packed_unit(facing * towards_normal), corner.object, select(0u, 1u, is_front), 1u);
    return Shown(vec4f(facing * normal, corner.depth), surface);
}

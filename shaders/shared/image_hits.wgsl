// How rays find surfaces in images of what a light sees. CPU twin: src/render/image_space/surface_images.rs.

#import hits
#import plane
#import unit_vectors

struct ImagePlane {
    plane: Plane,
    // Texels along an edge.
    size: u32,
    // The number of images of receivers.
    receivers: u32,
    // From one end of the scene to the other, metres.
    diagonal: f32,
    // The number of closed objects that have two images each: of their fronts and of their backs.
    solids: u32,
    // The object that such an image shows.
    object: u32,
}

// The view's plane, then those of the receivers and of closed objects.
@group(2) @binding(0) var<storage, read> image_planes: array<ImagePlane>;
// As `Shown` in surface_images.wgsl.
@group(2) @binding(1) var view_normals: texture_2d<f32>;
@group(2) @binding(2) var view_surfaces: texture_2d<u32>;
@group(2) @binding(3) var receiver_normals: texture_2d_array<f32>;
@group(2) @binding(4) var receiver_surfaces: texture_2d_array<u32>;

// Which image: the first surfaces, the last ones, or from here on those of receivers, then of closed objects.
const FIRST_SURFACES: u32 = 0u;
const LAST_SURFACES: u32 = 1u;
const RECEIVERS: u32 = 2u;

const ANY_OBJECT: u32 = 0xffffffffu;

struct ShownSurface {
    depth: f32,
    // Towards the light.
    normal: vec3f,
    face_normal: vec3f,
    object: u32,
    is_front: bool,
    is_there: bool,
}

struct GapHit {
    // Along the ray, metres.
    distance: f32,
    // How far behind the surface.
    gap: f32,
    shown: ShownSurface,
}

fn plane_of(image: u32) -> ImagePlane {
    return image_planes[select(0u, image - 1u, image >= RECEIVERS)];
}

fn nothing_shown() -> ShownSurface {
    return ShownSurface(0.0, vec3f(0.0), vec3f(0.0), NO_OBJECT, false, false);
}

fn image_texel(image: u32, texel: vec2i, size: i32) -> ShownSurface {
    if any(texel < vec2i(0)) || any(texel >= vec2i(size)) {
        return nothing_shown();
    }
    var normal: vec4f;
    var surface: vec4u;
    if image >= RECEIVERS {
        normal = textureLoad(receiver_normals, texel, image - RECEIVERS, 0);
        surface = textureLoad(receiver_surfaces, texel, image - RECEIVERS, 0);
    } else {
        let at = vec2i(texel.x + select(0, size, image == LAST_SURFACES), texel.y);
        normal = textureLoad(view_normals, at, 0);
        surface = textureLoad(view_surfaces, at, 0);
    }
    return ShownSurface(normal.w, normal.xyz, unpacked_unit(surface.x), surface.y, surface.z != 0u, surface.w != 0u);
}

// Depth and normals at a place, bilinear between the texels of the nearest one's surface.
fn shown_at(image: u32, image_plane: ImagePlane, at: vec2f, wanted: u32) -> ShownSurface {
    let size = i32(image_plane.size);
    if any(at < vec2f(0.0)) || any(at >= vec2f(f32(size))) {
        return nothing_shown();
    }
    let nearest = image_texel(image, vec2i(at), size);
    if !nearest.is_there || wanted != ANY_OBJECT && nearest.object != wanted {
        return nothing_shown();
    }
    let low = floor(at - 0.5);
    let part = at - 0.5 - low;
    var sum = ShownSurface(0.0, vec3f(0.0), vec3f(0.0), nearest.object, nearest.is_front, true);
    var weights = 0.0;
    for (var k = 0; k < 4; k++) {
        let step = vec2i(k & 1, k >> 1);
        let texel = image_texel(image, vec2i(low) + step, size);
        let along = select(1.0 - part, part, step == vec2i(1));
        let weight = along.x * along.y;
        if texel.is_there && texel.object == nearest.object && texel.is_front == nearest.is_front
            && dot(texel.normal, nearest.normal) >= SAME_SURFACE_COSINE {
            sum.depth += weight * texel.depth;
            sum.normal += weight * texel.normal;
            sum.face_normal += weight * texel.face_normal;
            weights += weight;
        }
    }
    if weights < 1e-6 {
        return nearest;
    }
    sum.depth /= weights;
    sum.normal = normalize(sum.normal);
    sum.face_normal = normalize(sum.face_normal);
    return sum;
}

fn image_hit(direction: vec3f, position: vec3f, shown: ShownSurface) -> Hit {
    // Towards the ray's origin.
    let is_turned = dot(shown.face_normal, direction) > 0.0;
    let normal = select(shown.normal, -shown.normal, dot(shown.normal, direction) > 0.0);
    let face_normal = select(shown.face_normal, -shown.face_normal, is_turned);
    return Hit(shown.object, position, normal, face_normal, shown.is_front != is_turned);
}

fn no_hit() -> Hit {
    return Hit(NO_OBJECT, vec3f(0.0), vec3f(0.0), vec3f(0.0), false);
}

// The surface in a texel of the view; the place is given as a part of its width and height.
fn first_in_image(part: vec2f, direction: vec3f) -> Hit {
    let image_plane = image_planes[0];
    let at = part * f32(image_plane.size);
    let shown = shown_at(FIRST_SURFACES, image_plane, at, ANY_OBJECT);
    if !shown.is_there {
        return no_hit();
    }
    return image_hit(direction, point_at(image_plane.plane, at, shown.depth), shown);
}

fn gap_at(image: u32, image_plane: ImagePlane, origin: vec3f, direction: vec3f, distance: f32, wanted: u32) -> GapHit {
    let point = origin + distance * direction;
    let shown = shown_at(image, image_plane, projected(image_plane.plane, point), wanted);
    return GapHit(distance, depth_along(image_plane.plane, point) - shown.depth, shown);
}

// What a ray meets in an image of an object, or of any one. Outside of a closed object its ray has left it: the last place inside counts.
fn search_image(image: u32, origin: vec3f, direction: vec3f, wanted: u32) -> Hit {
    let image_plane = plane_of(image);
    let first_solid = RECEIVERS + image_planes[0].receivers;
    let is_within = image == LAST_SURFACES || image >= first_solid && ((image - first_solid) & 1u) == 1u;
    let end = origin + image_plane.diagonal * direction;
    let across = distance(projected(image_plane.plane, origin), projected(image_plane.plane, end));
    let count = ceil(clamp(across, MIN_IMAGE_STEPS, MAX_IMAGE_STEPS));
    // The last place in front of the surface, if there is one.
    var near: GapHit;
    var has_near = false;
    for (var step = 0.0; step <= count; step += 1.0) {
        let here = gap_at(image, image_plane, origin, direction, image_plane.diagonal * step / count, wanted);
        if here.shown.is_there && here.gap < 0.0 {
            near = here;
            has_near = true;
            continue;
        }
        if has_near && (here.shown.is_there || is_within) {
            let found = refined(image, image_plane, origin, direction, near, here, wanted);
            let hit = on_plane(image_plane, origin, direction, found);
            if hit.object != NO_OBJECT {
                return hit;
            }
        }
        has_near = false;
    }
    return no_hit();
}

// The place between two where a gap closes. Where nothing is shown at the far one, it lies beyond.
fn refined(
    image: u32, image_plane: ImagePlane, origin: vec3f, direction: vec3f, before: GapHit, beyond: GapHit, wanted: u32,
) -> GapHit {
    var near = before;
    var shown = near.shown;
    var far = beyond.distance;
    var far_gap = beyond.gap;
    var is_far_shown = beyond.shown.is_there;
    for (var k = 0u; k < IMAGE_SEARCH_STEPS; k++) {
        // A secant step, kept off the ends so that the interval shrinks.
        let part = select(0.5, clamp(near.gap / (near.gap - far_gap), 0.1, 0.9), is_far_shown);
        let middle = gap_at(image, image_plane, origin, direction, near.distance + part * (far - near.distance), wanted);
        if middle.shown.is_there {
            shown = middle.shown;
        }
        if middle.shown.is_there && middle.gap < 0.0 {
            near = middle;
        } else {
            far = middle.distance;
            far_gap = middle.gap;
            is_far_shown = middle.shown.is_there;
        }
    }
    near.shown = shown;
    return near;
}

// The place where a ray meets the plane of a surface that it is near, if that is not somewhere else.
fn on_plane(image_plane: ImagePlane, origin: vec3f, direction: vec3f, found: GapHit) -> Hit {
    let shown = found.shown;
    let at = projected(image_plane.plane, origin + found.distance * direction);
    let point = point_at(image_plane.plane, at, shown.depth);
    let facing = dot(direction, shown.face_normal);
    // Along surfaces, planes are met anywhere.
    let exact = select(found.distance, dot(point - origin, shown.face_normal) / facing, abs(facing) > 0.05);
    let position = origin + exact * direction;
    let texel = image_plane.plane.texel * select(shown.depth, 1.0, image_plane.plane.is_parallel != 0u);
    let slope = 1.0 / max(abs(dot(shown.face_normal, image_plane.plane.forward)), 0.05);
    let is_near = distance(projected(image_plane.plane, position), at) <= MAX_IMAGE_MISS;
    let is_deep = abs(depth_along(image_plane.plane, position) - shown.depth) > 2.0 * MAX_IMAGE_MISS * texel * slope;
    if !is_near || is_deep {
        return no_hit();
    }
    return image_hit(direction, position, shown);
}

// What a photon looks for: where it leaves the closed object that it is in, the closed object that it enters next, which has left one, or
// the receiver that it meets.
const TO_LEAVE: u32 = 0u;
const TO_ENTER: u32 = 1u;
const TO_LAND: u32 = 2u;

fn next_in_images(origin: vec3f, direction: vec3f, purpose: u32, object: u32) -> Hit {
    let first_solid = RECEIVERS + image_planes[0].receivers;
    // Images one by one, each so many after the last.
    var image = RECEIVERS;
    var step = 1u;
    var count = image_planes[0].receivers;
    var wanted = ANY_OBJECT;
    if purpose == TO_ENTER {
        image = first_solid;
        step = 2u;
        count = image_planes[0].solids;
    } else if purpose == TO_LEAVE {
        let own = image_of_backs(object);
        image = own;
        count = 1u;
        wanted = select(ANY_OBJECT, object, own == LAST_SURFACES);
    }
    var nearest = no_hit();
    for (var k = 0u; k < count; k++) {
        if purpose != TO_ENTER || plane_of(image).object != object {
            nearest = nearer(origin, nearest, search_image(image, origin, direction, wanted));
        }
        image += step;
    }
    return nearest;
}

// The image of a closed object's backs or, if it has none of its own, that of all last surfaces.
fn image_of_backs(object: u32) -> u32 {
    let first_solid = RECEIVERS + image_planes[0].receivers;
    for (var k = 0u; k < image_planes[0].solids; k++) {
        let image = first_solid + 2u * k + 1u;
        if plane_of(image).object == object {
            return image;
        }
    }
    return LAST_SURFACES;
}

fn nearer(origin: vec3f, known: Hit, found: Hit) -> Hit {
    let is_nearer = known.object == NO_OBJECT || distance(found.position, origin) < distance(known.position, origin);
    if found.object != NO_OBJECT && is_nearer {
        return found;
    }
    return known;
}

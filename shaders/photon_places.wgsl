// What the texels of a caustic map show, and where photons land in it. CPU twin: src/image_space/caustic_map.rs.

#import hits
#import photon_map

struct TexelRay {
    origin: vec3f,
    direction: vec3f,
}

// What a texel's ray shows.
struct ShownReceiver {
    hit: Hit,
    distance: f32,
    is_there: bool,
}

@group(1) @binding(0) var<storage, read> surfaces: array<PhotonSurface>;

// Through how many other surfaces maps of the receivers alone look at most.
const MAX_OTHERS: u32 = 64u;

// How many layers there are: the most that a ray meets, in the first of `counts`.
@compute @workgroup_size(8, 8)
fn count_layers(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if all(id.xy < map.size) {
        let ray = ray_at(vec2f(id.xy) + 0.5);
        var layers = 0u;
        var start = ray_uniforms.offset;
        for (; layers < MAX_RECEIVER_LAYERS; layers++) {
            let shown = next_receiver(ray, start);
            if !shown.is_there {
                break;
            }
            start = shown.distance + ray_uniforms.offset;
        }
        atomicMax(&counts[0], layers);
    }
    close_account(local_index);
}

@compute @workgroup_size(8, 8)
fn find_receivers(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if all(id.xy < map.size) {
        find_layers(id.xy);
    }
    close_account(local_index);
}

fn find_layers(place: vec2u) {
    let first = place.y * map.size.x + place.x;
    let ray = ray_at(vec2f(place) + 0.5);
    var shown = first_receiver(ray);
    for (var layer = 0u; layer < map.layers; layer++) {
        let texel = first + layer * texel_count();
        texels[texel] = MapTexel(vec3f(0.0), NO_OBJECT, vec3f(0.0), 0.0);
        if shown.is_there {
            let position = shown.hit.position;
            let normal = shown.hit.face_normal;
            texels[texel] = MapTexel(position, shown.hit.object, normal, texel_edge(position, normal));
            if layer + 1u < map.layers {
                shown = next_receiver(ray, shown.distance + ray_uniforms.offset);
            }
        }
    }
}

fn texel_edge(position: vec3f, normal: vec3f) -> f32 {
    var direction = map.plane.forward;
    var area = map.plane.texel * map.plane.texel;
    if map.plane.is_parallel == 0u {
        let offset = position - map.plane.origin;
        let depth = dot(offset, map.plane.forward);
        // A plane across the view axis shows texel² · depth², which is seen at an angle.
        area *= depth * depth * (depth / length(offset));
        direction = normalize(offset);
    }
    return sqrt(area / max(abs(dot(normal, direction)), 1.2e-38));
}

fn ray_at(at: vec2f) -> TexelRay {
    let on_plane = on_plane_at(map.plane, at);
    let offset = on_plane.x * map.plane.right + on_plane.y * map.plane.down;
    if map.plane.is_parallel != 0u {
        return TexelRay(map.plane.origin + offset, map.plane.forward);
    }
    return TexelRay(map.plane.origin, normalize(map.plane.forward + offset));
}

// What the camera sees, if that is a receiver, or the first receiver along a ray of another map.
fn first_receiver(ray: TexelRay) -> ShownReceiver {
    if map.is_camera == 0u {
        return next_receiver(ray, ray_uniforms.offset);
    }
    let met = trace_to_texel(ray, 0.0, MEETS_FOR_CAMERA);
    if met.triangle == NO_TRIANGLE {
        return no_receiver();
    }
    let hit = describe(met, ray.direction);
    return ShownReceiver(hit, met.distance, (surfaces[hit.object].flags & RECEIVES_PHOTONS) != 0u);
}

// The first receiver along a ray from a distance on.
fn next_receiver(ray: TexelRay, from_distance: f32) -> ShownReceiver {
    var start = from_distance;
    for (var k = 0u; k < MAX_OTHERS; k++) {
        let met = trace_to_texel(ray, start, MEETS_FOR_LIGHT);
        if met.triangle == NO_TRIANGLE {
            break;
        }
        let hit = describe(met, ray.direction);
        if (surfaces[hit.object].flags & RECEIVES_PHOTONS) != 0u {
            return ShownReceiver(hit, met.distance, true);
        }
        start = met.distance + ray_uniforms.offset;
    }
    return no_receiver();
}

fn no_receiver() -> ShownReceiver {
    return ShownReceiver(Hit(NO_OBJECT, vec3f(0.0), vec3f(0.0), vec3f(0.0), false), 0.0, false);
}

fn trace_to_texel(ray: TexelRay, start: f32, meets: vec2u) -> RayHit {
    let met = trace_some(free_ray(ray.origin), ray.direction, start, 3e38, false, meets);
    if !met.is_complete {
        add_to_account(UNFINISHED, Steps(1u, 0u));
    }
    return met;
}

@compute @workgroup_size(8, 8)
fn place_photons(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if id.x < map.columns && id.y < map.rows {
        let index = id.y * map.columns + id.x;
        places[index] = place_of(photons[index], is_own_row(id.y));
    }
    close_account(local_index);
}

fn place_of(photon: Photon, is_own: bool) -> PhotonPlace {
    let at = projected(map.plane, photon.position);
    if photon.object == NO_OBJECT {
        return PhotonPlace(at, NO_PHOTON);
    }
    if !is_in_window(at) {
        return PhotonPlace(at, TEXEL_OFF_MAP);
    }
    let texel = surface_of(texel_at(at), photon);
    if texel == TEXEL_HIDDEN || height_over(texel, photon.position) > PHOTON_OFF_PLANE * texels[texel].edge {
        return PhotonPlace(at, TEXEL_HIDDEN);
    }
    if map.is_camera != 0u && !is_amid_surface(at, texel) {
        // At the edges of surfaces the middles of texels do not tell what hides a photon.
        let shown = first_receiver(ray_at(at));
        if !shown.is_there || distance(shown.hit.position, photon.position) > PHOTON_OFF_RAY * texels[texel].edge {
            if is_own {
                account_for(HIDDEN, sum_of_channels(photon.flux), map.steps_per_watt);
            }
            return PhotonPlace(at, NO_PHOTON);
        }
    }
    return PhotonPlace(at, texel);
}

fn height_over(texel: u32, point: vec3f) -> f32 {
    return abs(dot(point - texels[texel].position, texels[texel].normal));
}

// Whether all texels around one show the same surface.
fn is_amid_surface(at: vec2f, texel: u32) -> bool {
    let own = texels[texel];
    let centre = vec2i(at);
    for (var dy = -1; dy <= 1; dy++) {
        for (var dx = -1; dx <= 1; dx++) {
            let other = centre + vec2i(dx, dy);
            if any(other < vec2i(0)) || any(other >= vec2i(map.size)) {
                return false;
            }
            let shown = texels[u32(other.y) * map.size.x + u32(other.x)];
            if shown.object != own.object || dot(shown.normal, own.normal) < SAME_SURFACE_COSINE {
                return false;
            }
        }
    }
    return true;
}

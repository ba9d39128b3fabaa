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

// Through how many other surfaces maps look at most.
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
    var shown = next_receiver(ray, ray_uniforms.offset);
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

// The first receiver along a ray from a distance on.
fn next_receiver(ray: TexelRay, from_distance: f32) -> ShownReceiver {
    var start = from_distance;
    for (var k = 0u; k < MAX_OTHERS; k++) {
        let met = trace_some(free_ray(ray.origin), ray.direction, start, 3e38, false, MEETS_FOR_LIGHT);
        if !met.is_complete {
            add_to_account(UNFINISHED, Steps(1u, 0u));
        }
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

@compute @workgroup_size(8, 8)
fn place_photons(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if id.x < map.columns && id.y < map.rows {
        let index = id.y * map.columns + id.x;
        places[index] = place_of(photons[index]);
    }
    close_account(local_index);
}

fn place_of(photon: Photon) -> PhotonPlace {
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
    return PhotonPlace(at, texel);
}

fn height_over(texel: u32, point: vec3f) -> f32 {
    return abs(dot(point - texels[texel].position, texels[texel].normal));
}

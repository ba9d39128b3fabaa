// What the texels of a caustic map show, and where photons land in it. CPU twin: src/image_space/caustic_map.rs.

#import hits
#import photon_map

// What a texel's ray shows.
struct ShownReceiver {
    hit: Hit,
    is_there: bool,
}

@group(1) @binding(0) var<storage, read> surfaces: array<PhotonSurface>;

// Through how many other surfaces maps of the receivers alone look at most.
const MAX_OTHERS: u32 = 64u;

@compute @workgroup_size(8, 8)
fn find_receivers(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if all(id.xy < map.size) {
        let index = id.y * map.size.x + id.x;
        let shown = receiver_at(vec2f(id.xy) + 0.5);
        texels[index] = MapTexel(vec3f(0.0), NO_OBJECT, vec3f(0.0), 0.0);
        if shown.is_there {
            let position = shown.hit.position;
            let normal = shown.hit.face_normal;
            texels[index] = MapTexel(position, shown.hit.object, normal, texel_edge(position, normal));
        }
    }
    close_account(local_index);
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

// The receiver that the ray through a place shows.
fn receiver_at(at: vec2f) -> ShownReceiver {
    let on_plane = on_plane_at(map.plane, at);
    let offset = on_plane.x * map.plane.right + on_plane.y * map.plane.down;
    let is_parallel = map.plane.is_parallel != 0u;
    let origin = select(map.plane.origin, map.plane.origin + offset, is_parallel);
    let direction = select(normalize(map.plane.forward + offset), map.plane.forward, is_parallel);
    let is_camera = map.is_camera != 0u;
    let meets = select(MEETS_FOR_LIGHT, MEETS_FOR_CAMERA, is_camera);
    var start = select(ray_uniforms.offset, 0.0, is_camera);
    var hit = Hit(NO_OBJECT, vec3f(0.0), vec3f(0.0), vec3f(0.0), false);
    for (var k = 0u; k < MAX_OTHERS; k++) {
        let met = trace_some(free_ray(origin), direction, start, 3e38, false, meets);
        if !met.is_complete {
            add_to_account(UNFINISHED, Steps(1u, 0u));
        }
        if met.triangle == NO_TRIANGLE {
            break;
        }
        hit = describe(met, direction);
        let receives = (surfaces[hit.object].flags & RECEIVES_PHOTONS) != 0u;
        if receives || is_camera {
            return ShownReceiver(hit, receives);
        }
        start = met.distance + ray_uniforms.offset;
    }
    return ShownReceiver(hit, false);
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
    if photon.object == NO_OBJECT {
        return PhotonPlace(vec2f(BEHIND_PLANE), NO_PHOTON);
    }
    let at = projected(map.plane, photon.position);
    if !is_in_window(at) {
        return PhotonPlace(at, TEXEL_OFF_MAP);
    }
    let texel = texel_at(at);
    if !shows(texel, photon) {
        return PhotonPlace(at, TEXEL_HIDDEN);
    }
    if !is_amid_surface(at, texel) {
        // At the edges of surfaces the middles of texels do not tell what hides a photon.
        let shown = receiver_at(at);
        if !shown.is_there || distance(shown.hit.position, photon.position) > PHOTON_OFF_RAY * texels[texel].edge {
            if is_own {
                account_for(HIDDEN, sum_of_channels(photon.flux), map.steps_per_watt);
            }
            return PhotonPlace(at, NO_PHOTON);
        }
    }
    return PhotonPlace(at, texel);
}

// Whether a texel shows a photon's place on the receiver, from the side that it arrives on.
fn shows(texel: u32, photon: Photon) -> bool {
    let shown = texels[texel];
    let height = abs(dot(photon.position - shown.position, shown.normal));
    return is_surface_of(texel, photon) && height <= PHOTON_OFF_PLANE * shown.edge;
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

// What the texels of a caustic map show, and where photons land in it. CPU twins: src/render/image_space/receiver_layers.rs and
// caustic_map.rs.

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

// Through how many other surfaces maps of the receivers alone look at most.
const MAX_OTHERS: u32 = 64u;

// How many layers there are: the most that a ray meets, in the first of `counts`.
@compute @workgroup_size(8, 8)
fn count_layers(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if all(id.xy < map.size) {
        let ray = ray_at(vec2f(id.xy) + 0.5);
        var layers = 0u;
        var start = ray_uniforms.offset;
        var last = no_texel();
        for (var k = 0u; k < MAX_RECEIVER_LAYERS; k++) {
            let shown = next_receiver(ray, start);
            if !shown.is_there {
                break;
            }
            let texel = texel_of(shown.hit);
            if !is_continued(last, texel) {
                last = texel;
                layers++;
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
    for (var layer = 0u; layer < map.layers; layer++) {
        texels[first + layer * texel_count()] = no_texel();
    }
    var shown = first_receiver(ray);
    var layer = 0u;
    var last = no_texel();
    for (var k = 0u; k < MAX_RECEIVER_LAYERS && shown.is_there && layer < map.layers; k++) {
        let texel = texel_of(shown.hit);
        // What lies just behind is the same surface, as far as the map can tell.
        if !is_continued(last, texel) {
            texels[first + layer * texel_count()] = texel;
            last = texel;
            layer++;
        }
        // In the camera's map the second layer keeps what is in the middle until all edges are found.
        if map.is_camera == 0u {
            shown = next_receiver(ray, shown.distance + ray_uniforms.offset);
        } else {
            texels[first + texel_count()] = texel;
            break;
        }
    }
}

// Whether a surface behind another one is the same, as far as the map can tell.
fn is_continued(last: MapTexel, texel: MapTexel) -> bool {
    return last.object != NO_OBJECT && is_surface_near(last, texel);
}

fn no_texel() -> MapTexel {
    return MapTexel(vec3f(0.0), NO_OBJECT, 0.0, 1.0, 0u);
}

fn texel_of(hit: Hit) -> MapTexel {
    let normal = hit.face_normal;
    return MapTexel(hit.position, hit.object, texel_edge(hit.position, normal), 1.0, packed_unit(normal));
}

// The largest and the second largest part of a texel of the camera's map.
struct TexelParts {
    first: MapTexel,
    second: MapTexel,
}

// Finds what texels of the camera's map at the edges of surfaces show side by side: the largest part goes to the first layer, the second
// largest to the sums, which are empty as yet, as the second layer tells other texels what they are next to.
@compute @workgroup_size(8, 8)
fn find_parts(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if all(id.xy < map.size) {
        var parts = TexelParts(texels[id.y * map.size.x + id.x], no_texel());
        if is_at_edge(id.xy) {
            parts = parts_of(id.xy);
        }
        let first = id.y * map.size.x + id.x;
        texels[first] = parts.first;
        keep_in_sums(first, parts.second);
    }
    close_account(local_index);
}

// Moves the second parts to where they belong.
@compute @workgroup_size(8, 8)
fn settle_parts(@builtin(global_invocation_id) id: vec3u) {
    if all(id.xy < map.size) {
        let first = id.y * map.size.x + id.x;
        texels[first + texel_count()] = take_from_sums(first);
    }
}

// As many words as a texel has, of those that the sums of both layers have at least.
const WORDS_OF_TEXEL: u32 = 7u;
const WORDS_OF_SUMS: u32 = 12u;

fn keep_in_sums(first: u32, kept: MapTexel) {
    let words = array<u32, WORDS_OF_TEXEL>(
        bitcast<u32>(kept.position.x),
        bitcast<u32>(kept.position.y),
        bitcast<u32>(kept.position.z),
        kept.object,
        bitcast<u32>(kept.edge),
        bitcast<u32>(kept.part),
        kept.normal,
    );
    for (var k = 0u; k < WORDS_OF_TEXEL; k++) {
        atomicStore(&sums[WORDS_OF_SUMS * first + k], words[k]);
    }
}

fn take_from_sums(first: u32) -> MapTexel {
    var words = array<u32, WORDS_OF_TEXEL>();
    for (var k = 0u; k < WORDS_OF_TEXEL; k++) {
        words[k] = atomicExchange(&sums[WORDS_OF_SUMS * first + k], 0u);
    }
    let position = bitcast<vec3f>(vec3u(words[0], words[1], words[2]));
    return MapTexel(position, words[3], bitcast<f32>(words[4]), bitcast<f32>(words[5]), words[6]);
}

// Whether texels around one show something else than it does in the middle.
fn is_at_edge(place: vec2u) -> bool {
    let own = texels[place.y * map.size.x + place.x + texel_count()];
    for (var dy = -1; dy <= 1; dy++) {
        for (var dx = -1; dx <= 1; dx++) {
            let other = vec2i(place) + vec2i(dx, dy);
            if all(other >= vec2i(0)) && all(other < vec2i(map.size)) {
                if !continues(own, texels[u32(other.y) * map.size.x + u32(other.x) + texel_count()]) {
                    return true;
                }
            }
        }
    }
    return false;
}

// Whether another texel shows the same surface, or neither shows any.
fn continues(own: MapTexel, other: MapTexel) -> bool {
    if own.object == NO_OBJECT || other.object == NO_OBJECT {
        return own.object == other.object;
    }
    let normal = unpacked_unit(own.normal);
    let height = abs(dot(other.position - own.position, normal));
    let is_one_surface = height <= select(PHOTON_OFF_PLANE, 2.0, own.object == other.object) * own.edge;
    return is_one_surface && dot(normal, unpacked_unit(other.normal)) >= SAME_SURFACE_COSINE;
}

// Whether the place of another texel is in the plane of one, as far as the map can tell, and faces the same way.
fn is_surface_near(own: MapTexel, other: MapTexel) -> bool {
    let normal = unpacked_unit(own.normal);
    return dot(normal, unpacked_unit(other.normal)) >= SAME_SURFACE_COSINE
        && abs(dot(other.position - own.position, normal)) <= PHOTON_OFF_PLANE * own.edge;
}

// The surfaces that rays through a texel meet first.
fn parts_of(place: vec2u) -> TexelParts {
    const RAYS: u32 = EDGE_RAYS * EDGE_RAYS;
    var found = array<MapTexel, MAX_EDGE_SURFACES>();
    var off_middle = array<f32, MAX_EDGE_SURFACES>();
    var rays = array<u32, MAX_EDGE_SURFACES>();
    var count = 0u;
    for (var k = 0u; k < RAYS; k++) {
        let i = k % EDGE_RAYS;
        let j = k / EDGE_RAYS;
        // Each row and each column of so many has one ray.
        let at = (vec2f(vec2u(EDGE_RAYS * i + j, EDGE_RAYS * j + EDGE_RAYS - 1u - i)) + 0.5) / f32(RAYS);
        let shown = first_receiver(ray_at(vec2f(place) + at));
        if !shown.is_there {
            continue;
        }
        let texel = texel_of(shown.hit);
        let off = dot(at - 0.5, at - 0.5);
        var n = 0u;
        while n < count && !is_surface_near(found[n], texel) {
            n++;
        }
        if n == MAX_EDGE_SURFACES {
            continue;
        }
        if n == count || off < off_middle[n] {
            found[n] = texel;
            off_middle[n] = off;
        }
        count = max(count, n + 1u);
        rays[n]++;
    }
    var parts = TexelParts(no_texel(), no_texel());
    var first = 0u;
    var second = MAX_EDGE_SURFACES;
    for (var n = 1u; n < count; n++) {
        if rays[n] > rays[first] {
            first = n;
        }
    }
    for (var n = 0u; n < count; n++) {
        if n != first && (second == MAX_EDGE_SURFACES || rays[n] > rays[second]) {
            second = n;
        }
    }
    if count > 0u {
        parts.first = found[first];
        parts.first.part = f32(rays[first]) / f32(RAYS);
    }
    if second < count {
        parts.second = found[second];
        parts.second.part = f32(rays[second]) / f32(RAYS);
    }
    return parts;
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
    if texels[texel].part < 1.0 {
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
    return abs(dot(point - texels[texel].position, unpacked_unit(texels[texel].normal)));
}

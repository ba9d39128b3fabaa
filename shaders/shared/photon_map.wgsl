// Caustic maps that photons are added to. CPU twins: src/render/image_space/caustic_map.rs and projection.rs; layout:
// src/render/image_space/gpu/layout.rs.

#import microfacets
#import photons
#import plane

// A map, and the photons that are added.
struct PhotonMap {
    plane: Plane,
    size: vec2u,
    // What it shows is what the camera sees; otherwise the receivers alone.
    is_camera: u32,
    // What glossy receivers have to know: KEEPS_DIRECTIONS and so on.
    kept: u32,
    // Rows of photons, and which of them are added.
    columns: u32,
    rows: u32,
    first_own_row: u32,
    own_rows: u32,
    steps_per_watt: f32,
    // Photons beside its window belong to another map.
    is_one_of_many: u32,
    // MODE_POINTS and so on.
    mode: u32,
    // Of splats of one size, texels.
    diameter: f32,
    // The distance between photons: metres of parallel views, tangents of central ones.
    spacing: f32,
    // The first of these rows is the first of the view.
    is_first: u32,
    // Receivers that each texel shows at most: one behind the other or, in the camera's map, side by side.
    layers: u32,
    // Photons come in clusters of 2×2 (1), or each stands for such a cluster, whose other photons follow it (2); 0: in rows.
    clusters: u32,
    // The position of the lamp or, if it is far, the direction in which its light travels.
    light: vec3f,
    is_light_far: u32,
    // Polygons are drawn alone: what belongs to none is culled.
    is_alone: u32,
    // The distance between photons of all frames that are averaged, relative to that of one frame's.
    frame_spacing: f32,
}

// A receiver that a texel shows; layer by layer.
struct MapTexel {
    position: vec3f,
    // NO_OBJECT: no receiver.
    object: u32,
    // The edge of a square with the area that the whole texel covers on the plane of the receiver, metres.
    edge: f32,
    // The part of the texel in which it is seen.
    part: f32,
    // Of its triangle, towards the viewer; a packed unit vector.
    normal: u32,
}

// Where a photon lands in the map.
struct PhotonPlace {
    // Texels; it may be outside of the window.
    at: vec2f,
    // The index of the texel that shows it, or one of those below.
    texel: u32,
}

const TEXEL_OFF_MAP: u32 = 0xffffffffu;
const TEXEL_HIDDEN: u32 = 0xfffffffeu;
// There is no photon, or something hides it.
const NO_PHOTON: u32 = 0xfffffffdu;

@group(0) @binding(0) var<uniform> map: PhotonMap;
@group(0) @binding(1) var<storage, read_write> photons: array<Photon>;
@group(0) @binding(2) var<storage, read_write> ways: array<PhotonWay>;
@group(0) @binding(3) var<storage, read_write> ledger: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read_write> texels: array<MapTexel>;
@group(0) @binding(5) var<storage, read_write> places: array<PhotonPlace>;
// For each size of splats and each texel: flux, then what is kept for glossy receivers. Two words each, signed.
@group(0) @binding(6) var<storage, read_write> sums: array<atomic<u32>>;
// For each size of splats and each texel: photons.
@group(0) @binding(7) var<storage, read_write> counts: array<atomic<u32>>;
@group(1) @binding(0) var<storage, read> surfaces: array<PhotonSurface>;

// Texels of a layer.
fn texel_count() -> u32 {
    return map.size.x * map.size.y;
}

fn is_in_window(at: vec2f) -> bool {
    return all(at >= vec2f(0.0)) && all(at < vec2f(map.size));
}

// The texel of the first layer at a place.
fn texel_at(at: vec2f) -> u32 {
    return u32(at.y) * map.size.x + u32(at.x);
}

// Of the layers of a texel, that whose plane lies nearest to a point of a surface which is about as it is oriented there: of the same object, or
// of one that continues it in its plane. TEXEL_HIDDEN if there is none.
fn surface_at(first: u32, object: u32, normal: vec3f, point: vec3f) -> u32 {
    var nearest = TEXEL_HIDDEN;
    var least = 3e38;
    for (var layer = 0u; layer < map.layers; layer++) {
        let texel = first + layer * texel_count();
        let shown = texels[texel];
        if shown.object == NO_OBJECT {
            continue;
        }
        let facing = unpacked_unit(shown.normal);
        let height = abs(dot(point - shown.position, facing));
        let is_its = shown.object == object || height <= PHOTON_OFF_PLANE * shown.edge;
        if is_its && dot(facing, normal) >= SAME_SURFACE_COSINE && height < least {
            nearest = texel;
            least = height;
        }
    }
    return nearest;
}

// The same for the surface that a photon lands on.
fn surface_of(first: u32, photon: Photon) -> u32 {
    return surface_at(first, photon.object, unpacked_unit(photon.normal), photon.position);
}

// Adds flux to a texel. `size`: which of several sizes of splats it comes from.
fn deposit(size: u32, texel: u32, flux: vec3f, photon: Photon) {
    let words = select(6u, 12u, map.kept != KEEPS_NOTHING);
    let first = words * (size * map.layers * texel_count() + texel);
    for (var k = 0u; k < 3u; k++) {
        add_to_sums(first + 2u * k, steps_of(flux[k], map.steps_per_watt));
    }
    if map.kept != KEEPS_NOTHING && size == 0u {
        let kept = for_gloss(flux, photon);
        for (var k = 0u; k < 3u; k++) {
            add_to_sums(first + 6u + 2u * k, steps_of(kept[k], map.steps_per_watt));
        }
    }
}

// What glossy receivers have to know of flux of a photon.
fn for_gloss(flux: vec3f, photon: Photon) -> vec3f {
    if map.kept == KEEPS_DIRECTIONS {
        return sum_of_channels(flux) * unpacked_unit(photon.direction);
    }
    if map.kept == KEEPS_UNDEFLECTED {
        return sum_of_channels(flux) * select(normalize(photon.position - map.light), map.light, map.is_light_far != 0u);
    }
    let away = select(normalize(photon.position - map.plane.origin), map.plane.forward, map.plane.is_parallel != 0u);
    let surface = surfaces[photon.object];
    let normal = unpacked_unit(photon.normal);
    let towards = -unpacked_unit(photon.direction);
    return flux * lobe_brdf(surface.kind, surface.albedo, surface.specular, surface.width, normal, towards, -away);
}

fn add_to_sums(first: u32, steps: Steps) {
    if steps.low == 0u && steps.high == 0u {
        return;
    }
    let before = atomicAdd(&sums[first], steps.low);
    let high = steps.high + select(0u, 1u, before > ~steps.low);
    if high != 0u {
        atomicAdd(&sums[first + 1u], high);
    }
}

// Accounts for flux beside the window, unless it belongs to another map.
fn account_off_map(watts: f32) {
    if map.is_one_of_many == 0u {
        account_for(OFF_MAP, watts, map.steps_per_watt);
    }
}

fn is_own_row(row: u32) -> bool {
    return row >= map.first_own_row && row < map.first_own_row + map.own_rows;
}

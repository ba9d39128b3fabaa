// Caustic maps that photons are added to. CPU twins: src/image_space/caustic_map.rs and projection.rs; layout:
// src/image_space/gpu/layout.rs.

#import photons
#import plane

// A map, and the photons that are added.
struct PhotonMap {
    plane: Plane,
    size: vec2u,
    // What it shows is what the camera sees; otherwise the receivers alone.
    is_camera: u32,
    // The mean direction of the light is needed, too.
    has_directions: u32,
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
}

// What a texel shows in its middle.
struct MapTexel {
    position: vec3f,
    // NO_OBJECT: no receiver.
    object: u32,
    // Of its triangle, towards the viewer.
    normal: vec3f,
    // The edge of a square with the area that the texel covers on the receiver, metres.
    edge: f32,
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
// Flux in each texel, then the light's direction times it, if that is needed; layer by layer. Two words each, signed.
@group(0) @binding(6) var<storage, read_write> sums: array<atomic<u32>>;
// Photons in each texel, layer by layer.
@group(0) @binding(7) var<storage, read_write> counts: array<atomic<u32>>;

fn texel_count() -> u32 {
    return map.size.x * map.size.y;
}

fn is_in_window(at: vec2f) -> bool {
    return all(at >= vec2f(0.0)) && all(at < vec2f(map.size));
}

fn texel_at(at: vec2f) -> u32 {
    return u32(at.y) * map.size.x + u32(at.x);
}

// Whether a texel shows the receiver that a photon lands on, about as it is oriented there.
fn is_surface_of(texel: u32, photon: Photon) -> bool {
    let shown = texels[texel];
    return shown.object == photon.object && dot(shown.normal, unpacked_unit(photon.normal)) >= SAME_SURFACE_COSINE;
}

// Adds flux to a texel of a layer.
fn deposit(layer: u32, texel: u32, flux: vec3f, photon: Photon) {
    let words = select(6u, 12u, map.has_directions != 0u);
    let first = words * (layer * texel_count() + texel);
    for (var k = 0u; k < 3u; k++) {
        add_to_sums(first + 2u * k, steps_of(flux[k], map.steps_per_watt));
    }
    if map.has_directions != 0u && layer == 0u {
        let directed = sum_of_channels(flux) * unpacked_unit(photon.direction);
        for (var k = 0u; k < 3u; k++) {
            add_to_sums(first + 6u + 2u * k, steps_of(directed[k], map.steps_per_watt));
        }
    }
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

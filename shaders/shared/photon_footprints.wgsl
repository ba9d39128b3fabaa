// Gaussian splats, and the footprints of photons. CPU twins: src/render/image_space/splats.rs and `differences` in photons.rs.

#import photon_map
#import photon_sheet

// A Gaussian in texels.
struct Splat {
    // The inverse of the covariance: xx, xy, yy.
    inverse: vec3f,
    // Half the width and height of the rectangle that it is cut to.
    reach: vec2f,
}

// How a value of photons changes from column to column and from row to row.
struct Differences {
    along_row: vec3f,
    along_column: vec3f,
    are_known: bool,
}

fn splat_weight(splat: Splat, offset: vec2f) -> f32 {
    let squared = splat.inverse.x * offset.x * offset.x + 2.0 * splat.inverse.y * offset.x * offset.y
        + splat.inverse.z * offset.y * offset.y;
    return exp(-0.5 * squared);
}

// Adds flux of a photon with weights that add up to 1 over the texels that the splat reaches on the receiver.
fn add_splat(size: u32, splat: Splat, photon: Photon, flux: vec3f, place: PhotonPlace) {
    let low = vec2i(max(floor(place.at - splat.reach + 0.5), vec2f(0.0)));
    let high = vec2i(min(ceil(place.at + splat.reach - 0.5), vec2f(map.size)));
    var total = 0.0;
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let texel = surface_of(u32(y) * map.size.x + u32(x), photon);
            if texel != TEXEL_HIDDEN {
                total += texels[texel].part * splat_weight(splat, vec2f(vec2i(x, y)) + 0.5 - place.at);
            }
        }
    }
    if total <= 1e-12 {
        deposit(size, place.texel, flux, photon);
        return;
    }
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let texel = surface_of(u32(y) * map.size.x + u32(x), photon);
            if texel != TEXEL_HIDDEN {
                let weight = texels[texel].part * splat_weight(splat, vec2f(vec2i(x, y)) + 0.5 - place.at);
                deposit(size, texel, weight / total * flux, photon);
            }
        }
    }
}

// Footprints: the parallelogram between neighbours, or between those of other frames, which are that part as far away.
fn footprint_splat(sides: Differences, frame_spacing: f32) -> Splat {
    let u = frame_spacing * sides.along_row.xy;
    let v = frame_spacing * sides.along_column.xy;
    let even = FOOTPRINT_OVERLAP * FOOTPRINT_OVERLAP / 12.0;
    let squares = u * u + v * v;
    let largest = SPLAT_REACH * sqrt(even * max(squares.x, squares.y));
    // Very large footprints are hardly seen: they are cut.
    let cut = min(0.5 * MAX_SPLAT_DIAMETER / max(largest, 1e-30), 1.0);
    let scale = even * cut * cut;
    let least = MIN_FOOTPRINT_DEVIATION * MIN_FOOTPRINT_DEVIATION;
    let xx = scale * squares.x + least;
    let xy = scale * (u.x * u.y + v.x * v.y);
    let yy = scale * squares.y + least;
    return Splat(vec3f(yy, -xy, xx) / (xx * yy - xy * xy), SPLAT_REACH * sqrt(vec2f(xx, yy)) + 0.5);
}

// Values of photons that are compared with those of their neighbours.
const DIFFERENCE_OF_PLACES: u32 = 0u;
const DIFFERENCE_OF_FIRST: u32 = 1u;
const DIFFERENCE_OF_FIRST_NORMALS: u32 = 2u;
const DIFFERENCE_OF_LAST: u32 = 3u;
const DIFFERENCE_OF_LAST_NORMALS: u32 = 4u;

fn value_of(index: u32, kind: u32) -> vec3f {
    switch kind {
        case DIFFERENCE_OF_FIRST { return ways[index].first; }
        case DIFFERENCE_OF_FIRST_NORMALS { return ways[index].first_normal; }
        case DIFFERENCE_OF_LAST { return ways[index].last; }
        case DIFFERENCE_OF_LAST_NORMALS { return ways[index].last_normal; }
        default { return vec3f(places[index].at, 0.0); }
    }
}

// The photon next to one that its value can be compared with, or NOWHERE.
fn neighbour(place: vec2u, dx: i32, dy: i32, kind: u32) -> u32 {
    let index = place.y * map.columns + place.x;
    let other = photon_at(i32(place.x) + dx, i32(place.y) + dy);
    if other == NOWHERE {
        return NOWHERE;
    }
    if kind == DIFFERENCE_OF_PLACES {
        return select(NOWHERE, other, are_connected(i32(place.x), i32(place.y), dx, dy));
    }
    let normals = select(DIFFERENCE_OF_LAST_NORMALS, DIFFERENCE_OF_FIRST_NORMALS, kind <= DIFFERENCE_OF_FIRST_NORMALS);
    let is_smooth = dot(value_of(index, normals), value_of(other, normals)) > SMOOTH_LENS_COSINE;
    return select(NOWHERE, other, is_smooth && photons[index].caster == photons[other].caster);
}

fn differences(place: vec2u, kind: u32) -> Differences {
    if map.clusters != 0u {
        return differences_in_cluster(place.y * map.columns + place.x, kind);
    }
    // To the left and right, above and below.
    var neighbours: vec4u;
    for (var k = 0; k < 4; k++) {
        let step = select(-1, 1, (k & 1) == 1);
        neighbours[k] = neighbour(place, select(step, 0, k > 1), select(0, step, k > 1), kind);
    }
    let are_there = neighbours != vec4u(NOWHERE);
    let index = place.y * map.columns + place.x;
    if !(any(are_there.xy) && any(are_there.zw)) {
        return Differences(vec3f(0.0), vec3f(0.0), false);
    }
    let along_row = between(index, neighbours.x, neighbours.y, kind);
    return Differences(along_row, between(index, neighbours.z, neighbours.w, kind), true);
}

// Half the difference between neighbours or, where one of them is missing, that to the other one.
fn between(index: u32, before: u32, after: u32, kind: u32) -> vec3f {
    let first = select(before, index, before == NOWHERE);
    let last = select(after, index, after == NOWHERE);
    let steps = select(1.0, 2.0, before != NOWHERE && after != NOWHERE);
    return (value_of(last, kind) - value_of(first, kind)) / steps;
}

// How places change from photon to photon of a cluster, or of the grid of these clusters.
fn differences_in_cluster(index: u32, kind: u32) -> Differences {
    let nothing = Differences(vec3f(0.0), vec3f(0.0), false);
    if kind != DIFFERENCE_OF_PLACES {
        return nothing;
    }
    let first = index & ~3u;
    let b = places[first + 1u].at;
    let c = places[first + 2u].at;
    let d = places[first + 3u].at;
    if map.clusters == 2u {
        // The first of them is in the middle of all.
        let a = 4.0 * places[first].at - b - c - d;
        return Differences(vec3f(b - a + d - c, 0.0), vec3f(c - a + d - b, 0.0), true);
    }
    let a = places[first].at;
    var is_there = array<bool, 4>();
    for (var k = 0u; k < 4u; k++) {
        is_there[k] = photons[first + k].object != NO_OBJECT;
    }
    let along_row = mean_of(b - a, is_there[0] && is_there[1], d - c, is_there[2] && is_there[3]);
    let along_column = mean_of(c - a, is_there[0] && is_there[2], d - b, is_there[1] && is_there[3]);
    let are_known = along_row.z > 0.0 && along_column.z > 0.0;
    return Differences(vec3f(along_row.xy, 0.0), vec3f(along_column.xy, 0.0), are_known);
}

// The mean of those of two values that are there; 0 in the third component: none is.
fn mean_of(one: vec2f, has_one: bool, other: vec2f, has_other: bool) -> vec3f {
    let weights = vec2f(select(0.0, 1.0, has_one), select(0.0, 1.0, has_other));
    let sum = weights.x * one + weights.y * other;
    return vec3f(sum / max(weights.x + weights.y, 1.0), weights.x + weights.y);
}

// Adds photons to a caustic map as points and as Gaussian splats. CPU twins: src/image_space/splats.rs, lens.rs and multi_resolution.rs.

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

@compute @workgroup_size(8, 8)
fn add_splats(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    if id.x < map.columns && id.y < map.rows && is_own_row(id.y) {
        add_photon(id.xy);
    }
    close_account(local_index);
}

fn add_photon(place: vec2u) {
    let index = place.y * map.columns + place.x;
    let texel = places[index].texel;
    if texel == NO_PHOTON {
        return;
    }
    let photon = photons[index];
    let watts = sum_of_channels(photon.flux);
    if texel == TEXEL_OFF_MAP {
        account_off_map(watts);
        return;
    }
    if texel == TEXEL_HIDDEN {
        account_for(HIDDEN, watts, map.steps_per_watt);
        return;
    }
    if map.mode != MODE_GATHER && map.mode != MODE_MULTI_RESOLUTION {
        // What arrives of the others is known in the end.
        account_for(DEPOSITED, watts, map.steps_per_watt);
    }
    switch map.mode {
        case MODE_SPLATS {
            add_splat(0u, round_splat(map.diameter), photon, places[index]);
        }
        case MODE_THIN_LENS, MODE_THICK_LENS {
            add_splat(0u, round_splat(lens_diameter(place, photon, texel)), photon, places[index]);
        }
        case MODE_FOOTPRINTS {
            add_footprint(place, photon, places[index]);
        }
        case MODE_MULTI_RESOLUTION {
            if map.clusters != 0u {
                account_for(DEPOSITED, watts, map.steps_per_watt);
                add_in_its_resolution(place, photon, places[index]);
                return;
            }
            for (var size = 0u; size < SPLAT_SIZES; size++) {
                let diameter = FIRST_SPLAT_DIAMETER + SPLAT_DIAMETER_STEP * size;
                add_splat(size, round_splat(f32(diameter)), photon, places[index]);
                count_reached(size, i32(diameter), photon, texel);
            }
        }
        default {
            deposit(0u, texel, photon.flux, photon);
            if map.mode == MODE_GATHER {
                atomicAdd(&counts[texel], 1u);
            }
        }
    }
}

// Adds a photon of a cluster in the resolution that fits it: as a splat of the least of the four sizes that covers the part of the receiver that
// it stands for, or as a point where that is within a texel.
fn add_in_its_resolution(place: vec2u, photon: Photon, landed: PhotonPlace) {
    let sides = differences(place, DIFFERENCE_OF_PLACES);
    let extent = select(0.0, max(length(sides.along_row.xy), length(sides.along_column.xy)), sides.are_known);
    let wanted = LENS_SPACINGS * extent;
    if wanted <= 1.0 {
        deposit(0u, landed.texel, photon.flux, photon);
        return;
    }
    var size = 0u;
    while size + 1u < SPLAT_SIZES && f32(FIRST_SPLAT_DIAMETER + SPLAT_DIAMETER_STEP * size) < wanted {
        size++;
    }
    add_splat(0u, round_splat(f32(FIRST_SPLAT_DIAMETER + SPLAT_DIAMETER_STEP * size)), photon, landed);
}

// A round splat with a diameter, in a square of that size.
fn round_splat(diameter: f32) -> Splat {
    let deviation = SPLAT_DEVIATION * diameter;
    let inverse = 1.0 / (deviation * deviation);
    return Splat(vec3f(inverse, 0.0, inverse), vec2f(0.5 * max(diameter, 1.0)));
}

fn splat_weight(splat: Splat, offset: vec2f) -> f32 {
    let squared = splat.inverse.x * offset.x * offset.x + 2.0 * splat.inverse.y * offset.x * offset.y
        + splat.inverse.z * offset.y * offset.y;
    return exp(-0.5 * squared);
}

// Adds a photon with weights that add up to 1 over the texels that the splat reaches on the receiver.
fn add_splat(size: u32, splat: Splat, photon: Photon, place: PhotonPlace) {
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
        deposit(size, place.texel, photon.flux, photon);
        return;
    }
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let texel = surface_of(u32(y) * map.size.x + u32(x), photon);
            if texel != TEXEL_HIDDEN {
                let weight = texels[texel].part * splat_weight(splat, vec2f(vec2i(x, y)) + 0.5 - place.at);
                deposit(size, texel, weight / total * photon.flux, photon);
            }
        }
    }
}

// Counts a photon in the texels of a disc around it that show the same surface.
fn count_reached(size: u32, diameter: i32, photon: Photon, texel: u32) {
    let own = texels[texel];
    let in_layer = texel % texel_count();
    let centre = vec2i(vec2u(in_layer % map.size.x, in_layer / map.size.x));
    let reach = diameter / 2;
    for (var dy = -reach; dy <= reach; dy++) {
        for (var dx = -reach; dx <= reach; dx++) {
            let other = centre + vec2i(dx, dy);
            let is_reached = 4 * (dx * dx + dy * dy) <= diameter * diameter;
            if is_reached && all(other >= vec2i(0)) && all(other < vec2i(map.size)) {
                let first = u32(other.y) * map.size.x + u32(other.x);
                let reached = surface_at(first, own.object, unpacked_unit(own.normal), own.position);
                if reached != TEXEL_HIDDEN {
                    atomicAdd(&counts[size * map.layers * texel_count() + reached], 1u);
                }
            }
        }
    }
}

// Footprints: the parallelogram between neighbours.
fn add_footprint(place: vec2u, photon: Photon, landed: PhotonPlace) {
    let sides = differences(place, DIFFERENCE_OF_PLACES);
    if !sides.are_known {
        deposit(0u, landed.texel, photon.flux, photon);
        return;
    }
    let u = sides.along_row.xy;
    let v = sides.along_column.xy;
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
    let splat = Splat(vec3f(yy, -xy, xx) / (xx * yy - xy * xy), SPLAT_REACH * sqrt(vec2f(xx, yy)) + 0.5);
    add_splat(0u, splat, photon, landed);
}

// The diameter of a splat whose size follows from a lens equation, texels.
fn lens_diameter(place: vec2u, photon: Photon, texel: u32) -> f32 {
    let index = place.y * map.columns + place.x;
    let way = ways[index];
    let factor = lens_factor(place, photon, way);
    let cosine = max(-dot(unpacked_unit(photon.direction), unpacked_unit(photon.normal)), 0.05);
    // Where photons would land without mirrors and interfaces.
    let length = select(1.0 / photon.inverse_before + way.within + photon.beyond, 1.0, photon.inverse_before == 0.0);
    let undistorted = LENS_SPACINGS * length * map.spacing / sqrt(cosine) / texels[texel].edge;
    return clamp(undistorted * factor, MIN_SPLAT_DIAMETER, MAX_SPLAT_DIAMETER);
}

// The width of a photon's bundle at the receiver, relative to what it would be without mirrors and interfaces.
fn lens_factor(place: vec2u, photon: Photon, way: PhotonWay) -> f32 {
    let front = mean_curvature(differences(place, DIFFERENCE_OF_FIRST), differences(place, DIFFERENCE_OF_FIRST_NORMALS));
    if !front.is_known {
        return 1.0;
    }
    let n = surfaces[photon.caster].eta.y;
    let is_refracted = n > 0.0 && dot(unpacked_unit(photon.direction), way.last_normal) <= 0.0;
    if !is_refracted {
        return single_lens(photon, way, -2.0 * front.value, 1.0);
    }
    if way.within == 0.0 {
        return single_lens(photon, way, (n - 1.0) * front.value, n);
    }
    let back = mean_curvature(differences(place, DIFFERENCE_OF_LAST), differences(place, DIFFERENCE_OF_LAST_NORMALS));
    if !back.is_known {
        return 1.0;
    }
    // Normals inside a convex object diverge towards its surface.
    let first = (n - 1.0) * front.value;
    let second = -(n - 1.0) * back.value;
    if map.mode == MODE_THIN_LENS {
        return single_lens(photon, way, first + second, 1.0);
    }
    let vergence = first - photon.inverse_before;
    let narrowed = 1.0 - way.within * vergence / n;
    let width = abs(narrowed - photon.beyond * (vergence + narrowed * second));
    return width / (1.0 + (way.within + photon.beyond) * photon.inverse_before);
}

// One surface of a power, 1/m; behind it the refractive index is n.
fn single_lens(photon: Photon, way: PhotonWay, power: f32, n: f32) -> f32 {
    let vergence = (power - photon.inverse_before) / n;
    return abs(1.0 - photon.beyond * vergence) / (1.0 + photon.beyond * photon.inverse_before);
}

struct Curvature {
    value: f32,
    is_known: bool,
}

// The mean curvature of a surface from how points and normals change, 1/m (do Carmo, Differential Geometry of Curves and Surfaces,
// Section 3-3).
fn mean_curvature(points: Differences, normals: Differences) -> Curvature {
    let e = dot(points.along_row, points.along_row);
    let f = dot(points.along_row, points.along_column);
    let g = dot(points.along_column, points.along_column);
    let determinant = e * g - f * f;
    if !points.are_known || !normals.are_known || determinant <= 0.0 {
        return Curvature(0.0, false);
    }
    let l = dot(normals.along_row, points.along_row);
    let m = 0.5 * (dot(normals.along_row, points.along_column) + dot(normals.along_column, points.along_row));
    let n = dot(normals.along_column, points.along_column);
    return Curvature((e * n - 2.0 * f * m + g * l) / (2.0 * determinant), true);
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
    let left = neighbour(place, -1, 0, kind);
    let right = neighbour(place, 1, 0, kind);
    let above = neighbour(place, 0, -1, kind);
    let below = neighbour(place, 0, 1, kind);
    let index = place.y * map.columns + place.x;
    let are_known = (left != NOWHERE || right != NOWHERE) && (above != NOWHERE || below != NOWHERE);
    if !are_known {
        return Differences(vec3f(0.0), vec3f(0.0), false);
    }
    return Differences(between(index, left, right, kind), between(index, above, below, kind), true);
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

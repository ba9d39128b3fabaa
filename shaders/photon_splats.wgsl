// Adds photons to a caustic map as points and as Gaussian splats. CPU twins: src/render/image_space/splats.rs, lens.rs and multi_resolution.rs.

#import photon_footprints
#import photon_map
#import photon_sheet

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
    let resolves_clusters = map.mode == MODE_MULTI_RESOLUTION && map.clusters != 0u;
    if map.mode != MODE_GATHER && (map.mode != MODE_MULTI_RESOLUTION || resolves_clusters) {
        // What arrives of the others is known in the end.
        account_for(DEPOSITED, watts, map.steps_per_watt);
    }
    var splat: Splat;
    var is_point = false;
    // Its size and, where sizes are kept apart, those that follow.
    var size = 0u;
    var end = 1u;
    switch map.mode {
        case MODE_SPLATS {
            splat = round_splat(map.diameter);
        }
        case MODE_THIN_LENS, MODE_THICK_LENS {
            splat = round_splat(lens_diameter(place, photon, texel));
        }
        case MODE_FOOTPRINTS, MODE_MULTI_RESOLUTION {
            end = SPLAT_SIZES;
            if resolves_clusters || map.mode == MODE_FOOTPRINTS {
                let sides = differences(place, DIFFERENCE_OF_PLACES);
                let wanted = wanted_diameter(sides);
                if resolves_clusters {
                    size = size_for(wanted);
                }
                end = size + 1u;
                is_point = select(!sides.are_known, wanted <= 1.0, resolves_clusters);
                splat = footprint_splat(sides, map.frame_spacing);
            }
        }
        default {
            is_point = true;
            if map.mode == MODE_GATHER {
                atomicAdd(&counts[texel], 1u);
            }
        }
    }
    if is_point {
        deposit(0u, texel, photon.flux, photon);
        return;
    }
    for (; size < end; size++) {
        if map.mode == MODE_MULTI_RESOLUTION {
            splat = round_splat(f32(diameter_of(size)));
        }
        add_splat(select(size, 0u, resolves_clusters), splat, photon, photon.flux, places[index]);
        if map.mode == MODE_MULTI_RESOLUTION && !resolves_clusters {
            count_reached(size, i32(diameter_of(size)), photon, texel);
        }
    }
}

// The least of the sizes that is as large as that, or the largest.
fn size_for(diameter: f32) -> u32 {
    let steps = ceil((diameter - f32(FIRST_SPLAT_DIAMETER)) / f32(SPLAT_DIAMETER_STEP));
    return u32(clamp(steps, 0.0, f32(SPLAT_SIZES - 1u)));
}

// The diameter of a splat of one of several sizes, texels.
fn diameter_of(size: u32) -> u32 {
    return FIRST_SPLAT_DIAMETER + SPLAT_DIAMETER_STEP * size;
}

// The diameter of a splat that covers the part of the receiver which a photon of a cluster stands for, texels; a point where that is within
// a texel.
fn wanted_diameter(sides: Differences) -> f32 {
    return LENS_SPACINGS * select(0.0, max(length(sides.along_row.xy), length(sides.along_column.xy)), sides.are_known);
}

// A round splat with a diameter, in a square of that size.
fn round_splat(diameter: f32) -> Splat {
    let deviation = SPLAT_DEVIATION * diameter;
    let inverse = 1.0 / (deviation * deviation);
    return Splat(vec3f(inverse, 0.0, inverse), vec2f(0.5 * max(diameter, 1.0)));
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

// The diameter of a splat whose size follows from a lens equation, texels.
fn lens_diameter(place: vec2u, photon: Photon, texel: u32) -> f32 {
    let index = place.y * map.columns + place.x;
    let way = ways[index];
    let factor = lens_factor(place, photon, way);
    let cosine = max(-dot(unpacked_unit(photon.direction), unpacked_unit(photon.normal)), 0.05);
    // Where photons would land without mirrors and interfaces.
    let length = select(1.0 / photon.inverse_before + way.within + photon.beyond, 1.0, photon.inverse_before == 0.0);
    let undistorted = LENS_SPACINGS * length * map.frame_spacing * map.spacing / sqrt(cosine) / texels[texel].edge;
    return clamp(undistorted * factor, MIN_SPLAT_DIAMETER, MAX_SPLAT_DIAMETER);
}

// The width of a photon's bundle at the receiver, relative to what it would be without mirrors and interfaces.
fn lens_factor(place: vec2u, photon: Photon, way: PhotonWay) -> f32 {
    let front = curvature_at(place, DIFFERENCE_OF_FIRST, DIFFERENCE_OF_FIRST_NORMALS);
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
    let back = curvature_at(place, DIFFERENCE_OF_LAST, DIFFERENCE_OF_LAST_NORMALS);
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

// The mean curvature of a surface from how two kinds of values of photons, points and normals, change, 1/m (do Carmo, Differential
// Geometry of Curves and Surfaces, Section 3-3).
fn curvature_at(place: vec2u, of_points: u32, of_normals: u32) -> Curvature {
    let points = differences(place, of_points);
    let normals = differences(place, of_normals);
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

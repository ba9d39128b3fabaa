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
    if map.mode != MODE_GATHER && map.mode != MODE_MULTI_RESOLUTION {
        // What arrives of the others is known in the end.
        account_for(DEPOSITED, watts, map.steps_per_watt);
    }
    switch map.mode {
        case MODE_SPLATS {
            add_splat(0u, round_splat(map.diameter), photon, photon.flux, places[index]);
        }
        case MODE_THIN_LENS, MODE_THICK_LENS {
            add_splat(0u, round_splat(lens_diameter(place, photon, texel)), photon, photon.flux, places[index]);
        }
        case MODE_FOOTPRINTS {
            add_footprint(place, photon, photon.flux, places[index], map.frame_spacing);
        }
        case MODE_MULTI_RESOLUTION {
            if map.clusters != 0u {
                account_for(DEPOSITED, watts, map.steps_per_watt);
                add_in_its_resolution(place, photon, places[index]);
                return;
            }
            for (var size = 0u; size < SPLAT_SIZES; size++) {
                let diameter = FIRST_SPLAT_DIAMETER + SPLAT_DIAMETER_STEP * size;
                add_splat(size, round_splat(f32(diameter)), photon, photon.flux, places[index]);
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
    add_splat(0u, round_splat(f32(FIRST_SPLAT_DIAMETER + SPLAT_DIAMETER_STEP * size)), photon, photon.flux, landed);
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

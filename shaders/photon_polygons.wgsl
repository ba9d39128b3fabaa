// Adds the triangles between neighbouring photons to a caustic map. CPU twin: src/render/image_space/polygons.rs, whose areas come from clipped
// polygons.

#import photon_footprints
#import photon_map
#import photon_sheet

// Texels along which a triangle may extend in one invocation at most: what lies beyond is culled, so that no loop is too long.
const MAX_EXTENT: f32 = 240.0;
// Triangles of a smaller area, texels², have their flux along their longest side: differences of coordinates say no more.
const MIN_EXACT_AREA: f32 = 1e-4;

// One invocation for each cell: that to the right of and below a photon, and those around the grid.
@compute @workgroup_size(8, 8)
fn add_polygons(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local_index: u32) {
    let first_row = i32(map.first_own_row) - i32(map.is_first);
    let row = first_row + i32(id.y);
    if id.x <= map.columns && row < i32(map.first_own_row + map.own_rows) {
        add_cell(i32(id.x) - 1, row);
    }
    close_account(local_index);
}

fn add_cell(column: i32, row: i32) {
    var corners: vec4u;
    var is_whole = true;
    for (var k = 0u; k < 4u; k++) {
        corners[k] = photon_at(column + i32(k & 1u), row + i32(k >> 1u));
        is_whole = is_whole && corners[k] != NOWHERE;
    }
    // The two edges along rows, and the two along columns.
    for (var k = 0; k < 4 && is_whole; k++) {
        let off = vec2i(select(0, 1, k == 3), select(0, 1, k == 1));
        is_whole = are_connected(column + off.x, row + off.y, select(1, 0, k > 1), select(0, 1, k > 1));
    }
    if is_whole {
        for (var k = 0u; k < 2u; k++) {
            add_triangle(select(corners.xyz, corners.ywz, k == 1u));
        }
        return;
    }
    // What belongs to triangles that do not exist.
    for (var k = 0u; k < 4u; k++) {
        add_corner(corners[k], select(1.0 / 6.0, 2.0 / 6.0, k == 1u || k == 2u));
    }
}

fn add_corner(index: u32, part: f32) {
    if index != NOWHERE {
        if map.is_alone != 0u && map.mode == MODE_POLYGONS {
            account_for(CULLED, part * sum_of_channels(photons[index].flux), map.steps_per_watt);
        } else {
            add_spread(index, part * photons[index].flux);
        }
    }
}

// Adds flux of a photon over its footprint, if that is larger than a texel: what is smaller would only leave its edge.
fn add_spread(index: u32, flux: vec3f) {
    let photon = photons[index];
    let at = places[index].at;
    var texel = TEXEL_HIDDEN;
    if is_in_window(at) {
        texel = surface_of(texel_at(at), photon);
    }
    let place = vec2u(index % map.columns, index / map.columns);
    let sides = differences(place, DIFFERENCE_OF_PLACES);
    let squared = dot(sides.along_row.xy, sides.along_row.xy) + dot(sides.along_column.xy, sides.along_column.xy);
    if texel == TEXEL_HIDDEN || !sides.are_known || squared <= 1.0 {
        add_point(photon, at, flux);
        return;
    }
    add_splat(0u, footprint_splat(sides, 1.0), photon, flux, PhotonPlace(at, texel));
    account_for(DEPOSITED, sum_of_channels(flux), map.steps_per_watt);
}

// Adds flux at a place of the surface that a photon lands on.
fn add_point(photon: Photon, at: vec2f, flux: vec3f) {
    let watts = sum_of_channels(flux);
    if !is_in_window(at) {
        account_off_map(watts);
        return;
    }
    let texel = surface_of(texel_at(at), photon);
    if texel != TEXEL_HIDDEN {
        deposit(0u, texel, flux, photon);
        account_for(DEPOSITED, watts, map.steps_per_watt);
    } else {
        account_for(HIDDEN, watts, map.steps_per_watt);
    }
}

fn add_triangle(corners: vec3u) {
    let photon = photons[corners.x];
    let flux = (photon.flux + photons[corners.y].flux + photons[corners.z].flux) / 6.0;
    let a = places[corners.x].at;
    let b = places[corners.y].at;
    let c = places[corners.z].at;
    if min(a.x, min(b.x, c.x)) <= BEHIND_PLANE {
        account_off_map(sum_of_channels(flux));
        return;
    }
    let area = 0.5 * abs(cross_2d(b - a, c - a));
    let low = floor(min(a, min(b, c)));
    let high = floor(max(a, max(b, c)));
    let is_exact = map.mode == MODE_EXACT_POLYGONS;
    if is_exact && all(low == high) || !is_exact && area < select(MIN_DRAWN_AREA, 1e-9, map.is_alone != 0u) {
        add_point(photon, (a + b + c) / 3.0, flux);
    } else if is_exact && area < MIN_EXACT_AREA {
        add_sliver(photon, a, b, c, flux);
    } else {
        add_texels(photon, array(a, b, c), low, high, area, flux);
    }
}

fn cross_2d(a: vec2f, b: vec2f) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// A triangle of hardly any width, as points along its longest side.
fn add_sliver(photon: Photon, a: vec2f, b: vec2f, c: vec2f, flux: vec3f) {
    var start = a;
    var end = b;
    if distance(b, c) > distance(start, end) {
        start = b;
        end = c;
    }
    if distance(c, a) > distance(start, end) {
        start = c;
        end = a;
    }
    let count = clamp(ceil(4.0 * distance(start, end)), 1.0, 4.0 * MAX_EXTENT);
    for (var k = 0.0; k < count; k += 1.0) {
        add_point(photon, mix(start, end, (k + 0.5) / count), flux / count);
    }
}

fn add_texels(photon: Photon, corners: array<vec2f, 3>, low: vec2f, high: vec2f, area: f32, flux: vec3f) {
    let is_exact = map.mode == MODE_EXACT_POLYGONS;
    let watts = sum_of_channels(flux);
    let first = max(low, vec2f(0.0));
    let last_shown = min(high, vec2f(map.size) - 1.0);
    let last = min(last_shown, first + MAX_EXTENT);
    let turn = sign(cross_2d(corners[1] - corners[0], corners[2] - corners[0]));
    var deposited = 0.0;
    var hidden = 0.0;
    for (var y = first.y; y <= last.y; y += 1.0) {
        for (var x = first.x; x <= last.x; x += 1.0) {
            let corner = vec2f(x, y);
            var covered = 0.0;
            if is_exact {
                covered = covered_area(corners, corner, turn);
            } else if covers(corners, corner + 0.5, turn) {
                covered = 1.0;
            }
            if covered > 0.0 {
                let texel = surface_of(texel_at(corner), photon);
                var seen = 0.0;
                if texel != TEXEL_HIDDEN {
                    // What is larger than the part that is seen lies behind something.
                    seen = min(covered, texels[texel].part);
                    deposit(0u, texel, seen / area * flux, photon);
                }
                deposited += seen / area;
                hidden += (covered - seen) / area;
            }
        }
    }
    account_for(DEPOSITED, deposited * watts, map.steps_per_watt);
    account_for(HIDDEN, hidden * watts, map.steps_per_watt);
    let is_cut = any(last_shown > last);
    let is_beyond = any(low < vec2f(0.0)) || any(high >= vec2f(map.size));
    if is_exact || is_cut || is_beyond {
        let whole = (1.0 - deposited - hidden) * watts;
        let rest = select(max(whole, 0.0), whole, is_exact);
        if is_cut {
            account_for(CULLED, rest, map.steps_per_watt);
        } else {
            account_off_map(rest);
        }
    }
}

// Whether a triangle covers a point; of two triangles with a common edge, one covers points on it.
fn covers(corners: array<vec2f, 3>, point: vec2f, turn: f32) -> bool {
    var triangle = corners;
    for (var k = 0u; k < 3u; k++) {
        let start = triangle[k];
        let end = triangle[(k + 1u) % 3u];
        let across = turn * cross_2d(end - start, point - start);
        let along = turn * (end - start);
        if !(across > 0.0 || across == 0.0 && (along.y > 0.0 || along.y == 0.0 && along.x < 0.0)) {
            return false;
        }
    }
    return true;
}

// The area that a triangle shares with a texel: from its edges, what lies between each and the texel's left side.
fn covered_area(corners: array<vec2f, 3>, texel: vec2f, turn: f32) -> f32 {
    var triangle = corners;
    var area = 0.0;
    for (var k = 0u; k < 3u; k++) {
        area += area_left_of(triangle[k] - texel, triangle[(k + 1u) % 3u] - texel);
    }
    return max(turn * area, 0.0);
}

// The area, signed by the edge's direction, that lies within the unit square to the left of an edge.
fn area_left_of(start: vec2f, end: vec2f) -> f32 {
    let rise = end.y - start.y;
    if rise == 0.0 {
        return 0.0;
    }
    let first = clamp(start.y, 0.0, 1.0);
    let last = clamp(end.y, 0.0, 1.0);
    let slope = (end.x - start.x) / rise;
    let x = vec2f(start.x + slope * (first - start.y), start.x + slope * (last - start.y));
    let width = x.y - x.x;
    // The mean of x within the square: its integral over what lies between, or the value in the middle.
    let middle = saturate(0.5 * (x.x + x.y));
    let mean = select((integral_of_clamped(x.y) - integral_of_clamped(x.x)) / width, middle, abs(width) < 1e-3);
    return (last - first) * mean;
}

// The integral of saturate(x).
fn integral_of_clamped(x: f32) -> f32 {
    let inside = saturate(x);
    return 0.5 * inside * inside + max(x - 1.0, 0.0);
}

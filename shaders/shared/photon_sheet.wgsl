// Which photons are neighbours where they land. CPU twins: src/render/image_space/sheet.rs and `differences` in photons.rs.

#import photon_map

const NOWHERE: u32 = 0xffffffffu;

// The index of the photon in a column and row, or NOWHERE.
fn photon_at(column: i32, row: i32) -> u32 {
    if column < 0 || row < 0 || column >= i32(map.columns) || row >= i32(map.rows) {
        return NOWHERE;
    }
    let index = u32(row) * map.columns + u32(column);
    return select(index, NOWHERE, places[index].texel == NO_PHOTON);
}

// Whether two photons came by way of one object to one surface, which may be of several objects in one plane.
fn are_alike(one: u32, other: u32) -> bool {
    let a = photons[one];
    let b = photons[other];
    let normal = unpacked_unit(a.normal);
    let is_one_surface = a.object == b.object
        || abs(dot(b.position - a.position, normal)) <= PHOTON_OFF_PLANE * texel_across(a.position);
    return a.caster == b.caster && is_one_surface && dot(normal, unpacked_unit(b.normal)) >= SAME_SURFACE_COSINE;
}

// The edge of a texel across its ray at the distance of a point, as all faces of a cube see it.
fn texel_across(position: vec3f) -> f32 {
    return map.plane.texel * select(distance(position, map.plane.origin), 1.0, map.plane.is_parallel != 0u);
}

// Whether light is continuous from the photon in a column and row to the next one in a direction. Both are there.
fn are_connected(column: i32, row: i32, dx: i32, dy: i32) -> bool {
    let one = photon_at(column, row);
    let other = photon_at(column + dx, row + dy);
    if !are_alike(one, other) {
        return false;
    }
    let before = photon_at(column - dx, row - dy);
    let after = photon_at(column + 2 * dx, row + 2 * dy);
    var longest = -1.0;
    if before != NOWHERE && are_alike(one, before) {
        longest = distance(photons[one].position, photons[before].position);
    }
    if after != NOWHERE && are_alike(other, after) {
        longest = max(longest, distance(photons[other].position, photons[after].position));
    }
    let position = photons[one].position;
    let texel = texel_across(position);
    return longest < 0.0 || distance(position, photons[other].position) <= TEAR_STRETCH * longest + LEAST_TEAR * texel;
}

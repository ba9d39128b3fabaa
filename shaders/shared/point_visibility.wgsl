// What a sample's map says of a point: how much of it the sample sees, and whether only a ray can tell.
// CPU twin: `visible_fraction` in src/sums/pinhole/cpu/visibility.rs.

#import cell_tree
#import doubts

struct PointVisibility {
    // From 0 to 1.
    fraction: f32,
    is_doubtful: bool,
}

// Of a point at l, metres from the sample in world space, that lies on an object, or on none: -1.
fn visibility_of_point(l: vec3f, map: VisibilityMap, object: i32) -> PointVisibility {
    let local = l * map.axes;
    let place = map_place(local, map);
    let texels = texels_at(place, map);
    let corners = in_front(texels, local);
    let is_doubtful = tree.traces_rays != 0u
        && (is_grazing(local)
        || any(corners != vec4f(corners.x)) || is_any_in_doubt(texels, corners, local, place, map, object));
    return PointVisibility(between(texels, corners, place.part), is_doubtful);
}

// Whether a place in a sample's frame is seen at so small an angle to the surface that its map is not certain about it.
fn is_grazing(local: vec3f) -> bool {
    return local.z * local.z < MIN_CERTAIN_SINE * MIN_CERTAIN_SINE * dot(local, local);
}

// Whether any of the four texels that a point lies in front of leaves that in doubt.
fn is_any_in_doubt(
    texels: mat4x4f, corners: vec4f, local: vec3f, place: MapPlace, map: VisibilityMap, object: i32,
) -> bool {
    let n = uniforms.map_resolution;
    let first = (map.index * n + place.texel.y) * n + place.texel.x;
    let depths = vec4f(local, 0.0) * texels;
    let l2 = dot(local, local);
    return (corners.x > 0.0 && is_in_doubt(first, depths.x, l2, object))
        || (corners.y > 0.0 && is_in_doubt(first + 1u, depths.y, l2, object))
        || (corners.z > 0.0 && is_in_doubt(first + n, depths.z, l2, object))
        || (corners.w > 0.0 && is_in_doubt(first + n + 1u, depths.w, l2, object));
}

// What mirrors see of lit surfaces: views from viewpoints near them, corrected for parallax. CPU twins: src/sums/pinhole/surroundings.rs and
// src/sums/pinhole/cpu/surroundings.rs.

#import footprint
#import gather_inputs

// Steps towards the surface that a cell sees in a direction.
const PARALLAX_STEPS: u32 = 2u;
// What is farther than this many metres is taken to be that far away,
const FARTHEST: f32 = 1e4;
// and what is nearer than this, that near.
const NEAREST: f32 = 1e-6;
// What is seen at a distance is visible if nothing lies before this part of it: planes are interpolated at edges.
const BEFORE_SURFACE: f32 = 0.9;

// Surfaces in a direction, seen from a place.
struct SeenSurfaces {
    // The unit direction to them from the viewpoint, and the footprint without a lobe as it is seen from there.
    r: vec3f,
    sides: FootprintSides,
    // From the place to shortly before them.
    towards: vec3f,
    // The footprint's side along a part of a ray.
    third: vec3f,
}

// The view from the nearest viewpoint for a place on a surface with this normal.
fn nearest_view(place: vec3f, n: vec3f) -> u32 {
    var nearest = 0u;
    var least = 3e38;
    for (var k = 0u; k < uniforms.viewpoints.count; k++) {
        let offset = uniforms.viewpoints.places[k].xyz - place;
        let is_behind = dot(n, uniforms.viewpoints.normals[k].xyz) < 0.0;
        let distance2 = dot(offset, offset) * select(1.0, OTHER_SIDE * OTHER_SIDE, is_behind);
        nearest = select(nearest, k, distance2 < least);
        least = min(least, distance2);
    }
    return nearest;
}

// How far the direction of anything that is seen may turn from the viewpoint to the points of a cell, radians.
fn view_spread(view: u32, place: vec3f, radius: f32) -> f32 {
    let viewpoint = uniforms.viewpoints.places[view];
    let sine = (distance(place, viewpoint.xyz) + radius) * viewpoint.w;
    // An arc is at most π/2 times its sine.
    return select(WHOLE_SPHERE_RAD, sine * (0.5 * WHOLE_SPHERE_RAD), sine < 1.0);
}

// What lies in the directions of a footprint around the unit direction r of a piece of a surface.
fn surfaces_seen(
    view: u32, place: vec3f, surface: FootprintSides, r: vec3f, reflected: FootprintSides, third: vec3f,
) -> SeenSurfaces {
    let shift = place - uniforms.viewpoints.places[view].xyz;
    var distance = distance_to_plane(view, shift, r, r);
    for (var step = 0u; step < PARALLAX_STEPS; step++) {
        distance = distance_to_plane(view, shift, r, shift + distance * r);
    }
    let seen = shift + distance * r;
    let inverse = 1.0 / max(length(seen), 1.2e-38);
    let direction = seen * inverse;
    let side_1 = surface.v1 + distance * reflected.v1;
    let side_2 = surface.v2 + distance * reflected.v2;
    let sides = FootprintSides(
        (side_1 - dot(side_1, direction) * direction) * inverse,
        (side_2 - dot(side_2, direction) * direction) * inverse,
    );
    let side_3 = distance * third;
    let seen_third = (side_3 - dot(side_3, direction) * direction) * inverse;
    return SeenSurfaces(direction, sides, BEFORE_SURFACE * distance * r, seen_third);
}

// From a place that is shifted from the viewpoint, along r, to the plane that is seen from the viewpoint in a direction.
fn distance_to_plane(view: u32, shift: vec3f, r: vec3f, direction: vec3f) -> f32 {
    let texel = textureSampleLevel(view_planes, trilinear, direction, view, 0.0);
    let plane = uniforms.viewpoints.plane_scale * texel.xyz;
    let approach = max(dot(plane, r), 1.0 / FARTHEST);
    return clamp((1.0 - dot(plane, shift)) / approach, NEAREST, FARTHEST);
}

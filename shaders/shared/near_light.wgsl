// Footprints on light that is not infinitely far away, and its mean over them. Where the light is the environment,
// no_near_light.wgsl is imported in its place. CPU twin: src/sums/pinhole/cpu/near_light.rs.

#import filters
#import lamp
#import surroundings

// What a piece of a surface sees of the light around a direction, without a lobe.
struct LightFootprint {
    // Unit direction: of surroundings, as they are seen from the viewpoint.
    r: vec3f,
    sides: FootprintSides,
    // To what is seen or shortly before it, m.
    towards: vec3f,
    // The view of surroundings.
    view: u32,
    // How far the direction turns along a part of a ray.
    third: vec3f,
    // Of a lamp: the sides over which its light is blurred.
    even: FootprintSides,
}

// `changes`: of the normal along the sides of the surface; `reflected`: the footprint of light from infinitely far away around r, without the
// lobe of this width; `third`: its side along a part of a ray.
fn footprint_on_light(
    place: vec3f, n: vec3f, area: f32, surface: FootprintSides, changes: FootprintSides, r: vec3f, reflected: FootprintSides,
    lobe: f32, third: vec3f,
) -> LightFootprint {
    if LIGHT == LIGHT_LAMP {
        let seen = lamp_seen_from(place);
        let sides = footprint_towards_lamp(seen, surface, r, reflected);
        let even = even_sides(area, surface, changes, sides);
        return LightFootprint(r, sides, middle_of_shared(seen, r, sides, lobe), 0u, third, even);
    }
    let view = nearest_view(place, n);
    let seen = surfaces_seen(view, place, surface, r, reflected, third);
    return LightFootprint(seen.r, seen.sides, seen.towards, view, seen.third, FootprintSides());
}

// Mean radiance over footprints, seen from a piece of a surface; a = fetches. Without regard to occlusion.
fn mean_of_light(
    place: vec3f, n: vec3f, surface: FootprintSides, light: LightFootprint, look_ups: LookUps, taps: f32,
    map: VisibilityMap,
) -> vec4f {
    if LIGHT == LIGHT_LAMP {
        return mean_of_lamp(place, n, surface, lamp_seen_from(place), look_ups, light.even);
    }
    looked_up_view = light.view;
    var unoccluded = map;
    unoccluded.index = UNOCCLUDED;
    return mean_over_footprints(look_ups, taps, unoccluded);
}

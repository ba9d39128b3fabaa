// The interface of near_light.wgsl where the light is the environment: drivers need not compile the rest.

#import filters

struct LightFootprint {
    r: vec3f,
    sides: FootprintSides,
    towards: vec3f,
    third: vec3f,
}

fn footprint_on_light(
    place: vec3f, n: vec3f, area: f32, surface: FootprintSides, changes: FootprintSides, r: vec3f, reflected: FootprintSides,
    lobe: f32, third: vec3f,
) -> LightFootprint {
    return LightFootprint(r, reflected, vec3f(0.0), third);
}

fn mean_of_light(
    place: vec3f, n: vec3f, surface: FootprintSides, light: LightFootprint, look_ups: LookUps, taps: f32,
    map: VisibilityMap,
) -> vec4f {
    return mean_over_footprints(look_ups, taps, map);
}

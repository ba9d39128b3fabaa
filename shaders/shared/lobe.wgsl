// Rough mirrors' lobes, as two look-ups see them. CPU twin: `parts_of` in src/sums/pinhole/cpu/pair.rs.

#import footprint
#import medium

// What two look-ups in a rough mirror's lobe cover: one narrower, one wider.
struct LobeParts {
    // The unit direction of their centre.
    r: vec3f,
    core: FootprintSides,
    tail: FootprintSides,
}

// The parts of the lobe around r, a little nearer to the normal n. `sides` are the footprint's without the lobe, `third` the one that
// it has along a part of a ray.
fn lobe_parts(r: vec3f, n: vec3f, cosine: f32, sides: FootprintSides, lobe: f32, third: vec3f) -> LobeParts {
    let tilt = lobe * (LOBE_TILT + LOBE_TILT_GROWTH * lobe);
    return LobeParts(
        normalize(r + select(tilt, -tilt, dot(r, n) < 0.0) * n),
        widened(sides, r, n, mirrored_blur(LOBE_CORE_WIDTH * lobe, cosine), third),
        widened(sides, r, n, mirrored_blur(LOBE_TAIL_WIDTH * lobe, cosine), third),
    );
}

// The mean over a lobe from those over its parts; a = fetches.
fn mean_of_parts(core: vec4f, tail: vec4f) -> vec4f {
    return vec4f(0.5 * (core.rgb + tail.rgb), core.a + tail.a);
}

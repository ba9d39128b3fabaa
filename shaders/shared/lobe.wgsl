// Rough mirrors' lobes, as two look-ups see them. CPU twin: `parts_of` in src/sums/pinhole/cpu/pair.rs.

#import footprint
#import medium

// The parts of the lobe around r, one narrower and one wider, a little nearer to the normal n. `sides` are the footprint's without the lobe, `third` the one that
// it has along a part of a ray.
fn lobe_parts(r: vec3f, n: vec3f, cosine: f32, sides: FootprintSides, lobe: f32, third: vec3f) -> LookUps {
    let tilt = lobe * (LOBE_TILT + LOBE_TILT_GROWTH * lobe);
    return LookUps(
        2u,
        normalize(r + select(tilt, -tilt, dot(r, n) < 0.0) * n),
        widened(sides, r, n, mirrored_blur(LOBE_CORE_WIDTH * lobe, cosine), third),
        widened(sides, r, n, mirrored_blur(LOBE_TAIL_WIDTH * lobe, cosine), third),
    );
}

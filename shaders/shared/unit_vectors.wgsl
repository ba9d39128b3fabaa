// Unit vectors in 32 bits, by their places on an octahedron (Cigolle et al. 2014, A Survey of Efficient Representations for Independent Unit
// Vectors). CPU twin: src/sums/tracing/stackless.rs.

fn unpacked_unit(packed: u32) -> vec3f {
    // As unpack2x16snorm, which some drivers round differently.
    let xy = vec2f(vec2i(extractBits(i32(packed), 0u, 16u), extractBits(i32(packed), 16u, 16u))) / 32767.0;
    let z = 1.0 - abs(xy.x) - abs(xy.y);
    let fold = max(-z, 0.0);
    return normalize(vec3f(xy + select(vec2f(-fold), vec2f(fold), xy < vec2f(0.0)), z));
}

fn packed_unit(v: vec3f) -> u32 {
    let flat = v / (abs(v.x) + abs(v.y) + abs(v.z));
    let folded = (1.0 - abs(flat.yx)) * select(vec2f(-1.0), vec2f(1.0), flat.xy >= vec2f(0.0));
    let place = vec2i(round(32767.0 * clamp(select(folded, flat.xy, flat.z >= 0.0), vec2f(-1.0), vec2f(1.0))));
    return (u32(place.x) & 0xffffu) | (u32(place.y) << 16u);
}

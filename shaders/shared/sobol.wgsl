// Owen-scrambled Sobol points (Burley 2020, Practical Hash-based Owen Scrambling). CPU twin: `sample_4d` of the crate sobol_burley, whose
// constants these are. The importing shader declares `sobol_vectors`: the direction vectors of two dimensions, with reversed bits.

// The first two dimensions of a point of a sequence of 65,536.
fn sobol_point(index: u32, seed: u32) -> vec2f {
    let shuffled = owen_scrambled(reverseBits(index), sobol_hash(seed ^ 0x79c68e4au));
    var point = vec2u(0u);
    for (var bit = 0u; bit < 16u; bit++) {
        if (shuffled & (0x80000000u >> bit)) != 0u {
            point ^= sobol_vectors[bit];
        }
    }
    let scrambled = seed * 0x9c8f2d3bu;
    let x = owen_scrambled(point.x, sobol_hash(scrambled ^ 0x912f69bau));
    let y = owen_scrambled(point.y, sobol_hash(scrambled ^ 0x174f18abu));
    return bitcast<vec2f>((reverseBits(vec2u(x, y)) >> vec2u(9u)) | vec2u(0x3f800000u)) - 1.0;
}

// A number with reversed bits.
fn owen_scrambled(number: u32, scramble: u32) -> u32 {
    var n = number;
    n ^= n * 0x3d20adeau;
    n += scramble;
    n *= (scramble >> 16u) | 1u;
    n ^= n * 0x05526c56u;
    n ^= n * 0x53a22864u;
    return n;
}

fn sobol_hash(number: u32) -> u32 {
    var n = number ^ 0xe6fe3bebu;
    n ^= n >> 16u;
    n *= 0x7feb352du;
    n ^= n >> 15u;
    n *= 0x846ca68bu;
    n ^= n >> 16u;
    return n;
}

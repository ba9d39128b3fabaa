// Tiles of receivers and the blocks they are divided into, level by level from the largest.

#import constants

// Where a block is among those of its tile.
fn block_in_tile(level: u32, place: vec2u) -> u32 {
    return ((1u << (2u * level)) - 1u) / 3u + (place.y << level) + place.x;
}

// The columns of points that stand for a block.
fn points_along(edge: u32) -> vec4u {
    let last = edge - 1u;
    return vec4u(0u, last / 3u, last - last / 3u, last);
}

// Lagrange's weights of four columns for a place along an edge.
fn weights_along(edge: u32, place: u32) -> vec4f {
    let at = vec4f(points_along(edge));
    let d = vec4f(f32(place)) - at;
    return vec4f(
        d.y * d.z * d.w / ((at.x - at.y) * (at.x - at.z) * (at.x - at.w)),
        d.x * d.z * d.w / ((at.y - at.x) * (at.y - at.z) * (at.y - at.w)),
        d.x * d.y * d.w / ((at.z - at.x) * (at.z - at.y) * (at.z - at.w)),
        d.x * d.y * d.z / ((at.w - at.x) * (at.w - at.y) * (at.w - at.z)),
    );
}

// Which tiles, and which blocks of theirs, a pass works on.
struct TilePass {
    // The first tile of the batch, row by row over the picture.
    first_tile: u32,
    // The level of blocks, 0 the largest.
    level: u32,
    // Which of the resolve passes this is, of how many.
    split: u32,
    split_count: u32,
}

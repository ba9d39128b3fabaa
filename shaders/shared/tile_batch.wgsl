// What the compute passes of the hierarchical gather work on: a batch of tiles, level by level.

#import cell_tree
#import receiver_tiles

struct Block {
    // Middle of its bounds, metres; no point is farther from there than the radius.
    centre: vec3f,
    radius: f32,
    // Unit mean normal; no normal is farther from it.
    normal: vec3f,
    normal_radius: f32,
    kind: u32,
    // The error that may be made at any of its points beyond that of all others, W/m².
    tolerated: f32,
    // That of its points, if they are on one only.
    object: i32,
}

// A block has no receivers; they are not one smooth piece of one object; they are.
const EMPTY: u32 = 0u;
const ROUGH: u32 = 1u;
const SMOOTH: u32 = 2u;

@group(2) @binding(0) var<uniform> tile_pass: TilePass;
// The nodes without a parent, then a list for every block: how many, and indices of nodes.
@group(2) @binding(1) var<storage, read_write> lists: array<u32>;
@group(2) @binding(2) var<storage, read_write> blocks: array<Block>;
// A row for each tile, sixteen texels for each of its blocks: rgb = contributions at its points, a = fetches a point.
@group(2) @binding(3) var interpolated_part: texture_storage_2d<rgba32float, write>;
@group(2) @binding(4) var<uniform> tolerance: Tolerance;

struct BlockPlace {
    level: u32,
    // Points along its edge.
    edge: u32,
    // The tile, in the batch; the block's column and row there; the block, in the batch.
    tile: u32,
    block: vec2u,
    index: u32,
    // Its first point, in the picture.
    origin: vec2u,
}

// The n-th block of the pass's level.
fn place_of_block(n: u32) -> BlockPlace {
    let level = tile_pass.level;
    let tile = n >> (2u * level);
    let within = n & ((1u << (2u * level)) - 1u);
    let block = vec2u(within & ((1u << level) - 1u), within >> level);
    let edge = TILE_SIZE >> level;
    let number = tile_pass.first_tile + tile;
    let corner = TILE_SIZE * vec2u(number % tree.tiles_across, number / tree.tiles_across);
    return BlockPlace(level, edge, tile, block, tile * BLOCKS_PER_TILE + block_in_tile(level, block), corner + edge * block);
}

// One of the points that stand for a block.
fn interpolation_point(at: BlockPlace, point: u32) -> Receiver {
    let along = points_along(at.edge);
    return receiver_at(at.origin + vec2u(along[point % 4u], along[point / 4u]));
}

// Where a block's list starts.
fn list_of(block: u32) -> u32 {
    return tree.root_count + block * (tree.list_capacity + 1u);
}

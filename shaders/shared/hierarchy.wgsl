// What the passes of the hierarchical gather read: the cells, the receivers, the light and its bounds. CPU twins:
// src/pinhole/cpu/hierarchical/ and src/cell_tree/node.rs. Rust layouts: src/pinhole/gpu/hierarchical/layout.rs.
//
// It imports nothing; the importing pass imports `pair`, `cube`, `footprint`, `filters` and `visibility`.

// A cell; see src/cell_tree/node.rs.
struct CellNode {
    centroid_area: vec4f,
    normal_e11: vec4f,
    sides_curvature: vec4f,
    curvature_bounds_links: vec4u,
}

// What the cells of a root have in common.
struct CellRoot {
    // World position of the root's own cell; the width of the mirror's lobe.
    position_lobe: vec4f,
    // Its normal; ±(object + 1), negative where both sides reflect.
    normal_object: vec4f,
    // Reflectance; the number of its curve, from 1, or 0.
    reflectance: vec4f,
    // No channel reflects more; shift of the map's texels.
    most_phase: vec4f,
    // Its first map of visibility; the index of its node.
    map_node: vec4u,
}

struct TreeUniforms {
    // Of the picture.
    size: vec2u,
    tiles_across: u32,
    // Entries of a list of cells.
    capacity: u32,
    // Nodes above all others.
    tops: u32,
    // Nodes from here on are roots or lie above them.
    first_above: u32,
    roots: u32,
    may_interpolate: u32,
    split_near: u32,
    has_viewers: u32,
    // Of all cells, m².
    area: f32,
    // Width of a texel of a map of visibility, radians.
    map_texel: f32,
}

// Which tiles, and which blocks of theirs, a pass works on.
struct Stage {
    // The first tile of the run, row by row over the picture.
    first_tile: u32,
    // The level of blocks, 0 the largest.
    level: u32,
    // Which of so many parts of the lists: of the last pass only.
    part: u32,
    parts: u32,
}

@group(0) @binding(0) var<uniform> uniforms: GatherUniforms;
@group(0) @binding(1) var<uniform> tree: TreeUniforms;
@group(0) @binding(2) var environment: texture_cube<f32>;
@group(0) @binding(3) var trilinear: sampler;
@group(0) @binding(4) var anisotropic: sampler;
// Of the radiance itself: x = its most, y = its contrast.
@group(0) @binding(5) var bounds: texture_2d_array<f32>;
@group(0) @binding(6) var<storage, read> nodes: array<CellNode>;
@group(0) @binding(7) var<storage, read> roots: array<CellRoot>;
@group(0) @binding(8) var<storage, read> curves: array<vec4f>;
// The roots' maps of visibility; never read without VISIBILITY.
@group(0) @binding(9) var<storage, read> planes: array<vec4f>;
@group(0) @binding(10) var<storage, read> open_rows: array<u32>;
@group(1) @binding(0) var receiver_position: texture_2d<f32>;
@group(1) @binding(1) var receiver_normal: texture_2d<f32>;

// Blocks of receivers: tiles of 64² points hold blocks of four levels, the smallest of 8².
const TILE: u32 = 64u;
const LEVELS: u32 = 4u;
const BLOCKS: u32 = 85u;
// Points that stand for a block.
const POINTS: u32 = 16u;

// Constants of the estimates: src/pinhole/cpu/hierarchical/bounds.rs.
const SHARE: f32 = 1.2;
const NEGLIGIBLE: f32 = 0.03;
const FOOTPRINT: f32 = 0.6;
const BENT: f32 = 0.3;
const OF_CONTRAST: f32 = 3.0;
const OF_WEIGHT: f32 = 0.3;
const WORTH: f32 = 3.0;
const TOO_LARGE: f32 = 0.7;
// src/pinhole/mod.rs.
const BEND: f32 = 0.5;
const LEAST_BEND: f32 = 0.03;
// src/pinhole/cpu/mod.rs.
const EVEN_PART: f32 = 0.35;

// The length of a list that an adapter did not let be finished.
const CUT_SHORT: u32 = 0xffffffffu;

struct Receiver {
    position: vec3f,
    normal: vec3f,
    // Negative: there is none.
    object: i32,
}

fn receiver_at(place: vec2u) -> Receiver {
    if any(place >= tree.size) {
        return Receiver(vec3f(0.0), vec3f(0.0), -1);
    }
    let position = textureLoad(receiver_position, place, 0);
    // Rounded: a rasteriser's interpolation may leave 0.9999999.
    let object = select(i32(position.w + 0.5), -1, position.w < 0.0);
    return Receiver(position.xyz, textureLoad(receiver_normal, place, 0).xyz, object);
}

// Where a block is among those of its tile, level by level from the largest.
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

// A cell in world space.
struct Cell {
    centroid: vec3f,
    area: f32,
    normal: vec3f,
    radius: f32,
    side_1: vec3f,
    normal_radius: f32,
    side_2: vec3f,
    // Width of the lobe that blurs its footprints, radians.
    lobe: f32,
    change_1: vec3f,
    creased: bool,
    change_2: vec3f,
    root: u32,
    // Eight times the first child's index and the number of children.
    children: u32,
    two_sided: bool,
    object: i32,
    // No channel reflects more.
    most: f32,
}

fn load_cell(index: u32) -> Cell {
    let node = nodes[index];
    let n = node.normal_e11.xyz;
    let sign = select(1.0, -1.0, n.z < 0.0);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let u = vec3f(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    let v = vec3f(b, sign + n.y * n.y * a, -n.y);
    let e11 = node.normal_e11.w;
    let e21 = node.sides_curvature.x;
    let e22 = node.sides_curvature.y;
    let k12 = node.sides_curvature.w;
    let n_u = node.sides_curvature.z * u + k12 * v;
    let n_v = k12 * u + bitcast<f32>(node.curvature_bounds_links.x) * v;
    let radii = unpack2x16float(node.curvature_bounds_links.y);
    var cell: Cell;
    cell.centroid = node.centroid_area.xyz;
    cell.area = node.centroid_area.w;
    cell.normal = n;
    cell.radius = radii.x;
    cell.normal_radius = radii.y;
    cell.side_1 = e11 * u + e21 * v;
    cell.side_2 = e22 * v;
    cell.change_1 = e11 * n_u + e21 * n_v;
    cell.change_2 = e22 * n_v;
    cell.children = node.curvature_bounds_links.z;
    cell.root = node.curvature_bounds_links.w >> 1u;
    cell.creased = (node.curvature_bounds_links.w & 1u) == 1u;
    let object = roots[cell.root].normal_object.w;
    cell.two_sided = object < 0.0;
    cell.object = i32(abs(object)) - 1;
    cell.most = roots[cell.root].most_phase.x;
    let bend = BEND * (dot(cell.change_1, cell.change_1) + dot(cell.change_2, cell.change_2));
    let own = roots[cell.root].position_lobe.w;
    cell.lobe = length(vec2f(select(bend, 0.0, bend < LEAST_BEND), own));
    return cell;
}

// How much farther reflections go than a cell's footprint where its normals do not turn evenly from end to end, radians.
fn unevenness(cell: Cell) -> f32 {
    let even = FOOTPRINT * sqrt(dot(cell.change_1, cell.change_1) + dot(cell.change_2, cell.change_2));
    return 2.0 * max(cell.normal_radius - even, 0.0);
}

fn is_leaf(cell: Cell) -> bool {
    return (cell.children & 7u) == 0u;
}

// Whether a node is several roots together.
fn is_above_roots(index: u32, cell: Cell) -> bool {
    return index >= tree.first_above && roots[cell.root].map_node.y != index;
}

// A cell and a receiver; the names are those of the gather.
struct Pair {
    d: vec3f,
    l2: f32,
    r: vec3f,
    inverse_l: f32,
    dn: f32,
    facing: f32,
    cosines: f32,
}

fn pair_of(cell: Cell, receiver: Receiver) -> Pair {
    let d = cell.centroid - receiver.position;
    let l2 = dot(d, d);
    let dn = dot(d, cell.normal);
    let facing = select(max(-dn, 0.0), abs(dn), cell.two_sided);
    let inverse_l = inverseSqrt(l2);
    let cosines = facing * max(dot(d, receiver.normal), 0.0) * inverse_l * inverse_l;
    return Pair(d, l2, (d - 2.0 * dn * cell.normal) * inverse_l, inverse_l, dn, facing, cosines);
}

fn weight_of(cell: Cell, pair: Pair, receiver: Receiver) -> f32 {
    return pair.cosines * cell.area * attenuation(pair.l2, cell.area, cell.object == receiver.object);
}

// 1/l² at most, as the gather keeps it finite.
fn most_attenuation(l2: f32, area: f32) -> f32 {
    let inverse = 1.0 / max(l2 + uniforms.epsilon_scale * area + uniforms.epsilon, 1e-20);
    return select(1.0, inverse, uniforms.attenuation != 0u);
}

// The cell's footprint around the reflected direction.
fn footprint_of(cell: Cell, pair: Pair) -> FootprintSides {
    let v1 = reflected_side(cell.side_1, cell.change_1, pair.d, cell.normal, pair.dn, pair.inverse_l, pair.r);
    let v2 = reflected_side(cell.side_2, cell.change_2, pair.d, cell.normal, pair.dn, pair.inverse_l, pair.r);
    let sides = FootprintSides(v1, v2);
    if cell.lobe > 0.0 {
        return blurred(sides, pair.r, cell.normal, abs(pair.dn) * pair.inverse_l, cell.lobe);
    }
    return sides;
}

// Mean radiance over a cell's footprint, as the texture has it; from one look-up where what the pair adds varies by less than its
// share of the error, else from the fewer, the less it does. a = fetches.
fn cell_radiance(cell: Cell, r: vec3f, sides: FootprintSides, varies: f32, share: f32) -> vec4f {
    if varies < share {
        // Cells side by side are as good as a wide kernel, and lose nothing over their mirrors' edges; blur has to be there.
        let part = select(EVEN_PART, SHARPNESS, cell.lobe > 0.0);
        let width = sqrt(0.5 * (dot(sides.v1, sides.v1) + dot(sides.v2, sides.v2))) * part;
        let light_r = light_from_world(r);
        return open_light(r, light_r, floor(level_of(width, texel_width(light_r, uniforms.texel_rad)) + 0.5), 1.0);
    }
    let taps = min(max(ceil(varies * (WORTH / share)), 1.0), f32(uniforms.taps));
    return mean_over_footprint(r, sides.v1, sides.v2, taps, uniforms.texel_rad);
}

// What a cell's weight is multiplied by beside radiance.
fn factor_of(cell: Cell, pair: Pair) -> vec3f {
    return uniforms.radiance_scale * reflectance(roots[cell.root].reflectance, pair.facing * pair.inverse_l);
}

// The part of the environment around a direction that counts: see filters.
fn open_part(direction: vec3f) -> f32 {
    if VISIBILITY {
        return seen_part_of_environment(direction);
    }
    return 1.0;
}

// Bounds of the radiance within a cone around a world direction: x = its most, y = its contrast.
fn light_within(direction: vec3f, radius: f32) -> vec2f {
    let on = on_cube(light_from_world(direction));
    let size = f32(textureDimensions(bounds).x);
    // On a face's plane angles are stretched by 1 + s² + t² at most; a bilinear look-up reads a texel further.
    let reach = 0.5 * size * radius * (1.0 + dot(on.st, on.st)) + 1.0;
    // ⌈log₂ reach⌉ of what is 1 at least; NaN is wider than everything.
    let level = max(i32(bitcast<u32>(0.999999 * reach) >> 23u) - 126, 0);
    let last = i32(textureNumLevels(bounds)) - 1;
    if level > last {
        // Each of the last level's texels knows all faces but the opposite one.
        let most = max(textureLoad(bounds, vec2u(0u), 0u, last).x, textureLoad(bounds, vec2u(0u), 1u, last).x);
        return vec2f(most);
    }
    let edge = max(i32(size) >> u32(level), 1);
    let texel = min(vec2i((0.5 * on.st + 0.5) * f32(edge)), vec2i(edge - 1));
    return textureLoad(bounds, texel, on.face, level).xy;
}

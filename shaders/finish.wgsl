// The end of the hierarchical gather: what was added at blocks' points is interpolated, and every pixel finds its own way down
// from the cells of its smallest block's list. CPU twin: src/pinhole/cpu/hierarchical/packet.rs.
//
// An instance is a tile. Output: rgb = irradiance, W/m², or with SHADING the radiance reflected to the viewer, W/(m²·sr);
// a = number of fetches, or -1 where the adapter ended a loop before its time (Mesa's software one does after 65,535 iterations).

#import pair
#import cube
#import footprint
#import filters
#import visibility
#import brdf
#import hierarchy

@group(1) @binding(2) var receiver_view: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> materials: array<Material>;
@group(1) @binding(4) var<storage, read> tables: array<vec4f>;
// See work.wgsl.
@group(2) @binding(0) var<uniform> stage: Stage;
@group(2) @binding(1) var<storage, read> lists: array<u32>;
@group(2) @binding(2) var smooth_part: texture_2d<f32>;
@group(2) @binding(3) var<uniform> allowed: vec4f;
// What the part before this one came to.
@group(2) @binding(4) var previous: texture_2d<f32>;

// Times that a leaf is quartered.
const DEEPEST: u32 = 5u;
// What varies more than anything.
const INFINITE: f32 = 3e38;
// Levels of cells: of a million roots in fours, and six below each.
const DEPTH: u32 = 20u;

struct Varyings {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) tile: u32,
}

@vertex
fn tile_corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) tile: u32) -> Varyings {
    let corner = vec2u(select(0u, 1u, vertex == 1u || vertex == 3u || vertex == 4u), select(0u, 1u, vertex == 2u || vertex == 4u || vertex == 5u));
    let place = vec2f(min(corner_of(tile) + TILE * corner, tree.size));
    let clip = 2.0 * place / vec2f(tree.size) - 1.0;
    return Varyings(vec4f(clip.x, -clip.y, 0.0, 1.0), tile);
}

fn corner_of(tile: u32) -> vec2u {
    let number = stage.first_tile + tile;
    return TILE * vec2u(number % tree.tiles_across, number / tree.tiles_across);
}

@fragment
fn finish(in: Varyings) -> @location(0) vec4f {
    let pixel = vec2u(in.position.xy);
    let receiver = receiver_at(pixel);
    if receiver.object < 0 {
        return vec4f(0.0);
    }
    let place = pixel - corner_of(in.tile);
    var sum = vec4f(0.0);
    is_whole = true;
    if stage.part > 0u {
        sum = textureLoad(previous, pixel, 0);
        is_whole = sum.a >= 0.0;
    } else {
        for (var level = 0u; level < LEVELS; level++) {
            sum += interpolated(in.tile, level, place);
        }
    }
    var view = vec3f(0.0);
    if SHADING {
        view = textureLoad(receiver_view, pixel, 0).xyz;
    }
    let walk = Walk(receiver, view);
    let start = tree.tops + (in.tile * BLOCKS + block_in_tile(LEVELS - 1u, place / 8u)) * (tree.capacity + 1u);
    let count = lists[start];
    is_whole = is_whole && count != CUT_SHORT;
    seen = Seen(0xffffffffu, 1.0);
    var k = count * stage.part / stage.parts;
    let end = count * (stage.part + 1u) / stage.parts;
    while k < end && is_whole {
        k += 1u;
        sum += brought_below(lists[start + k], walk);
    }
    is_whole = is_whole && k == end;
    return vec4f(sum.rgb, select(-1.0, sum.a, is_whole));
}

// What was added at the sixteen points of a block.
fn interpolated(tile: u32, level: u32, place: vec2u) -> vec4f {
    let edge = TILE >> level;
    let first = block_in_tile(level, place / edge) * POINTS;
    let one = textureLoad(smooth_part, vec2u(first, tile), 0);
    if one.a <= 0.0 {
        return vec4f(0.0, 0.0, 0.0, -one.a);
    }
    let columns = weights_along(edge, place.x % edge);
    let rows = weights_along(edge, place.y % edge);
    var sum = vec3f(0.0);
    for (var k = 0u; k < POINTS; k++) {
        sum += columns[k % 4u] * rows[k / 4u] * textureLoad(smooth_part, vec2u(first + k, tile), 0).rgb;
    }
    return vec4f(sum, one.a);
}

struct Walk {
    receiver: Receiver,
    // Towards the viewer.
    view: vec3f,
}

// The part of the receiver that the root sees whose cells are being visited.
struct Seen {
    root: u32,
    part: f32,
}

var<private> seen: Seen;
// No loop was cut short.
var<private> is_whole: bool;

struct Visit {
    sum: vec4f,
    // The cell is too large.
    further: bool,
}

// What a cell, and those below it, bring to a receiver.
fn brought_below(first: u32, walk: Walk) -> vec4f {
    // Runs of siblings, eight times an index and how many: the one that is walked, and those above it that have not ended.
    var run = 8u * first + 1u;
    var above: array<u32, DEPTH>;
    var depth = 0u;
    var sum = vec4f(0.0);
    var is_done = false;
    loop {
        let index = run >> 3u;
        run += 7u;
        let cell = load_cell(index);
        let visit = visited(index, cell, walk);
        sum += visit.sum;
        if visit.further {
            above[depth] = run;
            depth += select(0u, 1u, (run & 7u) > 0u);
            run = cell.children;
        } else if (run & 7u) == 0u {
            if depth == 0u {
                is_done = true;
                break;
            }
            depth -= 1u;
            run = above[depth];
        }
    }
    is_whole = is_whole && is_done;
    return sum;
}

fn visited(index: u32, cell: Cell, walk: Walk) -> Visit {
    let receiver = walk.receiver;
    let share = SHARE * allowed.x;
    let nothing = Visit(vec4f(0.0), false);
    let of_many = VISIBILITY && is_above_roots(index, cell);
    let is_known = seen.root == cell.root;
    if VISIBILITY && is_known && seen.part == 0.0 {
        return nothing;
    }
    let leaf = is_leaf(cell);
    let pair = pair_of(cell, receiver);
    let l = pair.l2 * pair.inverse_l;
    let lit = pair.cosines > 0.0;
    var weight = 0.0;
    var straddles = false;
    if leaf {
        if !lit {
            return nothing;
        }
        weight = weight_of(cell, pair, receiver);
    } else {
        // The greatest weight of any point of the cell.
        let slack = l * cell.normal_radius + cell.radius;
        let facing = select(-pair.dn, pair.facing, cell.two_sided);
        let receiving = dot(pair.d, receiver.normal);
        straddles = facing < slack || receiving < cell.radius;
        if facing + slack <= 0.0 || receiving + cell.radius <= 0.0 {
            return nothing;
        }
        let nearest = max(l - cell.radius, 0.3 * l);
        let nearest2 = nearest * nearest;
        let cosines = min(facing + slack, l) * min(receiving + cell.radius, l) / nearest2;
        weight = cosines * cell.area * most_attenuation(nearest2, cell.area);
    }
    let sides = footprint_of(cell, pair);
    let squares = dot(sides.v1, sides.v1) + dot(sides.v2, sides.v2);
    let size = pair.inverse_l * cell.radius + cell.normal_radius;
    let radius = select(
        FOOTPRINT * sqrt(squares) + BENT * size * size + unevenness(cell),
        size + cell.normal_radius + cell.lobe,
        cell.creased,
    );
    let light = light_within(pair.r, radius);
    var weight_bound = weight * cell.most;
    var of_gloss = 0.0;
    if SHADING {
        let gloss = gloss_within(pair, walk, size);
        weight_bound *= gloss.x;
        of_gloss = gloss.y;
    }
    let top = weight_bound * light.x;
    let varies = weight_bound * light.y;
    if !(top > NEGLIGIBLE * allowed.x / tree.area * cell.area) {
        return Visit(vec4f(0.0, 0.0, 0.0, 1.0), false);
    }
    if VISIBILITY && !of_many && !is_known {
        look_from(cell.root, receiver);
        if seen.part == 0.0 {
            return Visit(vec4f(0.0, 0.0, 0.0, 1.0), false);
        }
    }
    if leaf {
        if tree.split_near != 0u && top * size * size * OF_WEIGHT > share {
            return Visit(brought_by_quarters(cell, walk) + vec4f(0.0, 0.0, 0.0, 1.0), false);
        }
    } else {
        let error = varies * min(size * OF_CONTRAST, 1.0) + top * (size * size * OF_WEIGHT + of_gloss);
        // Where part of the cell does not count, its centre does not speak for all.
        let whole = select(error < share && size < TOO_LARGE, top < share, straddles);
        // What several roots see together is not known.
        if of_many || !whole {
            return Visit(vec4f(0.0, 0.0, 0.0, 1.0), true);
        }
    }
    if !lit {
        return Visit(vec4f(0.0, 0.0, 0.0, 1.0), false);
    }
    return Visit(brought_by(cell, pair, walk, sides, varies) + vec4f(0.0, 0.0, 0.0, 1.0), false);
}

// What a cell brings, taken for one sample.
fn brought_by(cell: Cell, pair: Pair, walk: Walk, sides: FootprintSides, varies: f32) -> vec4f {
    if VISIBILITY {
        let root = roots[cell.root];
        let side = select(1.0, -1.0, cell.two_sided && pair.dn > 0.0);
        look_around(root.map_node.x, root.most_phase.yz, uniforms.map_resolution, root.normal_object.xyz, side);
    }
    let radiance = cell_radiance(cell, pair.r, sides, varies, SHARE * allowed.x);
    var factor = weight_of(cell, pair, walk.receiver) * seen.part * factor_of(cell, pair);
    if SHADING {
        let solid_angle = cell.area * pair.facing * pair.inverse_l * pair.inverse_l * pair.inverse_l;
        factor *= brdf(u32(walk.receiver.object), walk.receiver.normal, pair.d * pair.inverse_l, walk.view, solid_angle);
    }
    return vec4f(factor * radiance.rgb, radiance.a);
}

// Looks what a root sees of the receiver.
fn look_from(root: u32, receiver: Receiver) {
    let own = roots[root];
    let l = receiver.position - own.position_lobe.xyz;
    let n = own.normal_object.xyz;
    let side = select(1.0, -1.0, own.normal_object.w < 0.0 && dot(l, n) < 0.0);
    look_around(own.map_node.x, own.most_phase.yz, uniforms.map_resolution, n, side);
    seen = Seen(root, visible_part(l));
}

// What receivers reflect to their viewers of the light from a cell of this relative size, at most, in π times their function; and
// what part of that is not so all over the cell.
fn gloss_within(pair: Pair, walk: Walk, size: f32) -> vec2f {
    let object = u32(walk.receiver.object);
    let n = walk.receiver.normal;
    let l = pair.d * pair.inverse_l;
    let mirrored = 2.0 * dot(n, walk.view) * n - walk.view;
    let at_centre = PI * brdf(object, n, l, walk.view, 0.0);
    let there = PI * brdf(object, n, turned(l, mirrored, size), walk.view, 0.0);
    let values = vec2f(max(at_centre.r, max(at_centre.g, at_centre.b)), max(there.r, max(there.g, there.b)));
    let most = max(values.x, values.y);
    return vec2f(most, abs(values.y - values.x) / max(most, 1.2e-38) * OF_CONTRAST);
}

// A unit direction turned by an angle towards another one, or that one if it is nearer.
fn turned(start: vec3f, end: vec3f, angle: f32) -> vec3f {
    let across = end - dot(start, end) * start;
    let sine = length(across);
    if angle >= atan2(sine, dot(start, end)) {
        return end;
    }
    return cos(angle) * start + sin(angle) / sine * across;
}

// What a leaf brings to a receiver so near to it that it is not one sample for it: its parallelogram is quartered until each
// piece is, or is too small to matter.
fn brought_by_quarters(leaf: Cell, walk: Walk) -> vec4f {
    // Two bits a level say which quarter.
    var path = 0u;
    var depth = 1u;
    var sum = vec4f(0.0);
    while depth > 0u {
        let piece = piece_of(leaf, path, depth);
        let pair = pair_of(piece, walk.receiver);
        let size = pair.inverse_l * 0.5 * (length(piece.side_1) + length(piece.side_2));
        if depth < DEEPEST && size > TOO_LARGE {
            path <<= 2u;
            depth += 1u;
            continue;
        }
        if pair.cosines > 0.0 {
            sum += brought_by(piece, pair, walk, footprint_of(piece, pair), INFINITE);
        }
        // Up past all fourth quarters, and on to the next one.
        let last = min(countTrailingZeros(~path) / 2u, depth);
        path = (path >> (2u * last)) + 1u;
        depth -= last;
    }
    is_whole = is_whole && depth == 0u;
    return sum;
}

// A quarter of a quarter, and so on.
fn piece_of(leaf: Cell, path: u32, depth: u32) -> Cell {
    var piece = leaf;
    // No loop: adapters may limit their iterations.
    if depth > 4u {
        piece = quarter_of(piece, (path >> 8u) & 3u);
    }
    if depth > 3u {
        piece = quarter_of(piece, (path >> 6u) & 3u);
    }
    if depth > 2u {
        piece = quarter_of(piece, (path >> 4u) & 3u);
    }
    if depth > 1u {
        piece = quarter_of(piece, (path >> 2u) & 3u);
    }
    return quarter_of(piece, path & 3u);
}

// A quarter of a leaf's parallelogram, to second order.
fn quarter_of(cell: Cell, which: u32) -> Cell {
    let x = select(-0.25, 0.25, (which & 1u) == 1u);
    let y = select(-0.25, 0.25, which > 1u);
    let q = x * cell.side_1 + y * cell.side_2;
    let m = x * cell.change_1 + y * cell.change_2;
    let normal = normalize(cell.normal + m);
    var quarter = cell;
    // Where normals diverge the surface falls away from the tangent plane.
    quarter.centroid = cell.centroid + q - 0.5 * dot(q, m) * cell.normal;
    quarter.normal = normal;
    quarter.area = 0.25 * cell.area;
    quarter.side_1 = 0.5 * (cell.side_1 - dot(cell.side_1, normal) * normal);
    quarter.side_2 = 0.5 * (cell.side_2 - dot(cell.side_2, normal) * normal);
    quarter.change_1 = 0.5 * (cell.change_1 - dot(cell.change_1, normal) * normal);
    quarter.change_2 = 0.5 * (cell.change_2 - dot(cell.change_2, normal) * normal);
    return quarter;
}

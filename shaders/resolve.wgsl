// The last pass of the hierarchical gather: contributions at blocks' points are interpolated, and every pixel traverses the tree from
// the cells of its smallest block's list down. CPU counterpart: src/pinhole/cpu/hierarchical/packet.rs.
//
// An instance is a tile. Output: rgb = irradiance, W/m², or with SHADING the radiance reflected to the viewer, W/(m²·sr);
// a = number of fetches, or -1 where the adapter ended a loop before its time (Mesa's software one does after 65,535 iterations).

#import cell_tree
#import receiver_tiles
#import brdf

// See tile_batch.wgsl.
@group(2) @binding(0) var<uniform> tile_pass: TilePass;
@group(2) @binding(1) var<storage, read> lists: array<u32>;
@group(2) @binding(2) var interpolated_part: texture_2d<f32>;
@group(2) @binding(3) var<uniform> tolerance: Tolerance;
// The sum up to the split pass before this one.
@group(2) @binding(4) var previous: texture_2d<f32>;

// The range of a contribution of which nothing is known.
const UNBOUNDED: f32 = 3e38;
const NO_SAMPLE: u32 = 0xffffffffu;

struct Varyings {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) tile: u32,
}

@vertex
fn tile_corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) tile: u32) -> Varyings {
    let is_right = vertex == 1u || vertex == 3u || vertex == 4u;
    let is_lower = vertex == 2u || vertex == 4u || vertex == 5u;
    let corner = select(vec2u(0u), vec2u(1u), vec2<bool>(is_right, is_lower));
    let place = vec2f(min(corner_of(tile) + TILE_SIZE * corner, tree.size));
    let clip = 2.0 * place / vec2f(tree.size) - 1.0;
    return Varyings(vec4f(clip.x, -clip.y, 0.0, 1.0), tile);
}

fn corner_of(tile: u32) -> vec2u {
    let number = tile_pass.first_tile + tile;
    return TILE_SIZE * vec2u(number % tree.tiles_across, number / tree.tiles_across);
}

// What one pixel carries from cell to cell.
struct Traversal {
    // The sample whose visible fraction of the receiver is known, and that fraction.
    sample: u32,
    visible_fraction: f32,
    // No loop was cut short.
    is_complete: bool,
}

@fragment
fn resolve(in: Varyings) -> @location(0) vec4f {
    let pixel = vec2u(in.position.xy);
    var receiver = receiver_at(pixel);
    if receiver.object < 0 {
        return vec4f(0.0);
    }
    receiver.view = view_direction(pixel);
    let place = pixel - corner_of(in.tile);
    var traversal = Traversal(NO_SAMPLE, 1.0, true);
    var sum = vec4f(0.0);
    if tile_pass.split > 0u {
        sum = textureLoad(previous, pixel, 0);
        traversal.is_complete = sum.a >= 0.0;
    } else {
        for (var level = 0u; level < BLOCK_LEVELS; level++) {
            sum += interpolated(in.tile, level, place);
        }
    }
    let smallest = TILE_SIZE >> (BLOCK_LEVELS - 1u);
    let block = in.tile * BLOCKS_PER_TILE + block_in_tile(BLOCK_LEVELS - 1u, place / smallest);
    let start = tree.root_count + block * (tree.list_capacity + 1u);
    let count = lists[start];
    traversal.is_complete = traversal.is_complete && count != INCOMPLETE;
    var k = count * tile_pass.split / tile_pass.split_count;
    let end = count * (tile_pass.split + 1u) / tile_pass.split_count;
    while k < end && traversal.is_complete {
        k += 1u;
        sum += traverse(lists[start + k], receiver, &traversal);
    }
    let is_complete = traversal.is_complete && k == end;
    return vec4f(sum.rgb, select(-1.0, sum.a, is_complete));
}

// What was added at the sixteen points of a block.
fn interpolated(tile: u32, level: u32, place: vec2u) -> vec4f {
    let edge = TILE_SIZE >> level;
    let first = block_in_tile(level, place / edge) * INTERPOLATION_POINTS;
    let one = textureLoad(interpolated_part, vec2u(first, tile), 0);
    if one.a <= 0.0 {
        return vec4f(0.0, 0.0, 0.0, -one.a);
    }
    let columns = weights_along(edge, place.x % edge);
    let rows = weights_along(edge, place.y % edge);
    var sum = vec3f(0.0);
    for (var k = 0u; k < INTERPOLATION_POINTS; k++) {
        sum += columns[k % 4u] * rows[k / 4u] * textureLoad(interpolated_part, vec2u(first + k, tile), 0).rgb;
    }
    return vec4f(sum, one.a);
}

// What a cell and those below it contribute to a receiver.
fn traverse(first: u32, receiver: Receiver, traversal: ptr<function, Traversal>) -> vec4f {
    // Siblings, eight times an index and how many: those that are visited, and those above them that are left.
    var siblings = 8u * first + 1u;
    var above: array<u32, MAX_TREE_DEPTH>;
    var depth = 0u;
    var sum = vec4f(0.0);
    var is_done = false;
    loop {
        let index = siblings >> 3u;
        siblings += 7u;
        let cell = load_cell(index);
        let visit = visit_cell(index, cell, receiver, traversal);
        sum += visit.sum;
        if visit.is_too_large {
            above[depth] = siblings;
            depth += select(0u, 1u, (siblings & 7u) > 0u);
            siblings = cell.children;
        } else if (siblings & 7u) == 0u {
            if depth == 0u {
                is_done = true;
                break;
            }
            depth -= 1u;
            siblings = above[depth];
        }
    }
    (*traversal).is_complete = (*traversal).is_complete && is_done;
    return sum;
}

struct Visit {
    sum: vec4f,
    is_too_large: bool,
}

// The criterion of refinement for one receiver.
fn visit_cell(index: u32, cell: Cell, receiver: Receiver, traversal: ptr<function, Traversal>) -> Visit {
    let is_occluded_cluster = VISIBILITY && is_cluster(index, cell);
    let is_known = (*traversal).sample == cell.sample;
    if VISIBILITY && is_known && !is_occluded_cluster && (*traversal).visible_fraction == 0.0 {
        return Visit(vec4f(0.0), false);
    }
    let pair = pair_of(cell, receiver);
    let weight = max_weight_of(cell, pair, receiver);
    if weight.value <= 0.0 {
        return Visit(vec4f(0.0), false);
    }
    let sides = footprint_of(cell, pair);
    let size = pair.inverse_l * cell.radius + cell.normal_radius;
    let light = light_within(pair.r, cone_radius(cell, sides, size), cell.blur);
    var gloss = vec2f(1.0, 0.0);
    if SHADING {
        gloss = gloss_within(pair, receiver, size);
    }
    let max_weight = weight.value * cell.max_reflectance * gloss.x;
    let max_contribution = max_weight * light.x;
    let contribution_range = max_weight * light.y;
    let looked_up = vec4f(0.0, 0.0, 0.0, 1.0);
    if !(max_contribution > NEGLIGIBLE_SHARE * tolerance.error / tree.area * cell.area) {
        return Visit(looked_up, false);
    }
    let error_budget = PAIR_ERROR_SHARE * tolerance.error;
    var is_one_sample = true;
    if !is_leaf(cell) {
        let error = contribution_range * min(size * CONTRAST_ERROR_SCALE, 1.0)
            + max_contribution * (size * size * WEIGHT_ERROR_SCALE + gloss.y);
        // Where the pair straddles a horizon, the cell's centroid is not representative.
        is_one_sample =
            select(error < error_budget && size < MAX_RELATIVE_SIZE, max_contribution < error_budget, weight.straddles_horizon);
        if is_occluded_cluster && !(is_one_sample && max_contribution < CENTRAL_VISIBILITY_SHARE * error_budget) {
            return Visit(looked_up, true);
        }
    }
    if VISIBILITY {
        if !is_known {
            find_visible_fraction(cell.sample, receiver, traversal);
        }
        if (*traversal).visible_fraction == 0.0 {
            return Visit(looked_up, false);
        }
    }
    if !is_one_sample {
        return Visit(looked_up, true);
    }
    let is_near = max_contribution * size * size * WEIGHT_ERROR_SCALE > error_budget;
    if is_leaf(cell) && tree.split_near != 0u && is_near {
        return Visit(contribution_of_quarters(cell, receiver, traversal) + looked_up, false);
    }
    if !(pair.cosine_product > 0.0) {
        return Visit(looked_up, false);
    }
    let visible_fraction = (*traversal).visible_fraction;
    return Visit(contribution(cell, pair, receiver, sides, contribution_range, visible_fraction) + looked_up, false);
}

// The greatest weight of any point of a cell.
struct MaxWeight {
    value: f32,
    // Only some points of the cell face the receiver.
    straddles_horizon: bool,
}

fn max_weight_of(cell: Cell, pair: Pair, receiver: Receiver) -> MaxWeight {
    if is_leaf(cell) {
        return MaxWeight(select(0.0, weight_of(cell, pair, receiver), pair.cosine_product > 0.0), false);
    }
    let l = pair.l2 * pair.inverse_l;
    let slack = l * cell.normal_radius + cell.radius;
    let at_sample = select(-pair.dn, pair.cos_at_sample_l, cell.two_sided);
    let at_receiver = dot(pair.d, receiver.normal);
    if at_sample + slack <= 0.0 || at_receiver + cell.radius <= 0.0 {
        return MaxWeight(0.0, false);
    }
    let nearest = max(l - cell.radius, MIN_DISTANCE_RATIO * l);
    let nearest2 = nearest * nearest;
    let cosine_product = min(at_sample + slack, l) * min(at_receiver + cell.radius, l) / nearest2;
    let weight = cosine_product * cell.area * max_attenuation(nearest2, cell.area);
    return MaxWeight(weight, at_sample < slack || at_receiver < cell.radius);
}

// Radius of the cone in which the light comes that a cell of this relative size reflects to a receiver.
fn cone_radius(cell: Cell, sides: FootprintSides, size: f32) -> f32 {
    let squares = dot(sides.v1, sides.v1) + dot(sides.v2, sides.v2);
    return select(
        FOOTPRINT_RADIUS * sqrt(squares) + FOOTPRINT_BEND * size * size + unevenness(cell),
        size + cell.normal_radius + cell.lobe,
        cell.creased,
    );
}

// What a cell, taken for one sample, contributes.
fn contribution(
    cell: Cell, pair: Pair, receiver: Receiver, sides: FootprintSides, contribution_range: f32, visible_fraction: f32,
) -> vec4f {
    var map = map_of_sample(cell.sample, select(1.0, -1.0, cell.two_sided && pair.dn > 0.0));
    var seen = visible_fraction;
    if VISIBILITY && is_mostly_lobe(cell.lobe, cell.change_1, cell.change_2) {
        seen *= lobe_fraction(pair.r, cell.lobe, map);
        map.index = UNOCCLUDED;
        if seen == 0.0 {
            return vec4f(0.0);
        }
    }
    let radiance = cell_radiance(cell, pair.r, sides, contribution_range, PAIR_ERROR_SHARE * tolerance.error, map);
    var factor = weight_of(cell, pair, receiver) * seen * reflected_scale(cell, pair);
    if SHADING {
        let solid_angle = cell.area * pair.cos_at_sample_l * pair.inverse_l * pair.inverse_l * pair.inverse_l;
        factor *= brdf(u32(receiver.object), receiver.normal, pair.d * pair.inverse_l, receiver.view, solid_angle);
    }
    return vec4f(factor * radiance.rgb, radiance.a);
}

// Finds the fraction of the receiver that a sample sees; it holds for all cells of the sample.
fn find_visible_fraction(sample: u32, receiver: Receiver, traversal: ptr<function, Traversal>) {
    let l = receiver.position - sample_nodes[sample].position;
    let two_sided = (sample_nodes[sample].object_sides & 1u) == 1u;
    let side = select(1.0, -1.0, two_sided && dot(l, sample_nodes[sample].normal) < 0.0);
    (*traversal).sample = sample;
    (*traversal).visible_fraction = visible_fraction(l, map_of_sample(sample, side));
}

// π times the receiver's function at most, for light from a cell of this relative size; and the part of that by which it differs
// within the cell, scaled as an error.
fn gloss_within(pair: Pair, receiver: Receiver, size: f32) -> vec2f {
    let object = u32(receiver.object);
    let n = receiver.normal;
    let l = pair.d * pair.inverse_l;
    let mirrored = 2.0 * dot(n, receiver.view) * n - receiver.view;
    let at_centre = PI * brdf(object, n, l, receiver.view, 0.0);
    let nearest = PI * brdf(object, n, turned(l, mirrored, size), receiver.view, 0.0);
    let values = vec2f(max(at_centre.r, max(at_centre.g, at_centre.b)), max(nearest.r, max(nearest.g, nearest.b)));
    let maximum = max(values.x, values.y);
    return vec2f(maximum, abs(values.y - values.x) / max(maximum, 1.2e-38) * CONTRAST_ERROR_SCALE);
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

// What a leaf contributes to a receiver so near to it that it is not one sample for it: its parallelogram is quartered until each
// piece is, or is too small to matter.
fn contribution_of_quarters(leaf: Cell, receiver: Receiver, traversal: ptr<function, Traversal>) -> vec4f {
    // Two bits a level say which quarter.
    var path = 0u;
    var depth = 1u;
    var sum = vec4f(0.0);
    while depth > 0u {
        let piece = piece_of(leaf, path, depth);
        let pair = pair_of(piece, receiver);
        let size = pair.inverse_l * 0.5 * (length(piece.side_1) + length(piece.side_2));
        if depth < MAX_QUARTERINGS && size > MAX_RELATIVE_SIZE {
            path <<= 2u;
            depth += 1u;
            continue;
        }
        if pair.cosine_product > 0.0 {
            let sides = footprint_of(piece, pair);
            sum += contribution(piece, pair, receiver, sides, UNBOUNDED, (*traversal).visible_fraction);
        }
        // Up past all fourth quarters, and on to the next one.
        let last = min(countTrailingZeros(~path) / 2u, depth);
        path = (path >> (2u * last)) + 1u;
        depth -= last;
    }
    (*traversal).is_complete = (*traversal).is_complete && depth == 0u;
    return sum;
}

// A quarter of a quarter, and so on, up to MAX_QUARTERINGS times.
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

// The last pass of the hierarchical gather: contributions at blocks' points are interpolated, and every pixel traverses the tree from
// the cells of its smallest block's list down. CPU counterpart: src/sums/pinhole/cpu/hierarchical/packet.rs.
//
// An instance is a tile. Output: rgb = irradiance, W/m², or with SHADING the radiance reflected to the viewer, W/(m²·sr);
// a = number of fetches, or -1 where the adapter ended a loop before its time (Mesa's software one does after 65,535 iterations).

#import cell_tree
#import cell_quarters
#import contribution_bounds
#import near_light_cells
#import receiver_tiles
#import rays
#import traversal

// See tile_batch.wgsl.
@group(2) @binding(0) var<uniform> tile_pass: TilePass;
@group(2) @binding(1) var<storage, read> lists: array<u32>;
@group(2) @binding(2) var interpolated_part: texture_2d<f32>;
@group(2) @binding(3) var<uniform> tolerance: Tolerance;
// The sum up to the pass before this one, and where its walk stopped.
@group(2) @binding(4) var previous: texture_2d<f32>;
@group(2) @binding(5) var previous_walk: texture_2d<u32>;

// The range of a contribution of which nothing is known.
const UNBOUNDED: f32 = 3e38;
// A pass other than the last stops after about this many iterations of loops: eight lanes in lockstep stay below 65,535.
const WORK_PER_PASS: u32 = 4000u;
// Where loops were cut short, so that there are at least this many passes, a leaf is quartered no further after this much work:
// with a pass it stays below that limit, too.
const MANY_PASSES: u32 = 100u;
const MAX_WORK_PER_LEAF: u32 = 2500u;
// Iterations of the loops in a visit that finds nothing to do for them.
const WORK_PER_VISIT: u32 = 12u;

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

// Where a pixel's walk through its list of cells, and down from each, is.
struct Walk {
    // Entries of the list that are done.
    entry: u32,
    // From the entry's cell down to the next one to be visited: how far, and which child each time, two bits for each level.
    level: u32,
    path: vec2u,
}

struct Resolved {
    @location(0) sum: vec4f,
    // Where the walk stopped.
    @location(1) walk: vec4u,
}

// Iterations of loops in this pass, roughly.
var<private> work: u32;

@fragment
fn resolve(in: Varyings) -> Resolved {
    let pixel = vec2u(in.position.xy);
    var receiver = receiver_at(pixel);
    if receiver.object < 0 {
        return Resolved();
    }
    receiver.view = view_direction(pixel);
    let place = pixel - corner_of(in.tile);
    var traversal = Traversal(NO_SAMPLE, 1.0, false, true);
    var walk = Walk();
    var sum = vec4f(0.0);
    if tile_pass.split > 0u {
        sum = textureLoad(previous, pixel, 0);
        let before = textureLoad(previous_walk, pixel, 0);
        walk = Walk(before.x, before.y & 255u, before.zw);
        traversal.is_complete = before.y < 256u;
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
    let is_last = tile_pass.split + 1u == tile_pass.split_count;
    while walk.entry < count && traversal.is_complete && (is_last || work < WORK_PER_PASS) {
        sum += traverse(lists[start + 1u + walk.entry], receiver, &walk, &traversal);
    }
    if is_last && !(traversal.is_complete && walk.entry == count) {
        sum.a = -1.0;
    }
    return Resolved(sum, vec4u(walk.entry, walk.level + select(256u, 0u, traversal.is_complete), walk.path));
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

// What a cell and those below it contribute to a receiver, from where the walk is; ends before them if there is too much to do for one
// pass.
fn traverse(first: u32, receiver: Receiver, walk: ptr<function, Walk>, traversal: ptr<function, Traversal>) -> vec4f {
    // Of the cells on the path: eight times the first child's index, and how many.
    var children: array<u32, MAX_TREE_DEPTH>;
    let is_seen = (first & FULLY_VISIBLE) != 0u;
    let channel = first & CHANNEL_BITS;
    var index = first & NODE_MASK;
    for (var level = 0u; level < (*walk).level; level++) {
        children[level] = nodes[index].curvature_bounds_links.z;
        index = (children[level] >> 3u) + step_of((*walk).path, level);
    }
    let is_last = tile_pass.split + 1u == tile_pass.split_count;
    var sum = vec4f(0.0);
    var is_done = false;
    loop {
        let cell = load_cell(index | channel);
        let visit = visit_cell(index, cell, is_seen, receiver, traversal);
        sum += visit.sum;
        work += WORK_PER_VISIT + filter_work + ray_work;
        filter_work = 0u;
        ray_work = 0u;
        var level = (*walk).level;
        if visit.is_too_large {
            children[level] = cell.children;
            level += 1u;
            (*walk).path = with_step((*walk).path, level - 1u, 0u);
        } else {
            // Up past all last children, and on to the next one.
            while level > 0u && step_of((*walk).path, level - 1u) + 1u == (children[level - 1u] & 7u) {
                level -= 1u;
            }
            if level == 0u {
                (*walk).entry += 1u;
                (*walk).level = 0u;
                is_done = true;
                break;
            }
            (*walk).path = with_step((*walk).path, level - 1u, step_of((*walk).path, level - 1u) + 1u);
        }
        (*walk).level = level;
        index = (children[level - 1u] >> 3u) + step_of((*walk).path, level - 1u);
        if !is_last && work >= WORK_PER_PASS {
            is_done = true;
            break;
        }
    }
    (*traversal).is_complete = (*traversal).is_complete && is_done && rays_are_complete;
    return sum;
}

// Which child a path takes at a level.
fn step_of(path: vec2u, level: u32) -> u32 {
    return (select(path.x, path.y, level >= 16u) >> (2u * (level & 15u))) & 3u;
}

fn with_step(path: vec2u, level: u32, child: u32) -> vec2u {
    let shift = 2u * (level & 15u);
    let is_low = level < 16u;
    let word = (select(path.y, path.x, is_low) & ~(3u << shift)) | (child << shift);
    return select(vec2u(path.x, word), vec2u(word, path.y), is_low);
}

struct Visit {
    sum: vec4f,
    is_too_large: bool,
}

// The criterion of refinement for one receiver.
// `is_seen`: its sample sees the receiver.
fn visit_cell(
    index: u32, cell: Cell, is_seen: bool, receiver: Receiver, traversal: ptr<function, Traversal>,
) -> Visit {
    let is_occluded_cluster = VISIBILITY && is_cluster(index, cell);
    let is_known = (*traversal).sample == cell.sample;
    if VISIBILITY && !is_seen && is_known && !is_occluded_cluster && is_unseen(traversal) {
        return Visit(vec4f(0.0), false);
    }
    let pair = pair_of(cell, receiver);
    let weight = max_weight_of(cell, pair, receiver);
    if weight.value <= 0.0 {
        return Visit(vec4f(0.0), false);
    }
    let sides = footprint_of(cell, pair);
    let bounds = contribution_bounds(cell, pair, receiver, sides, weight);
    let max_contribution = bounds.maximum;
    let size = bounds.size;
    let looked_up = vec4f(0.0, 0.0, 0.0, 1.0);
    if !(max_contribution > NEGLIGIBLE_SHARE * allowed_error(receiver) / tree.area * cell.area) {
        return Visit(looked_up, false);
    }
    let budget = error_budget(allowed_error(receiver), cell.area);
    var is_one_sample = true;
    if !is_leaf(cell) {
        let error = bounds.range * min(bounds.turned * CONTRAST_ERROR_SCALE, 1.0) * bounds.left_along_part
            + max_contribution * (size * size * WEIGHT_ERROR_SCALE + bounds.receiver_error);
        // Where the pair straddles a horizon, the cell's centroid is not representative.
        is_one_sample =
            select(error < budget && size < MAX_RELATIVE_SIZE, max_contribution < budget, weight.straddles_horizon);
        if is_part_of_ray(receiver.object) && !is_cluster(index, cell) {
            // Next to total reflection light turns without bound; samples are small enough there, too.
            let normals = select(cell.normal_radius, 0.0, is_interface(cell.flags));
            let relative_size = pair.inverse_l * cell.radius;
            let is_blurred = bounds.left_along_part < MAX_LEFT_ALONG_RAY && relative_size < MAX_RELATIVE_SIZE;
            is_one_sample = is_one_sample || is_blurred || relative_size + normals < MAX_TURN_ALONG_RAY;
        }
        if is_occluded_cluster && !(is_one_sample && max_contribution < CENTRAL_VISIBILITY_SHARE * budget) {
            return Visit(looked_up, true);
        }
    }
    var seen = 1.0;
    if VISIBILITY && !is_seen {
        if !is_known {
            find_visible_fraction(cell.sample, receiver, traversal);
        }
        let is_large = max_contribution >= budget;
        if is_unseen(traversal) {
            return Visit(looked_up, false);
        }
        // What is large and in doubt is taken leaf by leaf.
        let in_leaves = is_large && (*traversal).is_doubtful;
        is_one_sample = is_one_sample && (is_leaf(cell) || !in_leaves);
        seen = (*traversal).visible_fraction;
        let min_traced = select(MIN_TRACED_SHARE, MIN_TRACED_SHARE_OF_INTERFACES, is_interface(cell.flags)) * budget;
        if is_one_sample && (*traversal).is_doubtful && max_contribution >= min_traced {
            let leaving = ray_origin_of(cell, receiver_side(cell.flags, pair.dn));
            seen = select(1.0, 0.0, is_occluded(leaving, -pair.d * pair.inverse_l, pair.l2 * pair.inverse_l));
        }
    }
    if !is_one_sample {
        return Visit(looked_up, true);
    }
    if seen == 0.0 {
        return Visit(looked_up, false);
    }
    var quality = LookUpQuality(bounds.range, taps_for(bounds.range, budget), max_contribution, false);
    if is_part_of_ray(receiver.object) {
        // Along a part of a ray a sun is easily missed.
        quality.range = UNBOUNDED;
    } else {
        let v1 = dot(sides.v1, sides.v1);
        let v2 = dot(sides.v2, sides.v2);
        let texel2 = 6.2831853 / f32(uniforms.map_resolution * uniforms.map_resolution);
        let is_worth_rays = tree.traces_rays != 0u && max_contribution >= MIN_TRACED_SKY_SHARE * budget;
        quality.is_traced = is_worth_rays && min(v1, v2) < texel2;
    }
    if is_leaf(cell) && tree.split_near != 0u && is_uneven(max_contribution, size, budget) {
        // The most that reaches the receiver per weight.
        let max_light = max_contribution / weight.value;
        return Visit(contribution_of_quarters(cell, receiver, seen, max_light, traversal) + looked_up, false);
    }
    if !(pair.cosine_product > 0.0) {
        return Visit(looked_up, false);
    }
    return Visit(contribution(cell, pair, receiver, sides, quality, seen) + looked_up, false);
}

// How exactly the light of a cell is looked up that is taken for one sample.
struct LookUpQuality {
    // How much its contribution differs within it, W/m².
    range: f32,
    // Near light is looked up in so many places.
    taps: f32,
    // Upper bound of its contribution, W/m².
    max_contribution: f32,
    // Whether rays tell what visibility maps leave in doubt about the sky.
    is_traced: bool,
}

// W/m².
fn allowed_error(receiver: Receiver) -> f32 {
    return tolerance.error + tolerated_error(receiver);
}

// What a cell, taken for one sample, contributes.
fn contribution(
    cell: Cell, pair: Pair, receiver: Receiver, sides: FootprintSides, quality: LookUpQuality, visible_fraction: f32,
) -> vec4f {
    if LIGHT != LIGHT_ENVIRONMENT {
        return near_contribution(cell, pair, receiver, quality, visible_fraction);
    }
    let side = sky_side(cell.flags, pair.dn);
    var map = map_of_sample(cell.sample, side);
    map.is_traced = quality.is_traced;
    map.leaving = ray_origin_of(cell, side);
    var seen = visible_fraction;
    if VISIBILITY && !is_interface(cell.flags) && is_wide_lobe(cell.lobe, cell.change_1, cell.change_2) {
        seen *= lobe_fraction(pair.r, cell.lobe, map);
        map.index = UNOCCLUDED;
        if seen == 0.0 {
            return vec4f(0.0);
        }
    }
    let radiance = cell_radiance(cell, pair, sides, quality.range, error_budget(allowed_error(receiver), cell.area), map);
    return vec4f(seen * factor_on_radiance(cell, pair, receiver) * radiance.rgb, radiance.a);
}

// The same under near light, which comes from one point as far as occlusion goes. A map misses what is narrower than its texels, and all
// light of a lamp may come through that: what counts is traced.
fn near_contribution(
    cell: Cell, pair: Pair, receiver: Receiver, quality: LookUpQuality, visible_fraction: f32,
) -> vec4f {
    let light = near_light_at(cell, pair, quality.taps);
    if all(light.radiance.rgb == vec3f(0.0)) {
        return vec4f(0.0);
    }
    var seen = visible_fraction;
    if VISIBILITY {
        let side = sky_side(cell.flags, pair.dn);
        let min_traced = MIN_TRACED_SHARE * error_budget(allowed_error(receiver), cell.area);
        if tree.traces_rays != 0u && quality.max_contribution >= min_traced {
            let l = length(light.towards);
            seen *= select(1.0, 0.0, is_occluded(ray_origin_of(cell, side), light.towards / l, l));
        } else {
            seen *= visibility_of_point(light.towards, map_of_sample(cell.sample, side), -1).fraction;
        }
    }
    return vec4f(seen * factor_on_radiance(cell, pair, receiver) * light.radiance.rgb, light.radiance.a);
}

// What the radiance that arrives at a cell is multiplied by.
fn factor_on_radiance(cell: Cell, pair: Pair, receiver: Receiver) -> vec3f {
    let factor = weight_of(cell, pair, receiver) * reflected_scale(cell, pair, receiver);
    if SHADING {
        let solid_angle = cell.area * pair.cos_at_sample_l * pair.inverse_l * pair.inverse_l * pair.inverse_l;
        return factor * brdf(u32(receiver.object), receiver.normal, pair.d * pair.inverse_l, receiver.view, solid_angle);
    }
    return factor;
}

// Whether the weight of a cell of this relative size differs too much within it.
fn is_uneven(max_contribution: f32, size: f32, budget: f32) -> bool {
    // A lamp's light comes from anywhere on the cell, that of the environment from all of it.
    let of_size = select(size * size, size, LIGHT == LIGHT_LAMP);
    if LIGHT == LIGHT_LAMP && size <= MIN_UNEVEN_SIZE {
        return false;
    }
    return max_contribution * of_size * WEIGHT_ERROR_SCALE > budget;
}

// What a leaf contributes to a receiver so near to it that it is not one sample for it: its parallelogram is quartered until each
// piece is, or is too small to matter. Nothing traces rays here: loops of rays that are masked out count as iterations, too.
fn contribution_of_quarters(
    leaf: Cell, receiver: Receiver, visible_fraction: f32, max_light: f32, traversal: ptr<function, Traversal>,
) -> vec4f {
    let allowed = allowed_error(receiver);
    // Two bits a level say which quarter.
    var path = 0u;
    var depth = 1u;
    var sum = vec4f(0.0);
    while depth > 0u {
        filter_work += 1u + max(depth, 7u) - 7u;
        let piece = piece_of(leaf, path, depth);
        let pair = pair_of(piece, receiver);
        let may_matter = LIGHT != LIGHT_LAMP || may_mirror_lamp(piece, pair);
        let max_contribution = max_light * weight_of(piece, pair, receiver);
        if may_matter && has_to_be_quartered(piece, pair, depth, max_contribution, error_budget(allowed, piece.area)) {
            path <<= 2u;
            depth += 1u;
            continue;
        }
        if may_matter && pair.cosine_product > 0.0 {
            let quality = LookUpQuality(UNBOUNDED, f32(uniforms.taps), max_contribution, false);
            sum += contribution(piece, pair, receiver, footprint_of(piece, pair), quality, visible_fraction);
        }
        // Up past all fourth quarters, and on to the next one.
        let last = min(countTrailingZeros(~path) / 2u, depth);
        path = (path >> (2u * last)) + 1u;
        depth -= last;
    }
    (*traversal).is_complete = (*traversal).is_complete && depth == 0u;
    return sum;
}

// Whether a piece of a leaf is too near to a receiver to be one sample, and not too small to matter.
fn has_to_be_quartered(piece: Cell, pair: Pair, depth: u32, max_contribution: f32, budget: f32) -> bool {
    let extent = 0.5 * (length(piece.side_1) + length(piece.side_2));
    let size = size_for_light(pair.inverse_l * extent, piece, extent);
    let is_large = size > MAX_RELATIVE_SIZE
        || (size > MAX_PIECE_SIZE && is_uneven(max_contribution, size, budget));
    let most = select(MAX_QUARTERINGS, MAX_LAMP_QUARTERINGS, LIGHT == LIGHT_LAMP);
    return depth < most && is_large && (filter_work < MAX_WORK_PER_LEAF || tile_pass.split_count < MANY_PASSES);
}

// Refines pairs of a block of receivers and a cell: one workgroup takes its block and the cells of the parent block's list. Pairs are
// dropped, added at the block's sixteen points, or refined: on the side of the cell here, on the side of the block by the next
// level, which finds them in this block's list. CPU counterparts: src/sums/pinhole/cpu/hierarchical/{tile,criterion}.rs.
//
// Lists are bounded. Where one might overflow, cells are handed on as they are: the next level refines them, and at last every
// point for itself (resolve.wgsl).

#import no_rays
#import block_coverage
#import block_pairs
#import frame
#import near_light_cells
#import point_visibility
#import tile_batch

// Nodes that the stack holds.
const STACK_SIZE: u32 = 1536u;

// What to do with a pair.
const DROP: u32 = 0u;
const SPLIT_CELL: u32 = 1u;
const SPLIT_BLOCK: u32 = 2u;
const ADD: u32 = 3u;

struct Decision {
    action: u32,
    // How much the pair's contribution differs within it, W/m².
    contribution_range: f32,
    // Upper bound of the contribution, W/m².
    max_contribution: f32,
    // The cone in which the light comes, radians.
    cone_axis: vec3f,
    cone_radius: f32,
}

// Nodes to be decided on.
var<workgroup> stack: array<u32, STACK_SIZE>;
// Nodes to be added, and the ranges of their contributions.
var<workgroup> queue: array<u32, WORKGROUP_SIZE>;
var<workgroup> queued_ranges: array<f32, WORKGROUP_SIZE>;
// How many children, deferred nodes and queued ones: ten bits each.
var<workgroup> counts: array<u32, WORKGROUP_SIZE>;
var<workgroup> sums_of_counts: array<u32, 8>;
var<workgroup> sums: array<vec4f, WORKGROUP_SIZE>;
var<workgroup> points: array<Receiver, INTERPOLATION_POINTS>;
var<workgroup> input_count: u32;

// How far a block is. All lanes have the same.
struct Progress {
    // The next entry of the parent's list, and how many are left there.
    input: u32,
    inputs_left: u32,
    // Nodes on the stack, and in this block's list.
    pending: u32,
    deferred: u32,
    // Pairs decided on, and added.
    decided: u32,
    added: u32,
}

@compute @workgroup_size(WORKGROUP_SIZE)
fn refine(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let at = place_of_block(workgroup.x);
    let block = blocks[at.index];
    if lane < INTERPOLATION_POINTS {
        points[lane] = interpolation_point(at, lane);
    }
    var progress = start(at, block, lane);
    var own_sum = vec4f(0.0);
    var is_done = false;
    loop {
        pull_inputs(&progress, lane);
        if progress.pending == 0u {
            is_done = true;
            break;
        }
        if is_nearly_full(progress) {
            hand_on(at, &progress, lane);
            is_done = true;
            break;
        }
        own_sum += process(at, block, &progress, lane);
    }
    if lane == 0u {
        lists[list_of(at.index)] = select(INCOMPLETE, progress.deferred, is_done && input_count != INCOMPLETE);
    }
    store_sums(at, progress, own_sum, lane);
}

// At the first level every node without a parent is an input, further down the list of the block around this one.
fn start(at: BlockPlace, block: Block, lane: u32) -> Progress {
    var input = 0u;
    if at.level > 0u {
        input = list_of(at.tile * BLOCKS_PER_TILE + block_in_tile(at.level - 1u, at.block / 2u));
    }
    if lane == 0u {
        input_count = tree.root_count;
        if at.level > 0u {
            input_count = lists[input];
        }
    }
    if at.level > 0u {
        input += 1u;
    }
    let count = workgroupUniformLoad(&input_count);
    let left = select(count, 0u, block.kind == EMPTY || count == INCOMPLETE);
    return Progress(input, left, 0u, 0u, 0u, 0u);
}

// Fills the stack up to a node for each lane.
fn pull_inputs(progress: ptr<function, Progress>, lane: u32) {
    let pending = (*progress).pending;
    let pulled = min(WORKGROUP_SIZE - min(pending, WORKGROUP_SIZE), (*progress).inputs_left);
    if lane < pulled {
        stack[pending + lane] = lists[(*progress).input + lane];
    }
    (*progress).input += pulled;
    (*progress).inputs_left -= pulled;
    (*progress).pending += pulled;
    workgroupBarrier();
}

// Whether another round might overflow the stack or the list: a lane's node is replaced by MAX_CHILDREN at most.
fn is_nearly_full(progress: Progress) -> bool {
    let more = (MAX_CHILDREN - 1u) * WORKGROUP_SIZE;
    return progress.pending + more > STACK_SIZE
        || progress.pending + progress.deferred + progress.inputs_left + more > tree.list_capacity;
}

// Hands everything on to the next level.
fn hand_on(at: BlockPlace, progress: ptr<function, Progress>, lane: u32) {
    let pending = (*progress).pending;
    let left = (*progress).inputs_left;
    let end = list_of(at.index) + 1u + (*progress).deferred;
    for (var k = lane; k < pending; k += WORKGROUP_SIZE) {
        lists[end + k] = stack[k];
    }
    for (var k = lane; k < left; k += WORKGROUP_SIZE) {
        lists[end + pending + k] = lists[(*progress).input + k];
    }
    (*progress).deferred += pending + left;
}

// Decides on a node for each lane, and adds what may be added. Returns contributions to the lane's point.
fn process(at: BlockPlace, block: Block, progress: ptr<function, Progress>, lane: u32) -> vec4f {
    let taken = min((*progress).pending, WORKGROUP_SIZE);
    (*progress).pending -= taken;
    (*progress).decided += taken;
    var index = 0u;
    var children = 0u;
    // FULLY_VISIBLE or 0.
    var seen = 0u;
    var decision = Decision(DROP, 0.0, 0.0, vec3f(0.0), 0.0);
    if lane < taken {
        index = stack[(*progress).pending + lane];
        seen = index & FULLY_VISIBLE;
        index &= ~FULLY_VISIBLE;
        let cell = load_cell(index);
        children = cell.children;
        decision = decide(block, at.level, cell);
        if VISIBILITY {
            let is_cluster = is_cluster(index, cell);
            // Of a cluster, other samples may see what its central one does not.
            if !is_cluster && seen == 0u && block.kind == SMOOTH && decision.action != DROP {
                let coverage = receiver_coverage(cell.sample, block, points[0].object);
                seen = select(0u, FULLY_VISIBLE, coverage == FULL);
                if coverage == NONE {
                    decision.action = DROP;
                }
            }
            if decision.action == ADD {
                decision.action = action_with_occlusion(cell, block, decision, seen != 0u, is_cluster);
            }
        }
    }
    let count = select(0u, children & 7u, decision.action == SPLIT_CELL)
        + select(0u, 1u << 10u, decision.action == SPLIT_BLOCK) + select(0u, 1u << 20u, decision.action == ADD);
    let sum = prefix_sum(count, lane);
    if decision.action == SPLIT_CELL {
        for (var k = 0u; k < (children & 7u); k++) {
            stack[(*progress).pending + (sum.before & 1023u) + k] = ((children >> 3u) + k) | seen | (index & CHANNEL_BITS);
        }
    }
    if decision.action == SPLIT_BLOCK {
        lists[list_of(at.index) + 1u + (*progress).deferred + ((sum.before >> 10u) & 1023u)] = index | seen;
    }
    if decision.action == ADD {
        queue[sum.before >> 20u] = index;
        queued_ranges[sum.before >> 20u] = decision.contribution_range;
    }
    let queued = sum.total >> 20u;
    (*progress).pending += sum.total & 1023u;
    (*progress).deferred += (sum.total >> 10u) & 1023u;
    (*progress).added += queued;
    workgroupBarrier();
    var own_sum = vec4f(0.0);
    for (var k = lane / INTERPOLATION_POINTS; k < queued; k += WORKGROUP_SIZE / INTERPOLATION_POINTS) {
        own_sum += contribution(queue[k], queued_ranges[k], points[lane % INTERPOLATION_POINTS], block);
    }
    return own_sum;
}

// What occlusion allows under a lamp: to add the cell if it sees the lamp's centre and four places at its edge, to drop it if it sees none
// of them.
fn action_under_lamp(cell: Cell, map: VisibilityMap) -> u32 {
    let to = uniforms.lamp.position - cell.centroid;
    let centre = visibility_of_point(to, map, -1);
    // Interpolation may round.
    let is_seen = centre.fraction > 0.9999;
    if centre.is_doubtful || !(is_seen || centre.fraction == 0.0) {
        return SPLIT_BLOCK;
    }
    let frame = tangent_frame(normalize(to));
    for (var k = 0u; k < 4u; k++) {
        let side = select(frame.u, frame.v, k > 1u) * select(1.0, -1.0, (k & 1u) == 0u);
        let edge = visibility_of_point(to + uniforms.lamp.radius * side, map, -1);
        if edge.is_doubtful || abs(edge.fraction - centre.fraction) > 1e-4 {
            return SPLIT_BLOCK;
        }
    }
    return select(DROP, ADD, is_seen);
}

// Turns ADD into what occlusion allows.
fn action_with_occlusion(cell: Cell, block: Block, decision: Decision, is_seen: bool, is_cluster: bool) -> u32 {
    if is_cluster {
        let needs_own_maps = decision.max_contribution >= CENTRAL_VISIBILITY_SHARE * error_budget_of(block, cell);
        return select(SPLIT_BLOCK, SPLIT_CELL, needs_own_maps);
    }
    if !is_seen {
        return SPLIT_BLOCK;
    }
    let d = cell.centroid - block.centre;
    let dn = dot(d, cell.normal);
    let map = map_of_sample(cell.sample, sky_side(cell.flags, dn));
    if LIGHT == LIGHT_LAMP {
        return action_under_lamp(cell, map);
    }
    if LIGHT == LIGHT_SURROUNDINGS {
        return SPLIT_BLOCK;
    }
    // Lobes see more of the sky than bounds of their light cover.
    let lobe_radius = block.radius / length(d) + FOOTPRINT_RADIUS * LOBE_TAIL * cell.lobe;
    let radius = max(decision.cone_radius + select(0.0, cell.lobe, cell.creased), lobe_radius);
    let region = map_region(decision.cone_axis * map.axes, radius, map);
    if !region.is_small {
        return SPLIT_BLOCK;
    }
    let columns = (0xffffffffu >> (31u - region.last.x)) & (0xffffffffu << region.first.x);
    var any_sky = 0u;
    var all_sky = 0xffffffffu;
    for (var j = region.first.y; j <= region.last.y; j++) {
        let row = sky_masks[map.index * uniforms.map_resolution + j];
        any_sky |= row;
        all_sky &= row;
    }
    if (any_sky & columns) == 0u {
        return DROP;
    }
    return select(SPLIT_BLOCK, ADD, (all_sky & columns) == columns);
}

struct PrefixSum {
    // Over the lanes before this one, and over all.
    before: u32,
    total: u32,
}

fn prefix_sum(count: u32, lane: u32) -> PrefixSum {
    counts[lane] = count;
    workgroupBarrier();
    if lane < 8u {
        var sum = 0u;
        for (var k = 0u; k < 8u; k++) {
            sum += counts[8u * lane + k];
        }
        sums_of_counts[lane] = sum;
    }
    workgroupBarrier();
    var sum = PrefixSum(0u, 0u);
    for (var k = lane & 56u; k < lane; k++) {
        sum.before += counts[k];
    }
    for (var k = 0u; k < 8u; k++) {
        sum.before += select(0u, sums_of_counts[k], k < lane / 8u);
        sum.total += sums_of_counts[k];
    }
    return sum;
}

// What a cell contributes to one of the sixteen points.
fn contribution(index: u32, contribution_range: f32, receiver: Receiver, block: Block) -> vec4f {
    let cell = load_cell(index);
    let pair = pair_of(cell, receiver);
    // Also false where the cell lies on the receiver point and the quotient is not a number.
    if !(pair.cosine_product > 0.0) {
        return vec4f(0.0);
    }
    // Only pairs whose light is wholly unoccluded are added.
    var map: VisibilityMap;
    map.index = UNOCCLUDED;
    var radiance: vec4f;
    if LIGHT != LIGHT_ENVIRONMENT {
        radiance = near_light_at(cell, pair, f32(uniforms.taps)).radiance;
        if all(radiance.rgb == vec3f(0.0)) {
            return vec4f(0.0);
        }
    } else {
        radiance = cell_radiance(cell, pair, footprint_of(cell, pair), contribution_range, error_budget_of(block, cell), map);
    }
    return vec4f(weight_of(cell, pair, receiver) * reflected_scale(cell, pair, receiver) * radiance.rgb, radiance.a);
}

// Adds up the lanes of each point.
fn store_sums(at: BlockPlace, progress: Progress, own_sum: vec4f, lane: u32) {
    sums[lane] = own_sum;
    workgroupBarrier();
    if lane >= INTERPOLATION_POINTS {
        return;
    }
    var sum = vec3f(0.0);
    var fetches = f32(progress.decided);
    for (var k = lane; k < WORKGROUP_SIZE; k += INTERPOLATION_POINTS) {
        sum += sums[k].rgb;
    }
    for (var k = 0u; k < WORKGROUP_SIZE; k++) {
        fetches += sums[k].a;
    }
    fetches /= f32(at.edge * at.edge);
    // Negative: fetches only.
    let texel = vec2u((at.index % BLOCKS_PER_TILE) * INTERPOLATION_POINTS + lane, at.tile);
    textureStore(interpolated_part, texel, vec4f(sum, select(-fetches, fetches, progress.added > 0u)));
}

// The error that a pair with a cell may add at the points of a block, W/m².
fn error_budget_of(block: Block, cell: Cell) -> f32 {
    return error_budget(tolerance.error + block.tolerated, cell.area);
}

// The criterion of refinement.
fn decide(block: Block, level: u32, cell: Cell) -> Decision {
    let pair = block_pair(block, cell);
    if pair.max_cos_at_sample_l <= 0.0 || pair.max_cos_at_receiver_l <= 0.0 || pair.crossing.factor == 0.0 {
        return Decision(DROP, 0.0, 0.0, vec3f(0.0), 0.0);
    }
    if pair.l < NEAR_FIELD_SIZES * pair.sizes {
        return Decision(select(SPLIT_BLOCK, SPLIT_CELL, !is_leaf(cell) && cell.radius >= block.radius), 0.0, 0.0, vec3f(0.0), 0.0);
    }
    let block_size = block.radius / pair.l;
    let cell_size = cell.radius / pair.l + cell.normal_radius;
    let cone = light_cone(cell, pair, block_size, cell_size);
    var light: vec2f;
    if cone.is_towards_lamp {
        light = lamp_within_cone(cell, cone.direction, cone.radius, !is_part_of_ray(block.object));
    } else {
        light = light_within(cell, cone.direction, cone.radius);
    }
    let max_weight = max_weight_of(cell, pair);
    let max_contribution = max_weight * light.x;
    let contribution_range = max_weight * light.y;
    let negligible = NEGLIGIBLE_SHARE * (tolerance.error + block.tolerated) / tree.area * cell.area;
    // Glossy receivers weight it one by one.
    if max_contribution <= negligible && (max_contribution == 0.0 || tree.has_view_directions == 0u) {
        return Decision(DROP, 0.0, 0.0, vec3f(0.0), 0.0);
    }
    if block.kind != SMOOTH {
        return Decision(SPLIT_BLOCK, 0.0, 0.0, vec3f(0.0), 0.0);
    }
    // The points' distance over the width of what is interpolated.
    let step = POINT_SPACING * pair.crossing.per_direction * block_size / max(sqrt(cone.minor2), uniforms.texel_rad);
    let per_cosine = max(pair.crossing.per_cosine, pair.phase_slope);
    let crossed_block = per_cosine * block_size;
    let crossed_cell = per_cosine * cell_size;
    let block_weight_error =
        select(WEIGHT_ERROR_SCALE * crossed_block * crossed_block * crossed_block, 1.0, pair.straddles_horizon);
    let block_error = contribution_range * min(INTERPOLATION_ERROR_SCALE * step * step * step * step, 1.0)
        + max_contribution * block_weight_error;
    var cell_error = 0.0;
    if !is_leaf(cell) {
        let cell_weight_error = select(WEIGHT_ERROR_SCALE * crossed_cell * crossed_cell, 1.0, pair.straddles_horizon);
        let turned_cell = turned_cell_of(cell, pair);
        cell_error = contribution_range * min(CONTRAST_ERROR_SCALE * turned_cell, 1.0) + max_contribution * cell_weight_error;
    }
    if block_error + cell_error < error_budget_of(block, cell) {
        return Decision(ADD, contribution_range, max_contribution, cone.direction, cone.radius);
    }
    // Next to total reflection both errors are unknown, and the larger of the two is refined.
    let prefers_cell = select(cell_error >= block_error, cell_size >= block_size, pair.crossing.is_unbounded);
    return Decision(select(SPLIT_BLOCK, SPLIT_CELL, !is_leaf(cell) && prefers_cell), 0.0, 0.0, vec3f(0.0), 0.0);
}

// Cuts of the tree: one workgroup judges pairs of its block and cells, from the parent block's list on. Pairs are dropped, added
// at the block's sixteen points, or refined: on the side of the cell here, on the side of the block by the next level, which
// finds them in this block's list. CPU twins: src/pinhole/cpu/hierarchical/{tile,bounds}.rs.
//
// Lists are bounded. Where one might overflow, cells are handed on as they are: the next level refines them, and at last every
// point for itself (finish.wgsl).

#import pair
#import cube
#import footprint
#import filters
#import visibility
#import hierarchy
#import work

const LANES: u32 = 64u;
// Children of a node at most.
const FANOUT: u32 = 4u;
const STACK: u32 = 1536u;

// Constants of the estimates: src/pinhole/cpu/hierarchical/bounds.rs.
const NEAR: f32 = 1.5;
const OF_INTERPOLATION: f32 = 0.02;

// What to do with a pair.
const DROP: u32 = 0u;
const SPLIT_CELL: u32 = 1u;
const SPLIT_BLOCK: u32 = 2u;
const ADD: u32 = 3u;

struct Verdict {
    what: u32,
    // What the pair adds differs by so much within it, W/m².
    varies: f32,
}

// Nodes to be judged.
var<workgroup> stack: array<u32, STACK>;
// Nodes to be added, and how much what they add varies.
var<workgroup> queue: array<u32, LANES>;
var<workgroup> queued_varies: array<f32, LANES>;
// How many children, deferred nodes and queued ones: ten bits each.
var<workgroup> counts: array<u32, LANES>;
var<workgroup> sums_of_counts: array<u32, 8>;
var<workgroup> sums: array<vec4f, LANES>;
var<workgroup> positions: array<vec4f, POINTS>;
var<workgroup> normals: array<vec3f, POINTS>;
var<workgroup> input_count: u32;
var<workgroup> kind_of_block: u32;

@compute @workgroup_size(64)
fn cut(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let at = place_of_block(workgroup.x);
    let block = blocks[at.index];
    var inputs = 0u;
    if at.level > 0u {
        inputs = list_of(at.tile * BLOCKS + block_in_tile(at.level - 1u, at.block / 2u));
    }
    if lane == 0u {
        kind_of_block = block.kind;
        input_count = tree.tops;
        if at.level > 0u {
            input_count = lists[inputs];
        }
    }
    if at.level > 0u {
        inputs += 1u;
    }
    if lane < POINTS {
        let along = points_along(at.edge);
        let receiver = receiver_at(at.origin + vec2u(along[lane % 4u], along[lane / 4u]));
        positions[lane] = vec4f(receiver.position, f32(receiver.object));
        normals[lane] = receiver.normal;
    }
    let output = list_of(at.index);
    var left = workgroupUniformLoad(&input_count);
    if workgroupUniformLoad(&kind_of_block) == EMPTY || left == CUT_SHORT {
        left = 0u;
    }
    var pending = 0u;
    var deferred = 0u;
    var judged = 0u;
    var added = 0u;
    var own_sum = vec4f(0.0);
    var is_done = false;
    loop {
        let pulled = min(LANES - min(pending, LANES), left);
        if lane < pulled {
            stack[pending + lane] = lists[inputs + lane];
        }
        inputs += pulled;
        left -= pulled;
        pending += pulled;
        workgroupBarrier();
        if pending == 0u {
            is_done = true;
            break;
        }
        // Judged, a lane's node makes three more at most.
        let more = (FANOUT - 1u) * LANES;
        if pending + more > STACK || pending + deferred + left + more > tree.capacity {
            for (var k = lane; k < pending; k += LANES) {
                lists[output + 1u + deferred + k] = stack[k];
            }
            deferred += pending;
            for (var k = lane; k < left; k += LANES) {
                lists[output + 1u + deferred + k] = lists[inputs + k];
            }
            deferred += left;
            is_done = true;
            break;
        }
        let taken = min(pending, LANES);
        pending -= taken;
        var index = 0u;
        var children = 0u;
        var verdict = Verdict(DROP, 0.0);
        if lane < taken {
            index = stack[pending + lane];
            let cell = load_cell(index);
            children = cell.children;
            verdict = judge(block, at.level, cell);
            if VISIBILITY && verdict.what == ADD {
                // What is hidden between the sixteen points no bicubic knows.
                verdict.what = select(SPLIT_BLOCK, SPLIT_CELL, is_above_roots(index, cell));
            }
        }
        judged += taken;
        let split = verdict.what == SPLIT_CELL;
        let count = select(0u, children & 7u, split) + select(0u, 1u << 10u, verdict.what == SPLIT_BLOCK)
            + select(0u, 1u << 20u, verdict.what == ADD);
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
        var before = 0u;
        for (var k = lane & 56u; k < lane; k++) {
            before += counts[k];
        }
        var total = 0u;
        for (var k = 0u; k < 8u; k++) {
            before += select(0u, sums_of_counts[k], k < lane / 8u);
            total += sums_of_counts[k];
        }
        if split {
            let start = pending + (before & 1023u);
            for (var k = 0u; k < (children & 7u); k++) {
                stack[start + k] = (children >> 3u) + k;
            }
        }
        if verdict.what == SPLIT_BLOCK {
            lists[output + 1u + deferred + ((before >> 10u) & 1023u)] = index;
        }
        if verdict.what == ADD {
            queue[before >> 20u] = index;
            queued_varies[before >> 20u] = verdict.varies;
        }
        pending += total & 1023u;
        deferred += (total >> 10u) & 1023u;
        let queued = total >> 20u;
        added += queued;
        workgroupBarrier();
        for (var k = lane / POINTS; k < queued; k += LANES / POINTS) {
            own_sum += brought_by(queue[k], queued_varies[k], lane % POINTS);
        }
    }
    sums[lane] = own_sum;
    if lane == 0u {
        lists[output] = select(CUT_SHORT, deferred, is_done && input_count != CUT_SHORT);
    }
    workgroupBarrier();
    if lane >= POINTS {
        return;
    }
    var sum = vec3f(0.0);
    var fetches = f32(judged);
    for (var k = lane; k < LANES; k += POINTS) {
        sum += sums[k].rgb;
    }
    for (var k = 0u; k < LANES; k++) {
        fetches += sums[k].a;
    }
    fetches /= f32(at.edge * at.edge);
    // Negative: fetches only.
    let texel = vec2u((at.index % BLOCKS) * POINTS + lane, at.tile);
    textureStore(smooth_part, texel, vec4f(sum, select(-fetches, fetches, added > 0u)));
}

// What a queued cell brings to one of the sixteen points.
fn brought_by(index: u32, varies: f32, point: u32) -> vec4f {
    let cell = load_cell(index);
    let receiver = Receiver(positions[point].xyz, normals[point], i32(positions[point].w));
    let pair = pair_of(cell, receiver);
    // Also false where the cell lies on the receiver point and the quotient is not a number.
    if !(pair.cosines > 0.0) {
        return vec4f(0.0);
    }
    let radiance = cell_radiance(cell, pair.r, footprint_of(cell, pair), varies, SHARE * allowed.x);
    return vec4f(weight_of(cell, pair, receiver) * factor_of(cell, pair) * radiance.rgb, radiance.a);
}

// Judges a pair of a block and a cell.
fn judge(block: Block, level: u32, cell: Cell) -> Verdict {
    let share = SHARE * allowed.x;
    let negligible = NEGLIGIBLE * allowed.x / tree.area;
    let d = cell.centroid - block.centre;
    let l2 = dot(d, d);
    let l = sqrt(l2);
    let sizes = block.radius + cell.radius;
    let dn = dot(d, cell.normal);
    var facing = select(-dn, abs(dn), cell.two_sided);
    var receiving = dot(d, block.normal);
    let f_slack = sizes + cell.normal_radius * l;
    let r_slack = sizes + block.normal_radius * l;
    // Some points of it may look at each other, others not.
    let straddles = facing < f_slack || receiving < r_slack;
    facing += f_slack;
    receiving += r_slack;
    if facing <= 0.0 || receiving <= 0.0 {
        return Verdict(DROP, 0.0);
    }
    if l < NEAR * sizes {
        return Verdict(select(SPLIT_BLOCK, SPLIT_CELL, !is_leaf(cell) && cell.radius >= block.radius), 0.0);
    }
    let nearest = l - sizes;
    let weight = cell.area * min(facing, l + sizes) * min(receiving, l + sizes) / (nearest * nearest)
        * most_attenuation(nearest * nearest, cell.area) * cell.most;
    let r = (d - 2.0 * dn * cell.normal) / l;
    let v1 = reflected_side(cell.side_1, cell.change_1, d, cell.normal, dn, 1.0 / l, r);
    let v2 = reflected_side(cell.side_2, cell.change_2, d, cell.normal, dn, 1.0 / l, r);
    let lobe2 = cell.lobe * cell.lobe;
    let g11 = dot(v1, v1) + lobe2;
    let g12 = dot(v1, v2);
    let g22 = dot(v2, v2) + lobe2;
    let spread = sqrt((g11 - g22) * (g11 - g22) + 4.0 * g12 * g12);
    let minor2 = max(0.5 * (g11 + g22 - spread), (g11 + g22) / 512.0);
    let of_block = block.radius / l;
    let of_cell = cell.radius / l + cell.normal_radius;
    let footprint = select(
        FOOTPRINT * sqrt(g11 + g22) + BENT * of_cell * (of_block + of_cell) + unevenness(cell),
        cell.radius / l + 2.0 * cell.normal_radius,
        cell.creased,
    );
    let light = light_within(r, of_block + footprint);
    let top = weight * light.x;
    let varies = weight * light.y;
    // What glossy receivers make of it they know one by one.
    if top <= negligible * cell.area && (top == 0.0 || tree.has_viewers == 0u) {
        return Verdict(DROP, 0.0);
    }
    if block.kind != SMOOTH {
        return Verdict(SPLIT_BLOCK, 0.0);
    }
    // The points' distance over the width of what is interpolated.
    let step = 0.47 * of_block / max(sqrt(minor2), uniforms.texel_rad);
    let of_weight = select(OF_WEIGHT * of_block * of_block * of_block, 1.0, straddles);
    let block_error = varies * min(OF_INTERPOLATION * step * step * step * step, 1.0) + top * of_weight;
    var cell_error = 0.0;
    if !is_leaf(cell) {
        let of_change = select(OF_WEIGHT * of_cell * of_cell, 1.0, straddles);
        cell_error = varies * min(OF_CONTRAST * of_cell, 1.0) + top * of_change;
    }
    if block_error + cell_error < share {
        return Verdict(ADD, varies);
    }
    return Verdict(select(SPLIT_BLOCK, SPLIT_CELL, !is_leaf(cell) && cell_error >= block_error), 0.0);
}

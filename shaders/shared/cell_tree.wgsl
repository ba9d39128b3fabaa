// What the passes of the hierarchical gather read, and how a cell acts on a receiver. CPU twins: src/sums/cell_tree/node.rs and
// src/sums/pinhole/cpu/hierarchical/. Rust layouts: src/render/pinhole/gpu/hierarchical/layout.rs.
//
// From the top: cluster nodes, sample nodes (one a sample), cells of a sample, leaves.

#import gather_inputs
#import receivers
#import cube
#import footprint
#import filters
#import lobe
#import medium
#import visibility
#import interface

// A cell; see src/sums/cell_tree/node.rs.
struct CellNode {
    centroid_area: vec4f,
    normal_e11: vec4f,
    sides_curvature: vec4f,
    curvature_bounds_links: vec4u,
}

// What the cells of a sample have in common.
struct SampleNode {
    // World position of the sample's own cell.
    position: vec3f,
    // Width of the mirror's lobe, radians.
    lobe: f32,
    normal: vec3f,
    // OBJECT_SCALE times the object's index, plus LIGHTS_FRONT and so on.
    object_flags: u32,
    // Of an interface the relative refractive indices of the channels.
    reflectance: vec3f,
    // Its curve of reflectance, or NO_CURVE.
    curve: u32,
    texel_jitter: vec2f,
    // No channel reflects more.
    max_reflectance: f32,
    // Its first visibility map.
    map: u32,
    // The index of its node.
    node: u32,
    // 1 where the side that its normal points to is the one that the mesh's normals point to, else -1.
    face: f32,
}

struct TreeUniforms {
    // Of the picture.
    size: vec2u,
    tiles_across: u32,
    // Entries of a list of cells.
    list_capacity: u32,
    // Nodes without a parent.
    root_count: u32,
    // Nodes from here on are cluster nodes, or sample nodes among them.
    first_cluster: u32,
    sample_count: u32,
    may_interpolate: u32,
    split_near: u32,
    has_view_directions: u32,
    // Of all cells, m².
    area: f32,
    // 1: rays are traced where visibility maps are in doubt.
    traces_rays: u32,
    // 1: the fourth component of a receiver's normal is an error that may be made there beyond the others, W/m².
    has_tolerances: u32,
}

// The error that is allowed.
struct Tolerance {
    // At a point, W/m².
    error: f32,
    // As a part of the estimated irradiance; see irradiance_estimate.wgsl.
    relative_error: f32,
}

@group(0) @binding(10) var<uniform> tree: TreeUniforms;
// Bounds of the radiance itself: x = its maximum, y = its contrast.
@group(0) @binding(11) var bounds: texture_2d_array<f32>;
// The same of the environment's mips from FIRST_BOUNDED_MIP on: six layers each.
@group(0) @binding(14) var mip_bounds: texture_2d_array<f32>;
@group(0) @binding(12) var<storage, read> nodes: array<CellNode>;
@group(0) @binding(13) var<storage, read> sample_nodes: array<SampleNode>;

// The error that may be made at a receiver beyond that of all others, W/m².
fn tolerated_error(receiver: Receiver) -> f32 {
    return select(0.0, receiver.normal_w, tree.has_tolerances != 0u);
}

// Marks a cell in a list as seen by the whole block, so that the cells below it need no test.
const FULLY_VISIBLE: u32 = 0x80000000u;

// The length of a list that an adapter did not let be finished.
const INCOMPLETE: u32 = 0xffffffffu;

// An item of a list, without FULLY_VISIBLE: a node's index and, in the bits from CHANNEL_SHIFT on, the channel that it is visited for, from
// 1 on; 0 for all of them.
const NODE_MASK: u32 = (1u << CHANNEL_SHIFT) - 1u;
const CHANNEL_BITS: u32 = 3u << CHANNEL_SHIFT;

fn receiver_at(place: vec2u) -> Receiver {
    if any(place >= tree.size) {
        return Receiver(vec3f(0.0), -1, vec3f(0.0), vec3f(0.0), 0.0, 0.0);
    }
    return with_length(load_receiver(place));
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
    // Its look-ups, and those of the cells below it, are blurred over this width at least, radians.
    blur: f32,
    change_1: vec3f,
    creased: bool,
    change_2: vec3f,
    // Its sample; of a cluster node, the most central one.
    sample: u32,
    // Eight times the first child's index, plus the number of children.
    children: u32,
    // LIGHTS_FRONT and so on.
    flags: u32,
    // The relative refractive index of an interface.
    eta: f32,
    // 0, or the channel that it concerns, from 1 on.
    channel: u32,
    object: i32,
    max_reflectance: f32,
    // Its longer side, or that of the leaf that it is a piece of, metres: it is as far off its triangles as that is curved.
    extent: f32,
}

// `item` as above.
fn load_cell(item: u32) -> Cell {
    let node = nodes[item & NODE_MASK];
    let n = node.normal_e11.xyz;
    let frame = tangent_frame(n);
    let e11 = node.normal_e11.w;
    let e21 = node.sides_curvature.x;
    let e22 = node.sides_curvature.y;
    let k12 = node.sides_curvature.w;
    let n_u = node.sides_curvature.z * frame.u + k12 * frame.v;
    let n_v = k12 * frame.u + bitcast<f32>(node.curvature_bounds_links.x) * frame.v;
    let radii = unpack2x16float(node.curvature_bounds_links.y);
    var cell: Cell;
    cell.centroid = node.centroid_area.xyz;
    cell.area = node.centroid_area.w;
    cell.normal = n;
    cell.radius = radii.x;
    cell.normal_radius = radii.y;
    cell.side_1 = e11 * frame.u + e21 * frame.v;
    cell.side_2 = e22 * frame.v;
    cell.extent = max(length(cell.side_1), length(cell.side_2));
    cell.change_1 = e11 * n_u + e21 * n_v;
    cell.change_2 = e22 * n_v;
    cell.children = node.curvature_bounds_links.z;
    cell.sample = node.curvature_bounds_links.w >> 1u;
    cell.creased = (node.curvature_bounds_links.w & 1u) == 1u;
    let object_flags = sample_nodes[cell.sample].object_flags;
    cell.flags = object_flags % OBJECT_SCALE;
    cell.object = i32(object_flags / OBJECT_SCALE);
    if is_interface(cell.flags) {
        let eta = sample_nodes[cell.sample].reflectance;
        cell.channel = item >> CHANNEL_SHIFT;
        cell.eta = select(eta[max(cell.channel, 1u) - 1u], (eta.r + eta.g + eta.b) / 3.0, cell.channel == 0u);
    }
    cell.max_reflectance = sample_nodes[cell.sample].max_reflectance;
    cell.blur = LOBE_BLUR * sample_nodes[cell.sample].lobe;
    let bend = BEND_BLUR * (dot(cell.change_1, cell.change_1) + dot(cell.change_2, cell.change_2));
    cell.lobe = length(vec2f(select(bend, 0.0, bend < MIN_BEND_BLUR), sample_nodes[cell.sample].lobe));
    return cell;
}

// How much farther reflections go than a cell's footprint where its normals do not turn evenly from end to end, radians.
fn unevenness(cell: Cell) -> f32 {
    let even = FOOTPRINT_RADIUS * sqrt(dot(cell.change_1, cell.change_1) + dot(cell.change_2, cell.change_2));
    return 2.0 * max(cell.normal_radius - even, 0.0);
}

fn is_leaf(cell: Cell) -> bool {
    return (cell.children & 7u) == 0u;
}

// Whether a cell's footprints are mostly a rough mirror's lobe.
fn is_lobe_of_mirror(cell: Cell) -> bool {
    return !is_interface(cell.flags) && is_mostly_lobe(cell.lobe, cell.change_1, cell.change_2);
}

// Whether a node holds several samples.
fn is_cluster(item: u32, cell: Cell) -> bool {
    let index = item & NODE_MASK;
    return index >= tree.first_cluster && sample_nodes[cell.sample].node != index;
}

// A receiver and a cell. l is the distance between them.
struct Pair {
    // From the receiver to the cell.
    d: vec3f,
    l2: f32,
    // The unit direction in which the light comes that is reflected or refracted to the receiver.
    r: vec3f,
    inverse_l: f32,
    // d·n
    dn: f32,
    // Cosine at the sample, times l.
    cos_at_sample_l: f32,
    // Product of the cosines at the sample and at the receiver, and at an interface its factor on the radiance.
    cosine_product: f32,
    // At an interface.
    crossing: Crossing,
    // How far the direction of the light turns along a part of a ray.
    third: vec3f,
}

fn pair_of(cell: Cell, receiver: Receiver) -> Pair {
    let d = cell.centroid - receiver.position;
    let l2 = dot(d, d);
    let dn = dot(d, cell.normal);
    let cos_at_sample_l = max(facing(cell.flags, dn), 0.0);
    let inverse_l = inverseSqrt(l2);
    let at_receiver = cos_at_receiver_l(d, l2 * inverse_l, receiver);
    let cosine_product = cos_at_sample_l * max(at_receiver, 0.0) * inverse_l * inverse_l;
    if is_interface(cell.flags) {
        let crossing = crossing_of(cell.eta, (cell.flags & IS_FRESNEL) != 0u, dn * inverse_l);
        let r = crossed_direction(crossing, d * inverse_l, cell.normal);
        let third = turn_along_part(receiver, d, cell.normal, inverse_l, r, crossing, true);
        return Pair(d, l2, r, inverse_l, dn, cos_at_sample_l, cosine_product * crossing.factor, crossing, third);
    }
    let r = (d - 2.0 * dn * cell.normal) * inverse_l;
    let third = turn_along_part(receiver, d, cell.normal, inverse_l, r, Crossing(), false);
    return Pair(d, l2, r, inverse_l, dn, cos_at_sample_l, cosine_product, Crossing(), third);
}

// The geometry term, times the cell's area.
fn weight_of(cell: Cell, pair: Pair, receiver: Receiver) -> f32 {
    return pair.cosine_product * cell.area * attenuation(pair.l2, cell.area, cell.object == receiver.object);
}

// The cell's footprint around the direction of its light.
fn footprint_of(cell: Cell, pair: Pair) -> FootprintSides {
    return widened_footprint_of(cell, pair, pair.r, sharp_footprint_of(cell, pair), pair.third);
}

// A footprint around r with the blur of the cell's lobe, and with a third side.
fn widened_footprint_of(cell: Cell, pair: Pair, r: vec3f, sides: FootprintSides, third: vec3f) -> FootprintSides {
    if cell.lobe > 0.0 || has_side(third) {
        if is_interface(cell.flags) {
            return widened(sides, r, cell.normal, crossed_blur(pair.crossing, cell.lobe), third);
        }
        return widened(sides, r, cell.normal, mirrored_blur(cell.lobe, abs(pair.dn) * pair.inverse_l), third);
    }
    return sides;
}

// The same without the lobe's blur, and at one place of a part of a ray.
fn sharp_footprint_of(cell: Cell, pair: Pair) -> FootprintSides {
    if is_interface(cell.flags) {
        let towards = pair.d * pair.inverse_l;
        return FootprintSides(
            crossed_side(pair.crossing, cell.side_1, cell.change_1, towards, cell.normal, pair.inverse_l),
            crossed_side(pair.crossing, cell.side_2, cell.change_2, towards, cell.normal, pair.inverse_l),
        );
    }
    let v1 = reflected_side(cell.side_1, cell.change_1, pair.d, cell.normal, pair.dn, pair.inverse_l, pair.r);
    let v2 = reflected_side(cell.side_2, cell.change_2, pair.d, cell.normal, pair.dn, pair.inverse_l, pair.r);
    return FootprintSides(v1, v2);
}

// The error that a pair may have with a cell of this area, W/m², where so much is allowed for a point: errors of a lamp's light have one
// sign where many cells focus it.
fn error_budget(allowed: f32, area: f32) -> f32 {
    let most = PAIR_ERROR_SHARE * allowed;
    return select(most, min(most, COHERENT_ERROR_SHARE * allowed / tree.area * area), LIGHT == LIGHT_LAMP);
}

// Taps for a pair whose contribution ranges over this much: the fewer, the coarser they are.
fn taps_for(contribution_range: f32, error_budget: f32) -> f32 {
    return min(max(ceil(contribution_range * (TAPS_PER_ERROR_BUDGET / error_budget)), 1.0), f32(uniforms.taps));
}

// What the radiance is multiplied by beside a cell's weight.
fn reflected_scale(cell: Cell, pair: Pair, receiver: Receiver) -> vec3f {
    let sample = cell.sample;
    let passed = passed_medium(pair.d, pair.l2 * pair.inverse_l, pair.dn, is_interface(cell.flags), receiver);
    if is_interface(cell.flags) {
        let channels = vec3f(select(vec3u(0u), vec3u(1u), vec3u(cell.channel) == vec3u(1u, 2u, 3u)));
        return uniforms.radiance_scale * select(channels, vec3f(1.0), cell.channel == 0u) * passed;
    }
    let cosine = pair.cos_at_sample_l * pair.inverse_l;
    return uniforms.radiance_scale * reflectance(sample_nodes[sample].reflectance, sample_nodes[sample].curve, cosine) * passed;
}

// What a sample sees on one side (1 or -1).
fn map_of_sample(sample: u32, side: f32) -> VisibilityMap {
    if !VISIBILITY {
        return VisibilityMap();
    }
    let node = sample_nodes[sample];
    return visibility_map(node.map, node.texel_jitter, node.normal, side);
}

// The number, among the mips whose bounds are kept, of the one for light that is blurred over a width in radians.
fn mip_of_blur(blur: f32) -> i32 {
    let texels = 0.5 * f32(textureDimensions(bounds).x) * blur;
    if texels < 1.0 {
        return 0;
    }
    let exponent = i32(bitcast<u32>(texels) >> 23u) - 127;
    let last = i32(textureNumLevels(bounds)) - 1;
    return max(min(exponent, last) + 1 - i32(FIRST_BOUNDED_MIP), 0);
}

// Bounds of the radiance within a cone around a world direction, blurred over a width, in the cube that begins with a layer of the
// bounds: x = its maximum, y = its contrast.
fn bounds_within(direction: vec3f, radius: f32, blur: f32, first_layer: i32) -> vec2f {
    let on = on_cube(light_from_world(direction));
    let size = f32(textureDimensions(bounds).x);
    let mip = mip_of_blur(blur);
    // On a face's plane angles are stretched by 1 + s² + t² at most; a bilinear look-up reads a texel of its mip further.
    let reach = 0.5 * size * radius * (1.0 + dot(on.st, on.st)) + f32(1u << u32(select(0, mip + i32(FIRST_BOUNDED_MIP) - 1, mip > 0)));
    // ⌈log₂ reach⌉ of what is 1 at least; NaN is wider than everything.
    let level = max(i32(bitcast<u32>(0.999999 * reach) >> 23u) - 126, 0);
    let last = i32(textureNumLevels(bounds)) - 1;
    if level > last {
        // Each of the last level's texels knows all faces but the opposite one.
        let maximum = max(textureLoad(bounds, vec2i(0), first_layer, last).x, textureLoad(bounds, vec2i(0), first_layer + 1, last).x);
        return vec2f(maximum);
    }
    let edge = max(i32(size) >> u32(level), 1);
    let texel = min(vec2i((0.5 * on.st + 0.5) * f32(edge)), vec2i(edge - 1));
    // Of surroundings there are bounds of the radiance itself only, which hold for what is blurred within their reach.
    if mip > 0 && LIGHT == LIGHT_ENVIRONMENT {
        return textureLoad(mip_bounds, texel, i32(on.face) + 6 * (mip - 1), level - i32(FIRST_BOUNDED_MIP)).xy;
    }
    return textureLoad(bounds, texel, first_layer + i32(on.face), level).xy;
}

// Pairs of a block of receivers and a cell: bounds of weights, and cones of light.
// CPU twin: `BlockPair` in src/sums/pinhole/cpu/hierarchical/criterion.rs.

#import cell_tree
#import near_light_cells
#import tile_batch

// A block and a cell.
struct BlockPair {
    // From the middle of the block to the cell's centroid, and how far.
    d: vec3f,
    l: f32,
    // Radii of both together.
    sizes: f32,
    // d·n
    dn: f32,
    // The largest cosines at any point of the cell and of the block, times l.
    max_cos_at_sample_l: f32,
    max_cos_at_receiver_l: f32,
    // Only some points of the cell and the block face each other, or light is totally reflected between some of them.
    straddles_horizon: bool,
    // What an interface does at most with the light.
    crossing: CrossingBounds,
    // Upper bound of what a medium does with it, and how much faster than directions that changes.
    passed: f32,
    phase_slope: f32,
}

fn block_pair(block: Block, cell: Cell) -> BlockPair {
    let d = cell.centroid - block.centre;
    let l = sqrt(dot(d, d));
    let sizes = block.radius + cell.radius;
    let dn = dot(d, cell.normal);
    let at_sample = facing(cell.flags, dn);
    let along_rays = is_part_of_ray(block.object);
    let at_receiver = select(dot(d, block.normal), l, along_rays);
    let sample_slack = sizes + cell.normal_radius * l;
    let receiver_slack = select(sizes + block.normal_radius * l, 0.0, along_rays);
    // In front of an interface there is no medium.
    var passed = select(max_transmittance(l - sizes), 1.0, is_interface(cell.flags) && dn <= sample_slack);
    var slope = 1.0;
    if along_rays {
        let spread = sizes / l * (0.5 * WHOLE_SPHERE_RAD) + block.normal_radius;
        passed *= max_relative_phase(-dot(d, block.normal) / l, spread);
        slope = phase_slope();
    }
    var crossing = CrossingBounds(1.0, 2.0, 1.0, 1.0, false, false, 1.0, 1.0);
    if is_interface(cell.flags) {
        let cosine = dn / l;
        let slack = sizes / l + cell.normal_radius;
        let is_fresnel = (cell.flags & IS_FRESNEL) != 0u;
        crossing = crossing_bounds(cell.eta, is_fresnel, max(cosine - slack, -1.0), min(cosine + slack, 1.0));
    }
    let straddles = at_sample < sample_slack || at_receiver < receiver_slack || crossing.is_unbounded;
    return BlockPair(
        d, l, sizes, dn, at_sample + sample_slack, at_receiver + receiver_slack, straddles, crossing, passed, slope,
    );
}

// The greatest weight of any point of the cell at any point of the block.
fn max_weight_of(cell: Cell, pair: BlockPair) -> f32 {
    let nearest = pair.l - pair.sizes;
    let farthest = pair.l + pair.sizes;
    return cell.area * min(pair.max_cos_at_sample_l, farthest) * min(pair.max_cos_at_receiver_l, farthest)
        / (nearest * nearest) * max_attenuation(nearest * nearest, cell.area) * cell.max_reflectance * pair.crossing.factor * pair.passed;
}

// The directions in which a cell's light comes that is reflected or refracted to a block.
struct Cone {
    direction: vec3f,
    radius: f32,
    // The squared minor axis of a footprint.
    minor2: f32,
    // It holds directions relative to that of a lamp from the same point of the cell; else those from anywhere on it.
    is_towards_lamp: bool,
}

fn light_cone(cell: Cell, pair: BlockPair, block_size: f32, cell_size: f32) -> Cone {
    if is_interface(cell.flags) {
        return refracted_cone(cell, pair, block_size);
    }
    return reflected_cone(cell, pair, block_size, cell_size);
}

fn reflected_cone(cell: Cell, pair: BlockPair, block_size: f32, cell_size: f32) -> Cone {
    let r = (pair.d - 2.0 * pair.dn * cell.normal) / pair.l;
    let v1 = reflected_side(cell.side_1, cell.change_1, pair.d, cell.normal, pair.dn, 1.0 / pair.l, r);
    let v2 = reflected_side(cell.side_2, cell.change_2, pair.d, cell.normal, pair.dn, 1.0 / pair.l, r);
    let is_towards_lamp = LIGHT == LIGHT_LAMP && !cell.creased;
    var sides = FootprintSides(v1, v2);
    var size = cell_size;
    if is_towards_lamp {
        sides = cell_towards_lamp(cell, r, sides);
        size += size_for_light(0.0, cell, cell.radius);
    }
    let cone = footprint_cone(r, sides.v1, sides.v2, cell.lobe);
    let footprint = select(
        cone.radius + FOOTPRINT_BEND * size * (block_size + size) + unevenness(cell),
        cell.radius / pair.l + 2.0 * cell.normal_radius,
        cell.creased,
    );
    return Cone(r, block_size + footprint, cone.minor2, is_towards_lamp);
}

fn refracted_cone(cell: Cell, pair: BlockPair, block_size: f32) -> Cone {
    let towards = pair.d / pair.l;
    let crossing = crossing_of(cell.eta, (cell.flags & IS_FRESNEL) != 0u, pair.dn / pair.l);
    let r = crossed_direction(crossing, towards, cell.normal);
    let v1 = crossed_side(crossing, cell.side_1, cell.change_1, towards, cell.normal, 1.0 / pair.l);
    let v2 = crossed_side(crossing, cell.side_2, cell.change_2, towards, cell.normal, 1.0 / pair.l);
    let cone = footprint_cone(r, v1, v2, crossed_blur(crossing, cell.lobe).x);
    let most = crossed_cone(pair.crossing, r, towards, cell.normal, block_size + cell.radius / pair.l, cell.normal_radius);
    let turned_block = pair.crossing.per_direction * block_size;
    let turned_cell = turned_cell_of(cell, pair);
    let curved = turned_block + cone.radius + FOOTPRINT_BEND * turned_cell * (turned_block + turned_cell)
        + 0.5 * pair.crossing.per_normal * unevenness(cell);
    if !cell.creased && !pair.crossing.is_unbounded && curved < most.radius {
        return Cone(r, curved, cone.minor2, false);
    }
    return Cone(most.axis, most.radius, cone.minor2, false);
}

// How far the light's direction turns over a cell, or half as far as normals turn that of a mirror.
fn turned_cell_of(cell: Cell, pair: BlockPair) -> f32 {
    return pair.crossing.per_direction * cell.radius / pair.l + 0.5 * pair.crossing.per_normal * cell.normal_radius;
}

// The cone that holds a footprint, blurred by a lobe, to first order.
fn footprint_cone(direction: vec3f, v1: vec3f, v2: vec3f, lobe: f32) -> Cone {
    let g11 = dot(v1, v1) + lobe * lobe;
    let g12 = dot(v1, v2);
    let g22 = dot(v2, v2) + lobe * lobe;
    let spread = sqrt((g11 - g22) * (g11 - g22) + 4.0 * g12 * g12);
    let minor2 = max(0.5 * (g11 + g22 - spread), (g11 + g22) * MIN_MINOR_SHARE);
    return Cone(direction, FOOTPRINT_RADIUS * sqrt(g11 + g22), minor2, false);
}

// Bounds of what a cell contributes to a receiver. CPU counterpart: `contribution_bounds` in
// src/sums/pinhole/cpu/hierarchical/packet.rs.

#import cell_tree
#import gloss_bounds
#import near_light_cells

struct ContributionBounds {
    // Size of the cell relative to its distance, with the spread of its normals.
    size: f32,
    // The same for the direction of the light: how far it turns over the cell, or half as far as normals turn that of a mirror.
    turned: f32,
    // Upper bound, W/m².
    maximum: f32,
    // How much the light makes it differ within the cell, W/m².
    range: f32,
    // Error of what the receiver does with light from different directions, relative to the maximum.
    receiver_error: f32,
    // How much of the light's differences within the cell is left in the mean along a part of a ray.
    left_along_part: f32,
}

fn contribution_bounds(
    cell: Cell, pair: Pair, receiver: Receiver, sides: FootprintSides, weight: MaxWeight,
) -> ContributionBounds {
    var size = pair.inverse_l * cell.radius + cell.normal_radius;
    var turned = size;
    var cone = LightCone(pair.r, cone_radius(cell, pair, receiver, sides, size));
    if is_interface(cell.flags) {
        let crossing = weight.crossing;
        turned = crossing.per_direction * pair.inverse_l * cell.radius + 0.5 * crossing.per_normal * cell.normal_radius;
        cone = crossed_light(cell, pair, receiver, sides, turned, crossing);
        size *= crossing.per_cosine;
    }
    size = size_for_light(size, cell, cell.radius);
    var light: vec2f;
    if LIGHT == LIGHT_LAMP && !cell.creased && !is_interface(cell.flags) {
        light = lamp_over_cell(cell, pair, turned);
    } else {
        light = light_within(cell, cone.axis, cone.radius);
    }
    var left_along_part = 1.0;
    var at_receiver = vec2f(1.0, 0.0);
    if is_part_of_ray(receiver.object) {
        let turn = length(pair.third);
        light = min(light, vec2f(max_along_part(cell, pair, turn, light.x)));
        left_along_part = turned / max(turned + turn, 1.2e-38);
        at_receiver = scattered_within(pair.d, pair.inverse_l, receiver, size);
    }
    if LIGHT == LIGHT_LAMP && is_leaf(cell) && size < MAX_PIECE_SIZE {
        // Where it is near, parts of it fill much less of the directions than all of it does to first order.
        light *= max_part_of_lamp(cell, pair);
    }
    if SHADING {
        at_receiver = gloss_within(pair, receiver, size);
    }
    let max_weight = weight.value * cell.max_reflectance * at_receiver.x;
    return ContributionBounds(
        size, turned, max_weight * light.x, max_weight * light.y, at_receiver.y, left_along_part,
    );
}

// The radius of a cell and, of a part of a ray, half its length, metres.
fn extent_of(cell: Cell, receiver: Receiver) -> f32 {
    return cell.radius + 0.5 * receiver.length;
}

// The greatest weight of any point of a cell.
struct MaxWeight {
    value: f32,
    // Only some points of the cell face the receiver, or light from some is totally reflected.
    straddles_horizon: bool,
    // What an interface does at most with the light.
    crossing: CrossingBounds,
}

fn max_weight_of(cell: Cell, pair: Pair, receiver: Receiver) -> MaxWeight {
    var crossing = CrossingBounds(1.0, 2.0, 1.0, 1.0, false, false, 1.0, 1.0);
    if is_interface(cell.flags) {
        let cosine = pair.dn * pair.inverse_l;
        let slack = pair.inverse_l * extent_of(cell, receiver) + cell.normal_radius;
        let is_fresnel = (cell.flags & IS_FRESNEL) != 0u;
        crossing = crossing_bounds(cell.eta, is_fresnel, max(cosine - slack, -1.0), min(cosine + slack, 1.0));
    }
    // Parts of a near leaf may light what its middle does not.
    let is_near = tree.split_near != 0u && pair.inverse_l * cell.radius > MAX_PIECE_SIZE;
    if is_leaf(cell) && !is_near {
        return MaxWeight(select(0.0, weight_of(cell, pair, receiver), pair.cosine_product > 0.0), false, crossing);
    }
    let l = pair.l2 * pair.inverse_l;
    let slack = l * cell.normal_radius + cell.radius;
    let at_sample = facing(cell.flags, pair.dn);
    let at_receiver = cos_at_receiver_l(pair.d, l, receiver);
    if at_sample + slack <= 0.0 || at_receiver + cell.radius <= 0.0 {
        return MaxWeight(0.0, false, crossing);
    }
    let nearest = max(l - cell.radius, MIN_DISTANCE_RATIO * l);
    let nearest2 = nearest * nearest;
    let cosine_product = min(at_sample + slack, l) * min(at_receiver + cell.radius, l) / nearest2;
    let weight = cosine_product * cell.area * max_attenuation(nearest2, cell.area) * crossing.factor;
    return MaxWeight(weight, at_sample < slack || at_receiver < cell.radius || crossing.is_unbounded, crossing);
}

// Radius of the cone in which the light comes that a cell of this relative size reflects to a receiver.
fn cone_radius(cell: Cell, pair: Pair, receiver: Receiver, sides: FootprintSides, size: f32) -> f32 {
    let squares = dot(sides.v1, sides.v1) + dot(sides.v2, sides.v2);
    let along = FOOTPRINT_RADIUS * pair.inverse_l * receiver.length;
    return select(
        FOOTPRINT_RADIUS * sqrt(squares) + FOOTPRINT_BEND * size * size + unevenness(cell),
        size + along + cell.normal_radius + cell.lobe,
        cell.creased,
    );
}

// The cone in which the light comes that a cell of an interface sends to a receiver.
fn crossed_light(
    cell: Cell, pair: Pair, receiver: Receiver, sides: FootprintSides, turned: f32, crossing: CrossingBounds,
) -> LightCone {
    let towards = pair.d * pair.inverse_l;
    let directions = pair.inverse_l * extent_of(cell, receiver);
    let most = crossed_cone(crossing, pair.r, towards, cell.normal, directions, cell.normal_radius);
    let squares = dot(sides.v1, sides.v1) + dot(sides.v2, sides.v2);
    let curved = FOOTPRINT_RADIUS * sqrt(squares) + FOOTPRINT_BEND * turned * turned
        + 0.5 * crossing.per_normal * unevenness(cell);
    if !cell.creased && !crossing.is_unbounded && curved < most.radius {
        return LightCone(pair.r, curved);
    }
    return most;
}

// Near light that arrives at cells: bounds, and what they mirror or refract. Where the light is the environment,
// no_near_light_cells.wgsl is imported in its place. CPU twins: src/sums/pinhole/cpu/near_light.rs, and
// `light_within` in src/sums/pinhole/cpu/hierarchical/packet.rs.

#import cell_tree
#import near_light

// Near light that arrives at a cell.
struct NearLight {
    // Mean radiance over the cell's footprint, unoccluded; a = fetches.
    radiance: vec4f,
    // From where it comes, as in LightFootprint.
    towards: vec3f,
}

// Bounds of the radiance that arrives at a cell within a cone of directions: x = its maximum, y = its contrast.
fn light_within(cell: Cell, direction: vec3f, radius: f32) -> vec2f {
    if LIGHT == LIGHT_LAMP {
        return vec2f(select(0.0, uniforms.lamp.max_radiance, meets_lamp(cell.area, cell.centroid, cell.radius, direction, radius)));
    }
    let view = nearest_view(cell.centroid, cell.normal);
    return bounds_within(direction, radius + view_spread(view, cell.centroid, cell.radius), cell.blur, 6 * i32(view));
}

// The same of a smooth cell of a mirror for one receiver, under a lamp; `turned` as in ContributionBounds.
fn lamp_over_cell(cell: Cell, pair: Pair, turned: f32) -> vec2f {
    let seen = lamp_seen_from(cell.centroid);
    let sharp = cell_towards_lamp(cell, pair.r, sharp_footprint_of(cell, pair));
    let sides = widened_footprint_of(cell, pair, pair.r, sharp, pair.third);
    let squares = dot(sides.v1, sides.v1) + dot(sides.v2, sides.v2);
    let size = turned + cell.radius / seen.distance;
    let spread = FOOTPRINT_RADIUS * sqrt(squares) + FOOTPRINT_BEND * size * size + unevenness(cell);
    // Lobes have tails.
    let may_be_even = cell.lobe == 0.0 && all(pair.third == vec3f(0.0));
    return lamp_bounds(seen, cell.radius, distance(pair.r, seen.towards), blurred_reach(cell.area) * spread, may_be_even);
}

// A footprint, without a lobe, of directions relative to that of the lamp.
fn cell_towards_lamp(cell: Cell, r: vec3f, reflected: FootprintSides) -> FootprintSides {
    let surface = FootprintSides(cell.side_1, cell.side_2);
    return footprint_towards_lamp(lamp_seen_from(cell.centroid), surface, r, reflected);
}

// Bounds of a lamp's light within a cone of directions relative to that of the lamp.
fn lamp_within_cone(cell: Cell, direction: vec3f, radius: f32, may_be_even: bool) -> vec2f {
    let seen = lamp_seen_from(cell.centroid);
    let apart = distance(direction, seen.towards);
    return lamp_bounds(seen, cell.radius, apart, blurred_reach(cell.area) * radius, may_be_even && cell.lobe == 0.0);
}

// The relative size of a cell for receivers and, if that is larger, for a lamp.
fn size_for_light(size: f32, cell: Cell, extent: f32) -> f32 {
    if LIGHT == LIGHT_LAMP {
        return max(size, extent / max(distance(uniforms.lamp.position, cell.centroid), 1.2e-38));
    }
    return size;
}

// At most the part of a cell's footprint that a lamp fills.
fn max_part_of_lamp(cell: Cell, pair: Pair) -> f32 {
    let seen = lamp_seen_from(cell.centroid);
    let sharp = cell_towards_lamp(cell, pair.r, sharp_footprint_of(cell, pair));
    let sides = widened_footprint_of(cell, pair, pair.r, sharp, pair.third);
    let area = max(length(cross(sides.v1, sides.v2)), 1.2e-38);
    return min(2.0 * HALF_PI * seen.chord * seen.chord / area, 1.0);
}

// Upper bound of the mean radiance along a part of a ray over which the light's direction turns so far, of which none is brighter than
// `maximum`.
fn max_along_part(cell: Cell, pair: Pair, turn: f32, maximum: f32) -> f32 {
    if LIGHT == LIGHT_SURROUNDINGS {
        return maximum;
    }
    let seen = lamp_seen_from(cell.centroid);
    let sharp = cell_towards_lamp(cell, pair.r, sharp_footprint_of(cell, pair));
    // The lamp's disc is blurred.
    let blur = 0.5 * (blurred_reach(cell.area) - 1.0);
    let width = 2.0 * (blur * sqrt(dot(sharp.v1, sharp.v1) + dot(sharp.v2, sharp.v2)) + seen.chord);
    return maximum * min(width / max(turn, 1.2e-38), 1.0);
}

// Whether a piece of a cell, however near, may send light of the lamp to the receiver.
fn may_mirror_lamp(piece: Cell, pair: Pair) -> bool {
    // Refracted light turns without bound next to total reflection.
    if is_interface(piece.flags) {
        return true;
    }
    let radius = 0.5 * (length(piece.side_1) + length(piece.side_2));
    let turn = length(piece.change_1) + length(piece.change_2) + TAIL_REACH * piece.lobe + 0.5 * length(pair.third);
    // An arc is at most π/2 times its sine; where there is no sine, light may come from anywhere.
    let spread = pair.inverse_l * radius * HALF_PI;
    return meets_lamp(piece.area, piece.centroid, radius, pair.r, select(WHOLE_SPHERE_RAD, spread, spread < 1.0) + turn);
}

// Near light over a cell's footprint, from so many taps.
fn near_light_at(cell: Cell, pair: Pair, taps: f32) -> NearLight {
    let surface = FootprintSides(cell.side_1, cell.side_2);
    let sharp = sharp_footprint_of(cell, pair);
    let changes = FootprintSides(cell.change_1, cell.change_2);
    let light = footprint_on_light(cell.centroid, cell.normal, cell.area, surface, changes, pair.r, sharp, cell.lobe, pair.third);
    var map: VisibilityMap;
    map.index = UNOCCLUDED;
    let sides = widened_footprint_of(cell, pair, light.r, light.sides, light.third);
    var look_ups = one_look_up(light.r, sides);
    if is_lobe_of_mirror(cell) {
        let cosine = abs(pair.dn) * pair.inverse_l;
        look_ups = lobe_parts(light.r, cell.normal, cosine, light.sides, cell.lobe, light.third);
    }
    var mean = mean_of_light(cell.centroid, cell.normal, surface, light, look_ups, taps, map);
    if LIGHT == LIGHT_LAMP {
        mean *= vec4f(passed_from_lamp(length(light.towards), is_interface(cell.flags)), 1.0);
    }
    return NearLight(mean, light.towards);
}

// That of the environment, as in cell_radiance.wgsl: none here.
fn cell_radiance(
    cell: Cell, pair: Pair, sides: FootprintSides, contribution_range: f32, error_budget: f32, map: VisibilityMap,
) -> vec4f {
    return vec4f(0.0);
}

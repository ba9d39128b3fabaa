// The interface of near_light_cells.wgsl where the light is the environment: drivers need not compile the rest.

#import cell_radiance
#import cell_tree

struct NearLight {
    radiance: vec4f,
    towards: vec3f,
}

fn light_within(cell: Cell, direction: vec3f, radius: f32) -> vec2f {
    return bounds_within(direction, radius, cell.blur, 0);
}

fn lamp_over_cell(cell: Cell, pair: Pair, turned: f32) -> vec2f {
    return vec2f(0.0);
}

fn cell_towards_lamp(cell: Cell, r: vec3f, reflected: FootprintSides) -> FootprintSides {
    return reflected;
}

fn lamp_within_cone(cell: Cell, direction: vec3f, radius: f32, may_be_even: bool) -> vec2f {
    return vec2f(0.0);
}

fn size_for_light(size: f32, cell: Cell, extent: f32) -> f32 {
    return size;
}

fn max_part_of_lamp(cell: Cell, pair: Pair) -> f32 {
    return 1.0;
}

fn max_along_part(cell: Cell, pair: Pair, turn: f32, maximum: f32) -> f32 {
    return min(maximum, max_along_arc(turn));
}

fn may_mirror_lamp(piece: Cell, pair: Pair) -> bool {
    return true;
}

fn near_light_at(cell: Cell, pair: Pair, taps: f32) -> NearLight {
    return NearLight(vec4f(0.0), vec3f(0.0));
}

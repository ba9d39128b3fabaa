// Bounds of what glossy receivers reflect of a cell's light. CPU counterpart: `gloss_within` in src/sums/pinhole/cpu/hierarchical/packet.rs.

#import brdf
#import cell_tree

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

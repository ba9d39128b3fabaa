// Where visibility maps say too little: a curved surface lies partly in front of a texel's plane, partly behind it.
// Written by trace_maps.wgsl; CPU twin: `Doubt` in src/sums/pinhole/visibility.rs.

#import gather_inputs

// By texel of the maps: the m·l from which its surface may occlude a point, as a float; below 16 bits of the squared distance from
// which it may, m², the object.
@group(3) @binding(3) var doubts: texture_2d<u32>;

// Whether only a ray can tell if a point of an object, at this m·l and squared distance, is occluded by what a texel shows.
fn is_in_doubt(texel: u32, depth: f32, distance2: f32, object: i32) -> bool {
    let doubt = textureLoad(doubts, vec2u(texel % DOUBTS_ROW, texel / DOUBTS_ROW), 0).xy;
    let may_occlude = depth > bitcast<f32>(doubt.x) || distance2 > bitcast<f32>(doubt.y & 0xffff0000u);
    return may_occlude && (doubt.y & 0xffffu) != (u32(object) & 0xffffu);
}

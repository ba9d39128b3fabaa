// What a pixel carries from cell to cell as it traverses the tree: what the sample of the visited cells sees of it.
// CPU counterpart: `VisibleReceivers` in src/sums/pinhole/cpu/hierarchical/occlusion.rs.

#import cell_tree
#import point_visibility
#import rays

const NO_SAMPLE: u32 = 0xffffffffu;

struct Traversal {
    // The sample whose visible fraction of the receiver is known, and that fraction.
    sample: u32,
    visible_fraction: f32,
    // The map is not certain about it.
    is_doubtful: bool,
    // No loop was cut short.
    is_complete: bool,
}

// Finds the fraction of the receiver that a sample sees; it holds for all cells of the sample.
fn find_visible_fraction(sample: u32, receiver: Receiver, traversal: ptr<function, Traversal>) {
    let l = receiver.position - sample_nodes[sample].position;
    let dn = -dot(l, sample_nodes[sample].normal);
    let map = map_of_sample(sample, receiver_side(sample_nodes[sample].object_flags, dn));
    let seen = visibility_of_point(l, map, receiver.object);
    (*traversal).sample = sample;
    (*traversal).visible_fraction = seen.fraction;
    // Along a part of a ray edges of shadows are blurred: there maps know enough of them.
    (*traversal).is_doubtful = seen.is_doubtful && !is_part_of_ray(receiver.object);
}

// Whether it is certain that the sample does not see the receiver.
fn is_unseen(traversal: ptr<function, Traversal>) -> bool {
    return (*traversal).visible_fraction == 0.0 && !(*traversal).is_doubtful;
}

// The piece of a surface that a cell is, looking to a side (1 or -1) of it.
fn ray_origin_of(cell: Cell, side: f32) -> RayOrigin {
    let face = sample_nodes[cell.sample].face * side;
    return RayOrigin(cell.centroid, u32(cell.object), face, cell.extent);
}

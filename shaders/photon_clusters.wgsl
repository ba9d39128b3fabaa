// Decides what becomes of clusters of 2×2 photons: they are one photon, or four clusters of a grid that is twice as fine; or puts photons of
// squares together, from fine to coarse. CPU twins: src/render/image_space/adaptive.rs and hierarchical.rs.

#import constants
#import photons
#import plane

// A list of clusters of a grid.
struct Clusters {
    // Of the map in which photons must lie close to each other.
    plane: Plane,
    count: u32,
    // Clusters along an edge of the grid.
    grid: u32,
    // Photons have been followed, so that clusters may be one photon.
    may_merge: u32,
    // Levels of the pyramid of coverage, from 1×1 texels on.
    levels: u32,
    // No grid is finer: what is not one photon is kept instead of divided.
    is_finest: u32,
    // Photons of the buffer that each of four stands for, where squares are put together: those from its own on.
    stride: u32,
}

@group(0) @binding(0) var<uniform> list: Clusters;
@group(0) @binding(1) var<storage, read_write> photons: array<Photon>;
@group(0) @binding(2) var<storage, read> clusters: array<u32>;
@group(0) @binding(3) var<storage, read_write> divided: array<u32>;
@group(0) @binding(4) var<storage, read_write> merged: array<u32>;
// How many there are in these two lists.
@group(0) @binding(5) var<storage, read_write> counts: array<atomic<u32>, 2>;
// Whether each texel of the light's view may show a caster: a bit each, level after level.
@group(0) @binding(6) var<storage, read> coverage: array<u32>;
@group(0) @binding(7) var<storage, read_write> ledger: array<atomic<u32>>;

@compute @workgroup_size(64)
fn decide(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local_index: u32,
) {
    let index = index_of(group, groups, local_index);
    if index >= list.count {
        return;
    }
    let cluster = clusters[index];
    if list.may_merge != 0u && are_one(4u * index, 1u) {
        merged[atomicAdd(&counts[1], 1u)] = cluster;
    } else if list.is_finest != 0u {
        divided[atomicAdd(&counts[0], 1u)] = cluster;
    } else {
        divide(cluster);
    }
}

// The place in the list of an invocation's cluster.
fn index_of(group: vec3u, groups: vec3u, local_index: u32) -> u32 {
    return (group.y * groups.x + group.x) * 64u + local_index;
}

fn divide(cluster: u32) {
    for (var k = 0u; k < 4u; k++) {
        let quarter = 2u * vec2u(cluster & 0xffffu, cluster >> 16u) + vec2u(k & 1u, k >> 1u);
        if is_covered(quarter) {
            divided[atomicAdd(&counts[0], 1u)] = quarter.x | quarter.y << 16u;
        }
    }
}

// Whether a texel of the grid that is twice as fine may show a caster.
fn is_covered(texel: vec2u) -> bool {
    let own = firstLeadingBit(2u * list.grid);
    let level = min(own, list.levels - 1u);
    let place = texel >> vec2u(own - level);
    // The coarser levels have (4^level − 1) / 3 texels.
    let index = ((1u << (2u * level)) - 1u) / 3u + (place.y << level) + place.x;
    return (coverage[index >> 5u] >> (index & 31u) & 1u) != 0u;
}

// Whether four photons land within a texel, on one side of one receiver.
fn are_one(first: u32, stride: u32) -> bool {
    let own = photons[first];
    var places = array<vec2f, 4>();
    for (var k = 0u; k < 4u; k++) {
        let photon = photons[first + k * stride];
        if photon.object == NO_OBJECT || photon.object != own.object || photon.caster != own.caster
            || dot(unpacked_unit(photon.normal), unpacked_unit(own.normal)) < MIN_CLUSTER_COSINE {
            return false;
        }
        places[k] = projected(list.plane, photon.position);
        for (var j = 0u; j < k; j++) {
            if distance(places[k], places[j]) > MAX_CLUSTER_EXTENT {
                return false;
            }
        }
    }
    return places[0].x > BEHIND_PLANE;
}

// Puts the photons of clusters together: the first of them stands for all. Where the others landed is kept.
@compute @workgroup_size(64)
fn merge(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local_index: u32,
) {
    let index = index_of(group, groups, local_index);
    if index < list.count {
        put_together(4u * index, 1u);
    }
    close_account(local_index);
}

// Puts photons of squares together, four at a time, if what they stand for is whole and they are one. `merged` says of each square, at the place
// of its first cluster, whether it is whole.
@compute @workgroup_size(64)
fn merge_squares(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local_index: u32,
) {
    let index = index_of(group, groups, local_index);
    if index < list.count {
        let first = 4u * list.stride * index;
        let is_whole = are_whole(first, list.stride) && are_one(first, list.stride);
        if is_whole {
            put_together(first, list.stride);
        }
        merged[first / 4u] = u32(is_whole);
    }
    close_account(local_index);
}

fn are_whole(first: u32, stride: u32) -> bool {
    if stride == 1u {
        return true;
    }
    var count = 0u;
    for (var k = 0u; k < 4u; k++) {
        count += merged[(first + k * stride) / 4u];
    }
    return count == 4u;
}

fn put_together(first: u32, stride: u32) {
    for (var k = 1u; k < 4u; k++) {
        let other = first + k * stride;
        photons[first].flux += photons[other].flux;
        photons[first].position += photons[other].position;
        photons[other].object = NO_OBJECT;
    }
    photons[first].position *= 0.25;
    // Three photons less.
    add_to_account(LANDED, Steps(0xfffffffdu, 0xffffffffu));
}

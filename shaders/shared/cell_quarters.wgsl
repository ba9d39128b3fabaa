// Quarters of a leaf's parallelogram, for receivers so near to it that it is not one sample for them.
// CPU counterpart: src/sums/pinhole/cell.rs.

#import cell_tree

// A quarter of a quarter, and so on, up to MAX_LAMP_QUARTERINGS times.
fn piece_of(leaf: Cell, path: u32, depth: u32) -> Cell {
    var piece = leaf;
    for (var level = depth; level > 7u; level--) {
        piece = quarter_of(piece, (path >> (2u * (level - 1u))) & 3u);
    }
    // No loop for what is frequent: adapters may limit their iterations.
    if depth > 6u {
        piece = quarter_of(piece, (path >> 12u) & 3u);
    }
    if depth > 5u {
        piece = quarter_of(piece, (path >> 10u) & 3u);
    }
    if depth > 4u {
        piece = quarter_of(piece, (path >> 8u) & 3u);
    }
    if depth > 3u {
        piece = quarter_of(piece, (path >> 6u) & 3u);
    }
    if depth > 2u {
        piece = quarter_of(piece, (path >> 4u) & 3u);
    }
    if depth > 1u {
        piece = quarter_of(piece, (path >> 2u) & 3u);
    }
    return quarter_of(piece, path & 3u);
}

// A quarter of a leaf's parallelogram, to second order.
fn quarter_of(cell: Cell, which: u32) -> Cell {
    let x = select(-0.25, 0.25, (which & 1u) == 1u);
    let y = select(-0.25, 0.25, which > 1u);
    let q = x * cell.side_1 + y * cell.side_2;
    let m = x * cell.change_1 + y * cell.change_2;
    let normal = normalize(cell.normal + m);
    var quarter = cell;
    // Where normals diverge the surface falls away from the tangent plane.
    quarter.centroid = cell.centroid + q - 0.5 * dot(q, m) * cell.normal;
    quarter.normal = normal;
    quarter.area = 0.25 * cell.area;
    quarter.side_1 = 0.5 * (cell.side_1 - dot(cell.side_1, normal) * normal);
    quarter.side_2 = 0.5 * (cell.side_2 - dot(cell.side_2, normal) * normal);
    quarter.change_1 = 0.5 * (cell.change_1 - dot(cell.change_1, normal) * normal);
    quarter.change_2 = 0.5 * (cell.change_2 - dot(cell.change_2, normal) * normal);
    return quarter;
}

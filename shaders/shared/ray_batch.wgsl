// Rays of whole pictures, many at a time.

struct BatchUniforms {
    // Rays, or points that are lit.
    count: u32,
    // Of the directions that a dispatch adds.
    first_direction: u32,
    direction_count: u32,
}

struct BatchRay {
    // Metres.
    origin: vec3f,
    // Of unit length; of a point that is lit, its normal.
    direction: vec3f,
}

// In the flags of a result: the adapter ended the traversal early, and nothing is known.
const IS_UNFINISHED: u32 = 2u;

@group(0) @binding(0) var<uniform> batch: BatchUniforms;
@group(0) @binding(1) var<storage, read> batch_rays: array<BatchRay>;

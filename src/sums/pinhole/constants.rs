//! Numbers that the CPU and the shaders share. Shaders get them from here: see `gpu::shaders`.

/// Points along the edge of a tile of receivers.
pub const TILE_SIZE: u32 = 64;
/// Receiver points that stand for a block: four by four.
pub const INTERPOLATION_POINTS: u32 = 16;
/// How far a point may lie from where its block's sixteen points lead one to expect it, in radii of the block.
pub const SMOOTH_POSITION_TOLERANCE: f32 = 0.01;
/// How far a unit normal may lie from where the sixteen lead one to expect it.
pub const SMOOTH_NORMAL_TOLERANCE: f32 = 0.02;

/// A pair's error may be this part of what is allowed for a point: errors of many pairs add up there, though not all with the
/// same sign.
pub const PAIR_ERROR_SHARE: f32 = 1.2;
/// Errors of a lamp's light have one sign where many cells focus it on the same point: a pair's error is also at most so many times the part
/// of what is allowed that its cell has of all area. With 100, a torch's beam has .999 of its light; with 30, 1.000; without, .60.
pub const COHERENT_ERROR_SHARE: f32 = 30.0;
/// All that is dropped at a point adds less than this part of the error that is allowed there.
pub const NEGLIGIBLE_SHARE: f32 = 0.03;
/// Pairs of a block and a cell that are nearer than this many times their sizes are refined.
pub const NEAR_FIELD_SIZES: f32 = 1.5;
/// No point of a cell is taken to be nearer to a receiver than this part of the distance to its centroid.
pub const MIN_DISTANCE_RATIO: f32 = 0.3;
/// Half the diagonal of a footprint's parallelogram in roots of the sum of its sides' squares, and some more.
pub const FOOTPRINT_RADIUS: f32 = 0.6;
/// How far a footprint bends beyond its linear extent, for a cell of a given relative size.
pub const FOOTPRINT_BEND: f32 = 0.3;
/// Error of taking a cell for one sample: the part of the light's contrast that it gets wrong, at relative size 1.
pub const CONTRAST_ERROR_SCALE: f32 = 3.0;
/// Error of taking a cell for one sample: the part of its contribution by which its weight differs within it, at relative size 1.
pub const WEIGHT_ERROR_SCALE: f32 = 0.3;
/// Part of the contrast that an interpolation gets wrong where the light changes over one distance of its points.
pub const INTERPOLATION_ERROR_SCALE: f32 = 0.02;
/// Distance of a block's interpolation points, in radii of the block.
pub const POINT_SPACING: f32 = 0.47;
/// The squared minor axis of a footprint is taken to be at least this part of the sum of its sides' squares.
pub const MIN_MINOR_SHARE: f32 = 1.0 / 512.0;
/// Taps that a pair is worth whose contribution ranges over its error budget.
pub const TAPS_PER_ERROR_BUDGET: f32 = 3.0;
/// Relative size from which a cell is not taken for one sample.
pub const MAX_RELATIVE_SIZE: f32 = 0.7;
/// A cluster whose contribution stays below this many error budgets takes the visibility of its central sample.
pub const CENTRAL_VISIBILITY_SHARE: f32 = 1.0;
/// Partly visible cells below this many error budgets are interpolated within blocks all the same.
pub const PARTIAL_VISIBILITY_SHARE: f32 = 1.0;
/// How often a leaf near a receiver is quartered.
pub const MAX_QUARTERINGS: u32 = 7;
/// The same for the light of a lamp, which reaches a receiver by way of a few pieces, the rest being left out.
pub const MAX_LAMP_QUARTERINGS: u32 = 14;
/// Relative size from which a piece of such a leaf that matters is quartered again. With .7, a table has 30 % too little light in the
/// last five millimetres before the ring's wall; with .3, 3 % (`ring-above`).
pub const MAX_PIECE_SIZE: f32 = 0.3;
/// Under a lamp, leaves of a relative size up to this are not quartered: what lights a receiver comes from one place on them, whose weight
/// differs a little from the middle's, now more, now less. Quarters are blurred less, and would show the gaps between leaves.
pub const MIN_UNEVEN_SIZE: f32 = 0.2;
/// Samples are not divided further for a part of a ray along which they leave no more than this part of the light's differences within
/// them: those along the part average out.
pub const MAX_LEFT_ALONG_RAY: f32 = 0.3;
/// Nor are samples over which directions and normals turn less than this, radians.
pub const MAX_TURN_ALONG_RAY: f32 = 0.15;
/// Lamps that are small beside a footprint are seen blurred by an ellipse with these semi-axes, in sides of an even cell (`cell_shapes.rs`).
/// Root mean square of the unevenness that cells leave on a plane: simulated .033 with .5, .019 with this and .011 with 1; below flat water in
/// parallel light, .019 was measured with this.
pub const BLUR_RADIUS: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// How much farther than a footprint its blur reaches: it is a half as long from the middle.
pub const BLURRED_REACH: f32 = 1.0 + BLUR_RADIUS / 0.5;
/// Cells that are more than this many times as long as wide are blurred less.
pub const MAX_EVEN_ASPECT: f32 = 4.0;
/// Parallelograms of cells are taken to have at least this part of their areas.
pub const MIN_EVEN_PART: f32 = 0.25;
/// Sample nodes that an irradiance estimate asks at most.
pub const ESTIMATE_MAX_SAMPLE_NODES: u32 = 512;
/// Receivers of an irradiance estimate.
pub const ESTIMATE_MAX_RECEIVERS: usize = 1024;
/// An irradiance estimate is at least this part of the root mean square, where few receivers get nearly all of the light.
pub const ESTIMATE_RMS_SHARE: f32 = 0.1;

/// Look-ups wider than this, in texels of a visibility map, see the mean of the sky that they cover; narrower ones see what lies
/// between four texels.
pub const MAX_INTERPOLATED_WIDTH: f32 = 2.0;

/// What a lobe sees of the sky is the weighted mean over two squares of a map; the narrower is this many times as wide as the lobe.
/// Fitted, with the next three, to what GGX lobes (α from .09 to 1) see of half-spaces.
pub const LOBE_CORE: f32 = 0.5;
/// The wider one, likewise.
pub const LOBE_TAIL: f32 = 2.2;
/// The weight of the wider square.
pub const LOBE_TAIL_SHARE: f32 = 0.58;
/// Lobes lie this many times their width nearer to the normal than the mirrored direction: the horizon cuts them off.
pub const LOBE_SHIFT: f32 = 0.15;

/// Light is looked up in two parts of a rough mirror's lobe, which weigh the same; the narrower is this many times as wide as the lobe.
/// Fitted, with the next three, to the ring in forest light at roughness .2 to .7 (`tests/engine/gloss.rs`).
pub const LOBE_CORE_WIDTH: f32 = 0.55;
/// The wider one, likewise.
pub const LOBE_TAIL_WIDTH: f32 = 1.7;
/// They lie this many times the lobe's width nearer to the normal than the mirrored direction.
pub const LOBE_TILT: f32 = 0.06;
/// And this many times its square: wide lobes lose more of their light below the horizon.
pub const LOBE_TILT_GROWTH: f32 = 0.08;

/// A tap's width over its share of the footprint. Bilinear interpolation blurs a level's texels by more than their width, so a tap
/// reads a level a little finer. Measured: 1 blurs the ring's caustic (error .376 at 100 samples, here .361), 0.7 sharpens it
/// further (.342) but shows gaps between footprints where a sun is focused (cup, 1,000 samples: .18, here .20, .26).
pub const TAP_SHARPNESS: f32 = 0.9;
/// Where the light is even, cells are looked up in this part of their footprint's width. Measured on the ring in forest light,
/// tolerance .1: energy .993 with 1, .995 with .7, .999 with .35.
pub const EVEN_LIGHT_SHARPNESS: f32 = 0.35;
/// The ellipse's semi-axes in sides of the footprint: 1/√2, at which the weights 1 − ρ² have a parallelogram's second moments.
pub const EWA_RADIUS: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// Texels of the level read, in minor axes.
pub const EWA_TEXEL: f32 = 0.5;
/// The most columns of look-ups along the major axis.
pub const EWA_MAX_COLUMNS: f32 = 256.0;

/// A sample's reflected directions are taken to change linearly; where its surface turns far, they bend. This part of the
/// normal's squared change is the blur that comes nearest to the ground truth: without it a cup of 100 samples throws a
/// caustic four times too bright at its focus, and its error is .436 instead of .365 (`examples/accuracy.rs`).
pub const BEND_BLUR: f32 = 0.5;
/// Look-ups for rough mirrors are blurred over this part of their lobe's width at least, unless they reflect at grazing angles.
pub const LOBE_BLUR: f32 = 0.4;
/// Less blur than this, radians, changes nothing that could be measured, and is spared.
pub const MIN_BEND_BLUR: f32 = 0.03;

/// Numbers of the filters that are compiled into a gather.
pub const FILTER_NONE: u32 = 0;
/// [`Filter::Isotropic`](super::Filter::Isotropic).
pub const FILTER_ISOTROPIC: u32 = 1;
/// [`Filter::Anisotropic`](super::Filter::Anisotropic).
pub const FILTER_ANISOTROPIC: u32 = 2;
/// [`Filter::Hardware`](super::Filter::Hardware).
pub const FILTER_HARDWARE: u32 = 3;
/// [`Filter::Ewa`](super::Filter::Ewa).
pub const FILTER_EWA: u32 = 4;

/// Numbers of the kinds of light that are compiled into a gather.
pub const LIGHT_ENVIRONMENT: u32 = 0;
/// A lamp.
pub const LIGHT_LAMP: u32 = 1;
/// Lit surfaces.
pub const LIGHT_SURROUNDINGS: u32 = 2;
/// Views of surroundings, at most.
pub const MAX_VIEWPOINTS: u32 = 16;
/// Viewpoints on the other side of a surface count as so many times as far away.
pub const OTHER_SIDE: f32 = 1000.0;

/// Numbers of the beams of lamps: none, a cone, a slide.
pub const BEAM_NONE: u32 = 0;
/// A spotlight with a soft edge.
pub const BEAM_CONE: u32 = 1;
/// A spotlight that projects a picture.
pub const BEAM_SLIDE: u32 = 2;

/// Between rays through a medium, light of previews is interpolated from those whose way is at most this many times as long, or as short;
pub const MAX_LENGTH_RATIO: f32 = 1.25;
/// others have this weight.
pub const MIN_RAY_WEIGHT: f32 = 1e-3;

/// What previews read of near light in a buffer of vectors: so many for a lamp, and for a part of an emitter.
pub const LAMP_TEXELS: u32 = 5;
/// Texels of a cell.
pub const PART_TEXELS: u32 = 3;

/// What discs of light fill of footprints: these are at least this part of their length wide,
pub const MIN_SLENDERNESS: f32 = 1e-3;
/// and shorter than this, in radii of the disc, they are points.
pub const MIN_DISC_LENGTH: f32 = 5e-3;

/// Visibility maps leave in doubt what is seen at smaller sines to the surface than this: neighbouring facets hide the margins of a sample
/// there, but not its middle.
pub const MIN_CERTAIN_SINE: f32 = 0.2;
/// Occlusion that maps leave in doubt is traced where it concerns more than this part of the error budget of a pair.
pub const MIN_TRACED_SHARE: f32 = 0.1;
/// The same between receivers and cells of interfaces. Receivers touch mirrors, where doubts add up (with .5, 28 pixels of the caustic of
/// `ring-natural` stand out instead of 3), but hardly ever interfaces: `pool` takes three quarters of the time, and looks the same.
pub const MIN_TRACED_SHARE_OF_INTERFACES: f32 = 0.5;
/// The same for the environment, where the sum of several look-ups is less in doubt.
pub const MIN_TRACED_SKY_SHARE: f32 = 1.0;

// Previews.

/// Cosine between the normals of a pixel and a node from which it takes light, at least.
pub const MIN_NORMAL_COSINE: f32 = 0.9;
/// A node may lie off the pixel's plane by this part of their distance.
pub const MAX_OFF_PLANE: f32 = 0.15;
/// Weights of the nodes around a pixel add up to 1 on an even surface. With less than this, it is computed.
pub const MIN_WEIGHT: f32 = 0.05;
/// Light between nodes is computed where theirs differs by more than this part of the brightest.
pub const MAX_CONTRAST: f32 = 0.4;
/// Neighbours whose normals have a smaller cosine than this lie on either side of an edge.
pub const MIN_EVEN_COSINE: f32 = 0.85;
/// A point is on the same surface as a pixel's if their normals have at least this cosine: silhouettes of balls turn away quickly.
pub const MIN_SAME_COSINE: f32 = 0.5;
/// Mirrors along a path, at most.
pub const MAX_MIRRORS: u32 = 3;
/// A place that a mirror shows is known if the camera sees it within so many widths of a pixel,
pub const MAX_PIXELS_APART: f32 = 2.5;
/// and with normals that agree: their cosine, at least.
pub const MIN_SEEN_COSINE: f32 = 0.95;
/// Cosine between a mirrored direction and the normal of the triangle that it leaves, at least.
pub const MIN_HEIGHT: f32 = 1e-3;

/// Fraction of a GGX surface's microfacets that is sampled where there are sixteen samples, which cannot represent the remaining tail.
pub const PART_OF_FACETS: f32 = 0.98;

/// Refracted directions next to grazing ones turn without bound; they are taken to turn as at this cosine.
pub const MIN_REFRACTED_COSINE: f32 = 0.02;
/// A footprint's blur by its bend is at most so many times that of a mirror.
pub const MAX_REFRACTED_BLUR: f32 = 4.0;
/// Refracted directions within a range of angles from the normal are bounded by their chord: half the angle is at most so many times half
/// the chord, up to a right angle;
pub const HALF_ANGLE_PER_CHORD: f32 = 1.111;
/// azimuths about the normal whose sines are at most this
pub const MAX_AZIMUTH_SINE: f32 = 0.8;
/// are at most so many times their sines;
pub const AZIMUTH_PER_SINE: f32 = 1.16;
/// and a cone around both is at most so many times the hypotenuse of both half-angles.
pub const CONE_PER_AXES: f32 = 1.1;
/// The radius of a cone that holds every direction, radians.
pub const WHOLE_SPHERE_RAD: f32 = std::f32::consts::PI;

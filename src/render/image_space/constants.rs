//! Numbers that photons on the CPU and on the GPU share. Shaders get them from here: see `pinhole::gpu::shaders`.
#![cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "some are for shaders alone"))]

/// How far off a texel's plane a photon on its surface may be, in edges of the texel.
pub const PHOTON_OFF_PLANE: f32 = 0.5;
/// How far a ray may miss the photon that it was sent to, in edges of the texel.
pub const PHOTON_OFF_RAY: f32 = 0.05;
/// Surfaces whose normals differ more than this are not one: the cosine.
pub const SAME_SURFACE_COSINE: f32 = 0.5;

/// Layers of receivers in a map at most.
pub const MAX_RECEIVER_LAYERS: u32 = 8;

/// Surfaces that a texel of the camera's map shows side by side at most.
pub const MAX_VISIBLE_LAYERS: u32 = 2;
/// Texels at edges are seen by the square of so many rays,
pub const EDGE_RAYS: u32 = 4;
/// which tell so many surfaces apart.
pub const MAX_EDGE_SURFACES: u32 = 4;

/// Neighbours that lie so many times as far from each other as from those beyond them came from both sides of an edge of the caster.
pub const TEAR_STRETCH: f32 = 8.0;
/// Photons that are nearer to each other than this, in texels, are not taken for torn.
pub const LEAST_TEAR: f32 = 1.0;
/// Triangles between photons smaller than this, texels², are not drawn by the centres of texels, which miss most of them.
pub const MIN_DRAWN_AREA: f32 = 0.1;

/// The standard deviation of a splat in its diameters.
pub const SPLAT_DEVIATION: f32 = 0.25;
/// Footprints end at this many standard deviations.
pub const SPLAT_REACH: f32 = 2.5;
/// The least diameter of splats, texels.
pub const MIN_SPLAT_DIAMETER: f32 = 1.0;
/// The largest diameter of splats, texels.
pub const MAX_SPLAT_DIAMETER: f32 = 64.0;
/// The least standard deviation of a footprint, texels.
pub const MIN_FOOTPRINT_DEVIATION: f32 = 0.25;
/// Footprints are so much wider than the part of the view that a photon stands for.
pub const FOOTPRINT_OVERLAP: f32 = 1.5;
/// The size of splats of lenses, in distances between photons.
pub const LENS_SPACINGS: f32 = 2.0;
/// Surfaces whose normals differ more than this from one photon to the next have an edge between them: the cosine.
pub const SMOOTH_LENS_COSINE: f32 = 0.9;

/// Sizes of splats of several resolutions.
pub const SPLAT_SIZES: u32 = 4;
/// The diameter of the smallest ones, texels.
pub const FIRST_SPLAT_DIAMETER: u32 = 3;
/// By how much the next ones are larger.
pub const SPLAT_DIAMETER_STEP: u32 = 4;

/// The largest distance between the photons of a cluster that are one, texels of the map.
pub const MAX_CLUSTER_EXTENT: f32 = 1.0;
/// Surfaces whose normals differ more than this are not one where photons of a cluster land: the cosine.
pub const MIN_CLUSTER_COSINE: f32 = 0.9;
/// Photons of clusters in a row of the buffer.
pub const CLUSTER_ROW: u32 = 1024;

/// Steps of a ray through an image of surfaces at least,
pub const MIN_IMAGE_STEPS: f32 = 8.0;
/// and at most; about one for each texel.
pub const MAX_IMAGE_STEPS: f32 = 192.0;
/// Steps of the search for the place where a ray passes a surface. One that takes the thickness along the view for the way, as in the first
/// papers, loses a third of the light of a glass ball.
pub const IMAGE_SEARCH_STEPS: u32 = 10;
/// A ray that ends so many texels from the surface has passed behind its edge.
pub const MAX_IMAGE_MISS: f32 = 1.5;

/// Directions of extended lights are at most so far from their middle, radians.
pub const MAX_SPREAD_RAD: f32 = 1.2;

/// The least cosine of the light's own direction in the ratio of Wyman and Davis 2006, Equation 3, which has no bound.
pub const MIN_DIRECT_COSINE: f32 = 0.05;

/// Kinds of chains.
pub const CHAIN_R: u32 = 0;
/// Through one interface.
pub const CHAIN_T: u32 = 1;
/// Through a closed object.
pub const CHAIN_TT: u32 = 2;
/// Through two closed objects.
pub const CHAIN_TTTT: u32 = 3;

/// What an object does to photons: bits. A mirror that reflects them in front of it,
pub const REFLECTS_IN_FRONT: u32 = 1;
/// and behind it.
pub const REFLECTS_BEHIND: u32 = 2;
/// An interface between two media,
pub const IS_SURFACE: u32 = 4;
/// or the boundary of a closed object;
pub const IS_SOLID: u32 = 8;
/// it reflects by the Fresnel equations.
pub const IS_FRESNEL_SURFACE: u32 = 16;
/// A receiver.
pub const RECEIVES_PHOTONS: u32 = 32;

/// What images of a light's view show: everything;
pub const SHOWS_ALL: u32 = 0;
/// in two halves, the nearest surfaces, and the farthest ones of closed objects;
pub const SHOWS_FIRST_AND_LAST: u32 = 1;
/// the fronts of an object alone;
pub const SHOWS_FRONT: u32 = 2;
/// or its backs, the farthest ones.
pub const SHOWS_BACK: u32 = 3;

/// How photons become irradiance: see `Mode`.
pub const MODE_POINTS: u32 = 0;
/// Points, smoothed later.
pub const MODE_GATHER: u32 = 1;
/// Triangles by the centres of texels.
pub const MODE_POLYGONS: u32 = 2;
/// Triangles by exact areas.
pub const MODE_EXACT_POLYGONS: u32 = 3;
/// Splats of one size.
pub const MODE_SPLATS: u32 = 4;
/// Splats of several sizes.
pub const MODE_MULTI_RESOLUTION: u32 = 5;
/// Splats by the equation of thin lenses.
pub const MODE_THIN_LENS: u32 = 6;
/// Splats by that of thick lenses.
pub const MODE_THICK_LENS: u32 = 7;
/// Splats as large as the distances to the neighbours.
pub const MODE_FOOTPRINTS: u32 = 8;

/// What maps keep for glossy receivers: see `ForGloss`.
pub const KEEPS_NOTHING: u32 = 0;
/// Directions of travel.
pub const KEEPS_DIRECTIONS: u32 = 1;
/// Directions of light that nothing has turned.
pub const KEEPS_UNDEFLECTED: u32 = 2;
/// What photons reflect to the viewer.
pub const KEEPS_REFLECTED: u32 = 3;

/// Entries of the account of flux: those of `Ledger`, rays that were ended early, and photons that met a receiver.
pub const LEDGER_ENTRIES: u32 = 10;

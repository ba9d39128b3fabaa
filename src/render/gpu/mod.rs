//! Devices and what they can do. Knows no scenes, no files and no windows.

mod device;
mod kept;

pub(crate) use device::buffer_with;
pub use device::{Adapter, Gpu, adapters};
pub(crate) use kept::KeptBuffer;

/// Why the GPU could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter of any kind.
    #[error("no GPU adapter was found")]
    NoAdapter,
    /// None with that name.
    #[error("no GPU adapter has '{name}' in its name; found: {found}")]
    UnknownAdapter {
        /// The name asked for.
        name: String,
        /// The adapters there are.
        found: String,
    },
    /// The driver refused a device.
    #[error("adapter '{adapter}' gives no device: {reason}")]
    NoDevice {
        /// Adapter.
        adapter: String,
        /// The driver's reason.
        reason: String,
    },
    /// The device was lost while it worked.
    #[error("adapter '{adapter}' was lost while rendering ({reason})")]
    Lost {
        /// Adapter.
        adapter: String,
        /// The driver's reason.
        reason: String,
    },
    /// The device refused a command.
    #[error("adapter '{adapter}' refused a command: {reason}")]
    Refused {
        /// Adapter.
        adapter: String,
        /// The validation error.
        reason: String,
    },
    /// The device has too little memory.
    #[error("adapter '{adapter}' has too little memory for this scene")]
    OutOfMemory {
        /// Adapter.
        adapter: String,
    },
    /// A texture is too large.
    #[error("{what} is {size} texels wide, but this adapter's textures end at {limit}")]
    TextureTooLarge {
        /// Which texture.
        what: &'static str,
        /// Its larger side.
        size: u32,
        /// The adapter's limit.
        limit: u32,
    },
    /// There is nothing to gather at.
    #[error("the image has {width} × {height} pixels; give it one at least")]
    EmptyImage {
        /// Pixels along a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Bounds of the light need a pyramid of cube maps.
    #[error("the environment's cube map is {size} texels wide, but its bounds need a power of two")]
    CubeSize {
        /// Texels along an edge.
        size: u32,
    },
    /// The filter is compiled into an engine.
    #[error(
        "the engine was made for the filter {engine}, but the frame's parameters ask for {params}; make an engine for each"
    )]
    OtherFilter {
        /// The engine's filter.
        engine: &'static str,
        /// The parameters' filter.
        params: &'static str,
    },
    /// So is what the light is.
    #[error("the engine was made for {engine}, but the light is {inputs}; make an engine for each")]
    OtherLight {
        /// The engine's light.
        engine: &'static str,
        /// That of the inputs.
        inputs: &'static str,
    },
    /// Views of surroundings that a gather cannot bind.
    #[error("surroundings have {views} views; give from 1 to {limit}, all of one size")]
    OddViews {
        /// Number of views.
        views: usize,
        /// The most that there may be.
        limit: usize,
    },
    /// Visibility is compiled into an engine, too.
    #[error("the engine was made {} maps of visibility, but the samples are the other way; make an engine for each", if *.engine { "for samples with" } else { "for samples without" })]
    OtherVisibility {
        /// Whether the engine reads maps.
        engine: bool,
    },
    /// So is refraction.
    #[error(
        "the engine was made for mirrors alone, but some samples are on surfaces that refract; make one with refraction"
    )]
    NoRefraction,
    /// And so are media.
    #[error("the engine was made for scenes without a medium, but there is one; make one with a medium")]
    NoMedium,
    /// The samples' maps of visibility are too large.
    #[error("what the samples see takes {bytes} bytes, but this adapter's buffers end at {limit}")]
    MapsTooLarge {
        /// Bytes of their maps.
        bytes: u64,
        /// Bytes that fit.
        limit: u64,
    },
    /// More closed objects than there are layers for images of them.
    #[error(
        "images of {count} closed objects are needed, but this adapter has layers for {limit}; let photons be traced (--hits traced), or choose the CPU"
    )]
    TooManySolids {
        /// How many objects.
        count: usize,
        /// How many the adapter has layers for.
        limit: usize,
    },
    /// A caustic map is too large.
    #[error("a caustic map of {}×{} texels takes {bytes} bytes, but this adapter's buffers end at {limit}; make it smaller, or choose the CPU", .size[0], .size[1])]
    CausticMapTooLarge {
        /// Columns and rows.
        size: [u32; 2],
        /// Bytes of its texels or sums.
        bytes: u64,
        /// Bytes that fit.
        limit: u64,
    },
    /// A shader's loop was ended early.
    #[error(
        "adapter '{adapter}' ends the loops of shaders before their time (Mesa's software adapter after 65,535 iterations), and this picture needs more of them"
    )]
    LoopCutShort {
        /// Adapter.
        adapter: String,
    },
    /// A tree of cells is too large.
    #[error("a tree of {cells} cells takes {bytes} bytes, but this adapter's buffers end at {limit}")]
    TreeTooLarge {
        /// Cells of all levels.
        cells: usize,
        /// Bytes of their nodes.
        bytes: u64,
        /// Bytes that fit.
        limit: u64,
    },
    /// There are too many triangles.
    #[error("the scene has more triangles than fit this adapter's textures: about {limit}")]
    TooManyTriangles {
        /// Triangles that fit.
        limit: u64,
    },
    /// The sample buffer is too large.
    #[error("{samples} samples do not fit this adapter's buffers ({limit} fit)")]
    TooManySamples {
        /// Samples given.
        samples: usize,
        /// Samples that fit.
        limit: usize,
    },
}

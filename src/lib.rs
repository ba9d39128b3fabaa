//! **Pinspot** renders caustics from natural light.
//!
//! A mirror turns every small piece of itself into a pinhole camera that projects the surroundings on whatever it
//! faces. Wand and Straßer (*Real-Time Caustics*, 2003) made an algorithm of it: discretise the reflector into sample
//! points; let each project the environment map on the receivers, blurred by a footprint that follows from the
//! surface's curvature around the sample; sum. Pinspot is that algorithm, on GPUs through wgpu and on CPUs.
//!
//! ```text
//!  scene ──► sampling ──► differential, cell_tree ──► pinhole (cpu │ gpu) ──► image
//!    │                                                    ▲
//!    └──────────────► environment, tracing ───────────────┘
//!                         render: the headless renderer that ties them together
//!
//!  scene ──► reference ──► report ◄── render
//! ```
//!
//! Data flows from left to right; no module imports from one to its right.
//!
//! * [`scene`]: what exists: meshes, shapes, materials, cameras, scene files.
//! * [`reflectance`]: how much a mirror mirrors at which angle: metals, coats.
//! * [`brdf`]: what receivers do with light: Lambert, Phong, GGX, tables.
//! * [`environment`]: what shines: maps, spots, constants; a prefiltered cube.
//! * [`sampling`]: where on the reflectors the pinholes are.
//! * [`differential`]: the surface around each of them.
//! * [`cell_tree`]: a hierarchy of samples whose cells tile the reflectors.
//! * [`tracing`]: rays against the meshes: what hides what.
//! * [`pinhole`]: the sum itself; [`pinhole::gpu`] records into the caller's encoder, [`pinhole::cpu`] is its twin.
//! * [`conformance`]: filters against the exact integral over a footprint.
//! * [`image`](mod@image): pictures and files.
//! * [`render`]: scene file in, pictures out.
//! * [`reference`](mod@reference): the ground truth, which shares nothing with what it judges.
//! * [`report`]: comparisons of techniques against it.
//!
//! Programs with a wgpu device of their own start at [`pinhole::gpu::Engine`]; see `examples/embed.rs`. Programs that want
//! pictures start at [`render::Renderer`]:
//!
//! ```
//! use pinspot::Silent;
//! use pinspot::render::{BackendChoice, Renderer, Settings};
//!
//! let loaded = pinspot::scene::load::<Settings>("mirror-sphere")?;
//! let mut options = loaded.render.options()?;
//! options.size = [32, 32];
//! options.samples = 50;
//! let renderer = Renderer::new(loaded.scene, options, &BackendChoice::Cpu, &Silent)?;
//! let rendered = renderer.render(&Silent)?;
//! assert_eq!(rendered.layers[0].1.pixels.len(), 32 * 32);
//! # Ok::<(), pinspot::Error>(())
//! ```
//!
//! Units: metres, radians, W/(m²·sr), W/m². Right-handed, Y up, linear Rec.709.

pub mod brdf;
pub mod cell_tree;
pub mod conformance;
pub mod differential;
mod disjoint_sets;
pub mod environment;
mod error;
pub mod gpu;
pub mod image;
pub mod pinhole;
mod progress;
pub mod reference;
pub mod reflectance;
pub mod render;
pub mod report;
pub mod sampling;
pub mod scene;
pub mod tracing;
mod vectors;
mod words;

pub use error::{Error, OptionError};
pub use progress::{Progress, Silent};
pub use wgpu;

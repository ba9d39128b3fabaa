//! Tests of the whole engine: closed forms, the paper's worst case in numbers, GPU against CPU, shaders, determinism,
//! sums taken apart, sequences, comparisons that are made again.
//!
//! GPU tests need an adapter; a software one will do. They fail without one: `tests/run` installs it.

mod agreement;
mod beams;
mod cancellation;
mod closed_forms;
mod comparisons;
mod densities;
mod distributions;
mod embedding;
mod emitters;
mod environment_rotation;
mod exposure;
mod figure4;
mod filter_quality;
mod focus;
mod gloss;
mod gpu_errors;
mod ground_truth;
mod half_float;
mod hierarchy;
mod hierarchy_gpu;
mod image_space;
mod image_space_gpu;
mod image_space_papers;
mod independence;
mod inspection;
mod lamps;
mod lost_light;
mod media;
mod media_gpu;
mod metals;
mod near_light_gpu;
mod photon_passes;
mod pictures;
mod previews;
mod random_scenes;
mod receivers;
mod refraction;
mod sequences;
mod solids;
mod speckles;
mod stages;
mod sums;
mod support;
mod visibility;

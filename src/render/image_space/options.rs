//! The options of image-space techniques.

use serde::{Deserialize, Serialize};

use crate::OptionError;

/// How photons become irradiance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Points or exact polygons, whichever have less error for their photons, and as many of these as a tolerance asks for: two halves of them tell.
    #[default]
    Auto,
    /// Every photon adds its flux to the texel that it lands in (Wyman and Davis 2006, Section 3.2).
    Points,
    /// The same, then a Gaussian over 7×7 texels, where these have at least three photons (Wyman and Davis, Section 3.2.2).
    Gather,
    /// Neighbouring photons are the corners of triangles, which are drawn into the map (Wyman and Davis, Section 3.2.1).
    Polygons,
    /// The same triangles by the area of each texel that they cover.
    ExactPolygons,
    /// Gaussian splats of one size (Wyman and Dachsbacher 2006, Section 3).
    Splats,
    /// Splats of 3, 7, 11 and 15 texels, chosen by the density of photons (Wyman and Dachsbacher, Section 4.1).
    MultiResolution,
    /// Splats whose size follows from the equation of thin lenses (Wyman and Dachsbacher, Section 4.2).
    ThinLens,
    /// The same for thick lenses.
    ThickLens,
    /// Splats that are as long and as wide as the distances to the neighbouring photons.
    Footprints,
}

impl Mode {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::Auto,
        Self::Points,
        Self::Gather,
        Self::Polygons,
        Self::ExactPolygons,
        Self::Splats,
        Self::MultiResolution,
        Self::ThinLens,
        Self::ThickLens,
        Self::Footprints,
    ];

    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Points => "points",
            Self::Gather => "gather",
            Self::Polygons => "polygons",
            Self::ExactPolygons => "exact-polygons",
            Self::Splats => "splats",
            Self::MultiResolution => "multi-resolution",
            Self::ThinLens => "thin-lens",
            Self::ThickLens => "thick-lens",
            Self::Footprints => "footprints",
        }
    }

    /// Whether it can do with what a traversal makes of photons: most modes need neighbours, or at least the extent that a photon stands for.
    pub fn works_with(self, traversal: Traversal) -> bool {
        let is_of_points = matches!(self, Self::Points | Self::Gather | Self::Splats);
        match traversal {
            Traversal::Dense => true,
            Traversal::Hierarchical => is_of_points || self == Self::Auto,
            Traversal::MaximalLevel | Traversal::TexelError => {
                is_of_points || self == Self::Auto || matches!(self, Self::MultiResolution | Self::Footprints)
            }
        }
    }

    /// The mode that stands for `Auto` where photons are sent once: exact polygons, or splats of clusters.
    #[must_use]
    pub(crate) fn fixed(self, traversal: Traversal) -> Self {
        match (self, traversal) {
            (Self::Auto, Traversal::Dense) => Self::ExactPolygons,
            (Self::Auto, _) => Self::Splats,
            (mode, _) => mode,
        }
    }

    /// Whether photons need neighbours that come from the same point of the light.
    pub fn needs_neighbours(self) -> bool {
        !matches!(self, Self::Points | Self::Gather | Self::Splats | Self::MultiResolution)
    }
}

/// How photons find the surfaces that they meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Hits {
    /// By rays against the scene's triangles.
    #[default]
    Traced,
    /// In images from the light's view, as fine as its photons: what no image shows is not met (Wyman and Davis 2006, Section 3.1).
    Image,
    /// In images with a quarter of the photons along each edge, which are interpolated (Wyman and Nichols 2009, Section 3.2).
    QuarterImage,
}

impl Hits {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Traced, Self::Image, Self::QuarterImage];

    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Traced => "traced",
            Self::Image => "image",
            Self::QuarterImage => "quarter-image",
        }
    }

    /// Texels along an edge of images of a view with so many photons; `None` without images.
    pub(super) fn image_size(self, photons: u32) -> Option<u32> {
        /// Finer ones are interpolated.
        const FINEST: u32 = 2048;
        match self {
            Self::Traced => None,
            Self::Image => Some(photons.min(FINEST)),
            Self::QuarterImage => Some((photons / 4).clamp(8, FINEST)),
        }
    }
}

/// Which photons of a light's view are followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Traversal {
    /// One for each texel.
    #[default]
    Dense,
    /// The same, and then those of four neighbours, or of larger squares, that land within a texel of the map are one photon: hierarchical
    /// caustic maps (Wyman 2008), with which Wyman and Nichols compare theirs.
    Hierarchical,
    /// Where casters are: from a grid of 64² on, clusters of four photons are divided in four, up to the finest grid, unless they show no
    /// caster (Wyman and Nichols 2009, Section 3.2.1).
    MaximalLevel,
    /// The same, but clusters whose photons land within a texel of the map are one photon (Wyman and Nichols, Section 3.2.2).
    TexelError,
}

impl Traversal {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Dense, Self::Hierarchical, Self::MaximalLevel, Self::TexelError];

    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dense => "dense",
            Self::Hierarchical => "hierarchical",
            Self::MaximalLevel => "maximal-level",
            Self::TexelError => "texel-error",
        }
    }
}

/// Whose picture of the receivers a map is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MapView {
    /// The camera's: a texel is a pixel. What the camera sees by way of mirrors and interfaces is taken from other maps.
    #[default]
    Eye,
    /// Each light's own, as in the papers.
    Light,
}

impl MapView {
    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Eye => "eye",
            Self::Light => "light",
        }
    }
}

/// From where glossy receivers take the light of a caustic (Wyman and Davis 2006, Equations 9 to 11).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Incidence {
    /// From where each photon comes: what it reflects to the camera is added up in the camera's map.
    Photon,
    /// From the mean direction of a texel's photons.
    #[default]
    Mean,
    /// From the light itself, as if nothing had turned it.
    Light,
}

impl Incidence {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Photon, Self::Mean, Self::Light];

    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Photon => "photon",
            Self::Mean => "mean",
            Self::Light => "light",
        }
    }
}

/// What image-space techniques do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ImageSpaceOptions {
    /// How photons become irradiance.
    pub mode: Mode,
    /// How photons find what they meet.
    pub hits: Hits,
    /// Which photons are followed.
    pub traversal: Traversal,
    /// Photons along each edge of a light's view; with the mode `auto` those of a pass. From 16 to 8192, and a power of two from 64 on unless all are followed.
    pub photons: u32,
    /// Whose view the maps are.
    pub caustic_map: MapView,
    /// Texels along each edge of a light's map; from 16 to 8192.
    pub caustic_map_size: u32,
    /// Directional lights that an environment map is divided into, sixteen times as many with the mode `auto`; from 1 to 1024.
    pub lights: u32,
    /// Points or directions that extended lights are divided into where neighbouring photons must come from the same one; from 1 to 1024.
    pub light_directions: u32,
    /// Diameter of splats of one size, texels; from 1 to 64.
    pub splat_diameter: f32,
    /// From where glossy receivers take the light.
    pub incidence: Incidence,
    /// Frames whose maps are averaged, from 1 to 4: this one and those before it (Wyman and Davis 2006, Section 3.2.3). The photons of each
    /// pass other quarters of the texels of their grid. A picture without predecessors takes as many frames itself.
    pub temporal_frames: u32,
    /// Polygons and gathers by the letter of Wyman and Davis 2006, for comparison: Equations 3 and 9 with the ratio of the photon's cosine to that
    /// of the light's own direction, and without the photons between which there is no polygon.
    pub paper: bool,
}

impl Default for ImageSpaceOptions {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            hits: Hits::default(),
            traversal: Traversal::default(),
            photons: 512,
            caustic_map: MapView::default(),
            caustic_map_size: 512,
            lights: 24,
            light_directions: 24,
            splat_diameter: 2.5,
            incidence: Incidence::default(),
            temporal_frames: 1,
            paper: false,
        }
    }
}

impl ImageSpaceOptions {
    /// The largest number of frames whose maps are averaged.
    pub const MAX_TEMPORAL_FRAMES: u32 = 4;

    /// Whether the mode and the number of photons follow a tolerance. Where photons are followed as in one of the papers, the options say how many
    /// there are.
    pub(crate) fn follows_tolerance(&self) -> bool {
        let Self { mode, hits, traversal, caustic_map, temporal_frames, .. } = *self;
        let is_one_frame = temporal_frames == 1;
        let is_traced = hits == Hits::Traced && traversal == Traversal::Dense;
        mode == Mode::Auto && is_traced && is_one_frame && caustic_map == MapView::Eye
    }

    /// The distance between photons of all frames that are averaged, relative to that of one frame's: those of four are a grid twice as fine.
    pub(crate) fn frame_spacing(&self) -> f32 {
        1.0 / (self.temporal_frames as f32).sqrt()
    }

    /// About the memory that a light's map of two layers takes on the CPU, bytes.
    pub(crate) fn map_bytes(&self) -> u64 {
        // Positions, normals and so on, and sums for flux and gloss.
        const TEXEL: u64 = 36 + 2 * 24;
        let resolutions = match (self.mode, self.traversal) {
            (Mode::MultiResolution, Traversal::Dense) => 4 * (24 + 4),
            (Mode::Gather, _) => 24 + 4,
            _ => 0,
        };
        2 * u64::from(self.caustic_map_size).pow(2) * (TEXEL + resolutions)
    }

    /// Checks that every value is in its range.
    pub fn check(&self) -> Result<(), OptionError> {
        let out_of_range = |key, value: String, expected: &str| {
            Err(OptionError::OutOfRange { key, value, expected: expected.to_owned() })
        };
        for (key, value) in [("photons", self.photons), ("caustic_map_size", self.caustic_map_size)] {
            if !(16..=8192).contains(&value) {
                return out_of_range(key, value.to_string(), "from 16 to 8192");
            }
        }
        if self.traversal != Traversal::Dense {
            if !self.mode.works_with(self.traversal) {
                let needs = if self.mode.works_with(Traversal::TexelError) {
                    "the extent that each photon stands for"
                } else {
                    "all photons as neighbours"
                };
                let reason = format!("{} needs {needs}", self.mode.name());
                let remedies = &[("traversal", "dense"), ("mode", "splats")];
                return Err(OptionError::Conflict { key: "mode", reason, remedies });
            }
            if !self.photons.is_power_of_two() || self.photons < 64 {
                return out_of_range(
                    "photons",
                    self.photons.to_string(),
                    "a power of two from 64, as clusters are divided in four",
                );
            }
        }
        for (key, value) in [("lights", self.lights), ("light_directions", self.light_directions)] {
            if !(1..=1024).contains(&value) {
                return out_of_range(key, value.to_string(), "from 1 to 1024");
            }
        }
        if !(1..=Self::MAX_TEMPORAL_FRAMES).contains(&self.temporal_frames) {
            return out_of_range("temporal_frames", self.temporal_frames.to_string(), "from 1 to 4");
        }
        if self.incidence == Incidence::Photon && self.caustic_map == MapView::Light {
            let reason = "photon is what each photon reflects to the camera, and a light's map has none".into();
            let remedies = &[("incidence", "mean"), ("caustic_map", "eye")];
            return Err(OptionError::Conflict { key: "incidence", reason, remedies });
        }
        if self.paper && !matches!(self.mode, Mode::Polygons | Mode::Gather) {
            let reason = format!("is about polygons and gathers, not {}", self.mode.name());
            let remedies = &[("mode", "polygons"), ("mode", "gather")];
            return Err(OptionError::Conflict { key: "paper", reason, remedies });
        }
        if !(1.0..=64.0).contains(&self.splat_diameter) {
            return out_of_range("splat_diameter", self.splat_diameter.to_string(), "from 1 to 64");
        }
        Ok(())
    }
}

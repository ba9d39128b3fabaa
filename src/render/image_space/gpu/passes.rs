//! The passes over photons, and the buffers that they share. What decides which photons are followed is elsewhere.

use sobol_burley::parts::sobol_rev;
use wgpu::{BufferUsages, CommandEncoder};

use super::Device;
use super::images::{draw_images, no_images};
use super::layout::{
    Block, ClusterUniforms, GpuSurface, MapUniforms, PHOTON_BYTES, ViewUniforms, chain_constant, channels,
    kept_constant, mode_constant,
};
use super::map::MapOnGpu;
use crate::gpu::{GpuError, buffer_with};
use crate::image_space::constants::{CLUSTER_ROW, LEDGER_ENTRIES};
use crate::image_space::emission::{Kind, Pattern};
use crate::image_space::ledger::Ledger;
use crate::image_space::lights::{LightView, PhotonLight, Profile};
use crate::image_space::maps::MapInputs;
use crate::image_space::options::{Hits, Incidence, Mode};
use crate::image_space::projection::Projection;
use crate::image_space::strips::{Strip, photons_of_strip};
use crate::pinhole::CURVE_POINTS;
use crate::pinhole::gpu::pipeline::bind;
use crate::pinhole::gpu::{LampUniforms, UploadedLamp, no_slide, storage_buffer};

/// Edge of the workgroups.
const WORKGROUP_EDGE: u32 = 8;

/// Clusters of a workgroup, and workgroups of a row of them: devices dispatch 65,535 in one at most.
const CLUSTERS_OF_GROUP: u32 = 64;
const GROUPS_OF_ROW: u32 = 1024;

/// Where photons come from.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub view: &'a LightView,
    pub light: &'a LightOnGpu,
    /// What they meet, unless they are traced.
    pub images: &'a wgpu::BindGroup,
}

/// A light on the device.
pub(super) struct LightOnGpu {
    lamp: LampUniforms,
    group: wgpu::BindGroup,
}

/// Buffers and bind groups.
pub(super) struct Passes<'a> {
    device: Device<'a>,
    inputs: &'a MapInputs<'a>,
    /// Photons, their ways, and their places in a map.
    photons: [wgpu::Buffer; 3],
    ledger: wgpu::Buffer,
    /// The account of maps whose flux is not counted.
    unaccounted: wgpu::Buffer,
    surfaces: wgpu::Buffer,
    reflectances: wgpu::Buffer,
    sobol_vectors: wgpu::Buffer,
    of_surfaces: wgpu::BindGroup,
    nothing: wgpu::BindGroup,
    no_images: wgpu::BindGroup,
    no_clusters: wgpu::Buffer,
    geometry: wgpu::BindGroup,
}

impl<'a> Passes<'a> {
    pub fn new(device: Device<'a>, inputs: &'a MapInputs<'a>) -> Self {
        let on = &device.gpu.device;
        let mode = inputs.options.mode;
        // Views of cubes have borders.
        let size = [inputs.options.photons + 2; 2];
        let count = photons_of_strip(size);
        let has_ways = matches!(mode, Mode::ThinLens | Mode::ThickLens);
        let counts = [count, if has_ways { count } else { 1 }, count];
        let buffers = [0, 1, 2].map(|k| {
            on.create_buffer(&wgpu::BufferDescriptor {
                label: Some("photons"),
                size: counts[k] * PHOTON_BYTES[k],
                usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        });
        let ledger = |label| {
            let bytes = vec![0; 2 * LEDGER_ENTRIES as usize * size_of::<u32>()];
            buffer_with(on, label, &bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC)
        };
        let (surfaces, reflectances) = surfaces(inputs);
        let surfaces = storage_buffer(on, "what surfaces do to photons", bytemuck::cast_slice(&surfaces));
        let reflectances = storage_buffer(on, "reflectances", bytemuck::cast_slice(&reflectances));
        let sobol_vectors = storage_buffer(on, "Sobol vectors", bytemuck::bytes_of(&sobol_vectors()));
        let pipelines = device.pipelines;
        Self {
            of_surfaces: bind(on, &pipelines.of_surfaces, &[surfaces.as_entire_binding()]),
            nothing: bind(on, &pipelines.nothing, &[]),
            no_images: no_images(on, &pipelines.images),
            no_clusters: storage_buffer(on, "no clusters", &[0; 4]),
            geometry: device.geometry.bind(on, &pipelines.geometry),
            device,
            inputs,
            photons: buffers,
            ledger: ledger("account of flux"),
            unaccounted: ledger("account of flux that is not counted"),
            surfaces,
            reflectances,
            sobol_vectors,
        }
    }

    /// Uploads a light.
    pub fn light(&self, light: &PhotonLight) -> Result<LightOnGpu, GpuError> {
        let gpu = self.device.gpu;
        let (lamp, slide) = match light {
            PhotonLight::Lamp(lamp) => {
                let UploadedLamp { uniforms, slide } = UploadedLamp::upload(&gpu.device, &gpu.queue, lamp)?;
                (uniforms, slide)
            }
            PhotonLight::Directional { .. } => (LampUniforms::default(), no_slide(&gpu.device)),
        };
        let buffers = [&self.surfaces, &self.reflectances, &self.sobol_vectors].map(wgpu::Buffer::as_entire_binding);
        let [a, b, c] = buffers;
        let slide = wgpu::BindingResource::TextureView(&slide);
        Ok(LightOnGpu { lamp, group: bind(&gpu.device, &self.device.pipelines.of_light, &[a, b, c, slide]) })
    }

    /// Images of what a view shows, unless photons are traced.
    pub fn images(&self, view: &LightView) -> Result<wgpu::BindGroup, GpuError> {
        let pipelines = &self.device.pipelines.images;
        match self.inputs.options.hits.image_size(view.projection.size[0]) {
            None => Ok(self.no_images.clone()),
            Some(size) => draw_images(self.device, pipelines, self.inputs, (view, size), &self.surfaces),
        }
    }

    /// Follows the photons of a strip to receivers.
    pub fn emit(&self, encoder: &mut CommandEncoder, from: Source<'_>, kind: Kind, strip: Strip) {
        let uniforms = ViewUniforms { strip, ..self.view_uniforms(from, kind) };
        let columns = from.view.projection.size[0];
        let clusters = self.no_clusters.as_entire_binding();
        self.run_emission(encoder, (from, uniforms), (clusters, &self.ledger), [columns, strip.rows]);
    }

    /// Follows the photons of clusters, and accounts for their flux if that is wanted. `from.view` has the clusters' grid.
    pub fn emit_clusters(
        &self,
        encoder: &mut CommandEncoder,
        from: Source<'_>,
        kind: Kind,
        (clusters, count): (wgpu::BindingResource<'_>, u32),
        is_accounted: bool,
    ) {
        let Block { columns, strip, .. } = Block::of_clusters(count, false);
        let own_rows = if is_accounted { strip.rows } else { 0 };
        let strip = Strip { own_rows, ..strip };
        let uniforms = ViewUniforms { strip, cluster_count: count, ..self.view_uniforms(from, kind) };
        let ledger = if is_accounted { &self.ledger } else { &self.unaccounted };
        self.run_emission(encoder, (from, uniforms), (clusters, ledger), [columns, strip.rows]);
    }

    fn view_uniforms(&self, Source { view, light, .. }: Source<'_>, kind: Kind) -> ViewUniforms {
        let (power, extent) = match &view.light {
            PhotonLight::Directional { irradiance, sigma_rad, .. } => (*irradiance, *sigma_rad),
            PhotonLight::Lamp(lamp) => (lamp.intensity, lamp.radius),
        };
        let is_disc = matches!(&view.light, PhotonLight::Directional { profile: Profile::Disc, .. });
        let Pattern { seed, offset, is_papers } = self.inputs.pattern;
        let [columns, all_rows] = view.projection.size;
        ViewUniforms {
            plane: (&view.projection).into(),
            power: power.to_array(),
            extent: if view.light.is_extended() { extent } else { 0.0 },
            lamp: light.lamp,
            channels: channels(kind.channel),
            pivot: view.pivot,
            chain: chain_constant(kind.chain),
            channel: kind.channel.unwrap_or(0) as u32,
            is_cube: u32::from(view.is_cube),
            columns,
            steps_per_watt: self.steps_per_watt(),
            has_ways: u32::from(matches!(self.inputs.options.mode, Mode::ThinLens | Mode::ThickLens)),
            seed: seed as u32,
            all_rows,
            is_papers: u32::from(is_papers),
            offset: offset.as_vec2().to_array(),
            is_disc: u32::from(is_disc),
            ..ViewUniforms::default()
        }
    }

    fn run_emission(
        &self,
        encoder: &mut CommandEncoder,
        (from, uniforms): (Source<'_>, ViewUniforms),
        (clusters, ledger): (wgpu::BindingResource<'_>, &wgpu::Buffer),
        size: [u32; 2],
    ) {
        let on = &self.device.gpu.device;
        let uniforms = buffer_with(on, "a light's view", bytemuck::bytes_of(&uniforms), BufferUsages::UNIFORM);
        let [a, b, c, d] = [&uniforms, &self.photons[0], &self.photons[1], ledger].map(wgpu::Buffer::as_entire_binding);
        let own = bind(on, &self.device.pipelines.of_view, &[a, b, c, d, clusters]);
        let mut pass = begin(encoder, "photons");
        let pipelines = self.device.pipelines;
        let is_traced = self.inputs.options.hits == Hits::Traced;
        pass.set_pipeline(if is_traced { &pipelines.emit } else { &pipelines.emit_in_images });
        self.set_groups(&mut pass, [&own, &from.light.group, from.images]);
        dispatch(&mut pass, size);
    }

    /// Runs a pass over a list of clusters: [`PhotonPipelines::decide`](super::PhotonPipelines) or `merge`.
    pub fn run_over_clusters(
        &self,
        encoder: &mut CommandEncoder,
        pipeline: &wgpu::ComputePipeline,
        uniforms: &ClusterUniforms,
        [clusters, divided, merged, counts, coverage]: [wgpu::BindingResource<'_>; 5],
    ) {
        let on = &self.device.gpu.device;
        let buffer = buffer_with(on, "a list of clusters", bytemuck::bytes_of(uniforms), BufferUsages::UNIFORM);
        let [list, photons, ledger] = [&buffer, &self.photons[0], &self.ledger].map(wgpu::Buffer::as_entire_binding);
        let bindings = [list, photons, clusters, divided, merged, counts, coverage, ledger];
        let own = bind(on, &self.device.pipelines.of_clusters, &bindings);
        let mut pass = begin(encoder, "clusters");
        pass.set_pipeline(pipeline);
        self.set_groups(&mut pass, [&own, &self.nothing, &self.nothing]);
        let groups = uniforms.count.div_ceil(CLUSTERS_OF_GROUP);
        pass.dispatch_workgroups(groups.min(GROUPS_OF_ROW), groups.div_ceil(GROUPS_OF_ROW), 1);
    }

    /// The device.
    pub fn on(&self) -> &wgpu::Device {
        &self.device.gpu.device
    }

    pub fn pipelines(&self) -> &super::PhotonPipelines {
        self.device.pipelines
    }

    pub fn submit(&self, encoder: CommandEncoder) {
        self.device.gpu.queue.submit([encoder.finish()]);
    }

    /// Reads the numbers of clusters in two lists.
    pub async fn read_counts(&self, counts: &wgpu::Buffer) -> Result<[u32; 2], GpuError> {
        let bytes = self.device.gpu.read_buffer(counts, counts.size()).await?;
        Ok(bytemuck::pod_read_unaligned(&bytes))
    }

    /// Clusters that fit in the buffers together.
    pub fn clusters_of_batch(&self) -> u32 {
        let photons = (self.photons[0].size() / PHOTON_BYTES[0]) as u32;
        // Lists are bound from multiples of so many on.
        photons / CLUSTER_ROW * CLUSTER_ROW / 4 / CLUSTERS_OF_GROUP * CLUSTERS_OF_GROUP
    }

    /// How many layers of receivers a view needs.
    ///
    /// # Errors
    /// Not even one fits in the device's buffers, or it is lost.
    pub async fn count_layers(&self, projection: Projection) -> Result<u32, GpuError> {
        let map = MapOnGpu::to_count_layers(self.device.gpu, self.inputs, projection)?;
        self.run_over_texels(&map, &[&self.device.pipelines.count_layers]);
        map.counted_layers(self.device.gpu).await
    }

    /// Finds what the texels of a map show. Submits.
    pub fn find_receivers(&self, map: &MapOnGpu) {
        let pipelines = self.device.pipelines;
        let of_camera = [&pipelines.find_receivers, &pipelines.find_parts, &pipelines.settle_parts];
        self.run_over_texels(map, if map.is_camera { &of_camera } else { &of_camera[..1] });
    }

    fn run_over_texels(&self, map: &MapOnGpu, pipelines: &[&wgpu::ComputePipeline]) {
        let gpu = self.device.gpu;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let own = self.bind_map(map, self.uniforms(map), &self.ledger);
        let mut pass = begin(&mut encoder, "receivers of a caustic map");
        self.set_groups(&mut pass, [&own, &self.of_surfaces, &self.nothing]);
        for pipeline in pipelines {
            pass.set_pipeline(pipeline);
            dispatch(&mut pass, map.projection.size);
        }
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Adds photons to a map. Where it is one of many, photons beside it belong to others.
    pub fn deposit(
        &self,
        encoder: &mut CommandEncoder,
        to: (&MapOnGpu, &LightView),
        block: Block,
        is_one_of_many: bool,
    ) {
        self.add(encoder, to, (block, is_one_of_many), &self.ledger);
    }

    /// The same without an entry in the account.
    pub fn deposit_unaccounted(&self, encoder: &mut CommandEncoder, to: (&MapOnGpu, &LightView), block: Block) {
        self.add(encoder, to, (block, false), &self.unaccounted);
    }

    fn add(
        &self,
        encoder: &mut CommandEncoder,
        (map, view): (&MapOnGpu, &LightView),
        (block, is_one_of_many): (Block, bool),
        ledger: &wgpu::Buffer,
    ) {
        let Block { columns, strip, clusters } = block;
        let (light, is_light_far) = match &view.light {
            PhotonLight::Directional { towards, .. } => (-*towards, true),
            PhotonLight::Lamp(lamp) => (lamp.position, false),
        };
        let uniforms = MapUniforms {
            light: light.to_array(),
            is_light_far: u32::from(is_light_far),
            columns,
            rows: strip.rows,
            first_own_row: strip.first_own_row,
            own_rows: strip.own_rows,
            is_one_of_many: u32::from(is_one_of_many),
            spacing: view.projection.texel as f32,
            is_first: u32::from(strip.is_first()),
            clusters,
            ..self.uniforms(map)
        };
        let own = self.bind_map(map, uniforms, ledger);
        let pipelines = self.device.pipelines;
        let is_polygons = matches!(self.inputs.options.mode, Mode::Polygons | Mode::ExactPolygons | Mode::Auto);
        let mut pass = begin(encoder, "photons into a caustic map");
        pass.set_pipeline(&pipelines.place_photons);
        self.set_groups(&mut pass, [&own, &self.of_surfaces, &self.nothing]);
        dispatch(&mut pass, [columns, strip.rows]);
        pass.set_pipeline(if is_polygons { &pipelines.add_polygons } else { &pipelines.add_splats });
        // Cells lie between photons and around them.
        dispatch(&mut pass, if is_polygons { [columns + 1, strip.own_rows + 1] } else { [columns, strip.rows] });
    }

    fn uniforms(&self, map: &MapOnGpu) -> MapUniforms {
        let options = self.inputs.options;
        MapUniforms {
            plane: (&map.projection).into(),
            size: map.projection.size,
            is_camera: u32::from(map.is_camera),
            kept: kept_constant(map.kept),
            is_alone: u32::from(options.paper),
            steps_per_watt: self.steps_per_watt(),
            mode: mode_constant(options.mode),
            diameter: options.splat_diameter,
            frame_spacing: options.frame_spacing(),
            layers: map.layers,
            ..MapUniforms::default()
        }
    }

    fn steps_per_watt(&self) -> f32 {
        (1.0 / crate::image_space::caustic_map::watts_per_step(self.inputs.total_watts())) as f32
    }

    fn bind_map(&self, map: &MapOnGpu, uniforms: MapUniforms, ledger: &wgpu::Buffer) -> wgpu::BindGroup {
        let on = &self.device.gpu.device;
        let uniforms = buffer_with(on, "a caustic map", bytemuck::bytes_of(&uniforms), BufferUsages::UNIFORM);
        let [photons, ways, places] = &self.photons;
        let buffers = [&uniforms, photons, ways, ledger, &map.texels, places, &map.sums, &map.counts];
        bind(on, &self.device.pipelines.of_map, &buffers.map(wgpu::Buffer::as_entire_binding))
    }

    fn set_groups(&self, pass: &mut wgpu::ComputePass, groups: [&wgpu::BindGroup; 3]) {
        for (index, group) in (0..).zip(groups.into_iter().chain([&self.geometry])) {
            pass.set_bind_group(index, group, &[]);
        }
    }

    /// The account so far, and how many photons met a receiver.
    ///
    /// # Errors
    /// The adapter has ended rays early.
    pub async fn ledger(&self) -> Result<(Ledger, u64), GpuError> {
        let read = self.entries(&self.ledger).await?;
        if read[8] + self.entries(&self.unaccounted).await?[8] > 0 {
            return Err(GpuError::LoopCutShort { adapter: self.device.gpu.adapter.name.clone() });
        }
        let step = 1.0 / f64::from(self.steps_per_watt());
        let watts = |entry: usize| read[entry] as f64 * step;
        let ledger = Ledger {
            cast: watts(0),
            deposited: watts(1),
            missed: watts(2),
            no_receiver: watts(3),
            total_reflection: watts(4),
            hidden: watts(5),
            off_map: watts(6),
            culled: watts(7),
        };
        Ok((ledger, read[9] as u64))
    }

    async fn entries(&self, ledger: &wgpu::Buffer) -> Result<Vec<i64>, GpuError> {
        let bytes = self.device.gpu.read_buffer(ledger, ledger.size()).await?;
        let words: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&bytes);
        Ok(words.into_iter().map(|[low, high]| (u64::from(high) << 32 | u64::from(low)) as i64).collect())
    }
}

fn begin<'e>(encoder: &'e mut CommandEncoder, label: &str) -> wgpu::ComputePass<'e> {
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(label), ..Default::default() })
}

fn dispatch(pass: &mut wgpu::ComputePass, [columns, rows]: [u32; 2]) {
    pass.dispatch_workgroups(columns.div_ceil(WORKGROUP_EDGE), rows.div_ceil(WORKGROUP_EDGE), 1);
}

/// What the objects do to photons, and curves of reflectance, one after another.
fn surfaces(inputs: &MapInputs) -> (Vec<GpuSurface>, Vec<[f32; 4]>) {
    let mut curves = Vec::new();
    let surface = |(index, (object, mirror)): (usize, (&crate::scene::Object, &Option<crate::reflectance::Curve>))| {
        let number = (curves.len() / CURVE_POINTS) as u32;
        if let Some(curve) = mirror {
            let value = |k: usize| curve.at(k as f64 / (CURVE_POINTS - 1) as f64).as_vec3().extend(0.0).to_array();
            curves.extend((0..CURVE_POINTS).map(value));
        }
        let is_known = inputs.options.incidence == Incidence::Photon;
        let materials = inputs.glossy.filter(|_| is_known).map(|materials| &materials.of_object[index]);
        GpuSurface::new(object, number, materials)
    };
    let surroundings = &inputs.surroundings;
    let surfaces = surroundings.objects.iter().zip(surroundings.mirrors).enumerate().map(surface).collect();
    (surfaces, curves)
}

/// The direction vectors of the first two dimensions of Sobol points, with reversed bits.
fn sobol_vectors() -> [[u32; 2]; 16] {
    std::array::from_fn(|bit| [0, 1].map(|dimension| sobol_rev(0x8000_0000 >> bit, dimension)))
}

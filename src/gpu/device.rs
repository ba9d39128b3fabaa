//! Adapters and devices for programs without a device of their own.

use std::fmt;

use std::sync::{Arc, Mutex};

use super::GpuError;

/// What an adapter is and can do.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Adapter {
    /// Name, as the driver says.
    pub name: String,
    /// vulkan, metal, dx12.
    pub backend: String,
    /// Driver and its version.
    pub driver: String,
    /// A software rasteriser.
    pub software: bool,
    /// 32-bit float textures can be filtered: radiance needs no scale factor.
    pub float32_filterable: bool,
    /// 32-bit float targets blend: no ping-pong.
    pub float32_blendable: bool,
    /// Largest 2-D texture, texels.
    pub max_texture: u32,
    /// Largest storage buffer, bytes.
    pub max_storage_bytes: u64,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}{})", self.name, self.backend, if self.software { ", software" } else { "" })
    }
}

impl Adapter {
    fn of(adapter: &wgpu::Adapter) -> Self {
        let (info, features, limits) = (adapter.get_info(), adapter.features(), adapter.limits());
        Self {
            name: info.name,
            backend: info.backend.to_string(),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            software: info.device_type == wgpu::DeviceType::Cpu,
            float32_filterable: features.contains(wgpu::Features::FLOAT32_FILTERABLE),
            float32_blendable: features.contains(wgpu::Features::FLOAT32_BLENDABLE),
            max_texture: limits.max_texture_dimension_2d,
            max_storage_bytes: limits.max_storage_buffer_binding_size,
        }
    }
}

fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let mut found = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
    // Discrete before integrated before software.
    found.sort_by_key(|a| match a.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    });
    found
}

/// All adapters, the best first.
pub fn adapters() -> Vec<Adapter> {
    enumerate().iter().map(Adapter::of).collect()
}

/// A device of our own, for the command line and for tests.
#[derive(Debug)]
pub struct Gpu {
    /// The adapter it runs on.
    pub adapter: Adapter,
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    failure: Arc<Mutex<Option<Failure>>>,
}

#[derive(Clone, Debug)]
enum Failure {
    Lost(String),
    Refused(String),
}

impl Gpu {
    /// Opens the best adapter, or the best one with `name` in its name (any case).
    pub fn open(name: Option<&str>) -> Result<Self, GpuError> {
        let found = enumerate();
        let matches =
            |a: &wgpu::Adapter| name.is_none_or(|name| a.get_info().name.to_lowercase().contains(&name.to_lowercase()));
        let Some(adapter) = found.iter().find(|a| matches(a)) else {
            return Err(match name {
                Some(name) if !found.is_empty() => GpuError::UnknownAdapter {
                    name: name.into(),
                    found: found.iter().map(|a| a.get_info().name).collect::<Vec<_>>().join(", "),
                },
                _ => GpuError::NoAdapter,
            });
        };
        Self::from_adapter(adapter)
    }

    /// Opens the adapter at a place in the list of [`adapters`].
    pub fn open_nth(index: usize) -> Result<Self, GpuError> {
        Self::from_adapter(enumerate().get(index).ok_or(GpuError::NoAdapter)?)
    }

    /// Opens the best adapter with no more than what every WebGPU device has: what runs on it runs in browsers.
    pub fn open_minimal() -> Result<Self, GpuError> {
        let found = enumerate();
        let adapter = found.first().ok_or(GpuError::NoAdapter)?;
        Self::request(adapter, wgpu::Features::empty(), wgpu::Limits::default())
    }

    fn from_adapter(adapter: &wgpu::Adapter) -> Result<Self, GpuError> {
        let wanted = wgpu::Features::FLOAT32_FILTERABLE | wgpu::Features::FLOAT32_BLENDABLE;
        Self::request(adapter, adapter.features() & wanted, adapter.limits())
    }

    fn request(
        adapter: &wgpu::Adapter,
        required_features: wgpu::Features,
        required_limits: wgpu::Limits,
    ) -> Result<Self, GpuError> {
        let summary = Adapter::of(adapter);
        let descriptor =
            wgpu::DeviceDescriptor { label: Some("pinspot"), required_features, required_limits, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| GpuError::NoDevice { adapter: summary.name.clone(), reason: e.to_string() })?;
        let failure = Arc::new(Mutex::new(None));
        let slot = failure.clone();
        device.set_device_lost_callback(move |_, message| keep_first(&slot, Failure::Lost(message)));
        let slot = failure.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            keep_first(&slot, Failure::Refused(error.to_string().replace('\n', " ")));
        }));
        Ok(Self { adapter: summary, device, queue, failure })
    }

    /// The first thing that went wrong since the device was opened.
    pub fn check(&self) -> Result<(), GpuError> {
        let adapter = self.adapter.name.clone();
        match self.failure.lock().expect("no panic holds the lock").clone() {
            None => Ok(()),
            Some(Failure::Lost(reason)) => Err(GpuError::Lost { adapter, reason }),
            Some(Failure::Refused(reason)) => Err(GpuError::Refused { adapter, reason }),
        }
    }

    /// Waits until all submitted work is done.
    pub fn wait(&self) -> Result<(), GpuError> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled.map_err(|e| GpuError::Lost { adapter: self.adapter.name.clone(), reason: e.to_string() })?;
        Ok(())
    }
}

fn keep_first(slot: &Mutex<Option<Failure>>, failure: Failure) {
    let mut slot = slot.lock().expect("no panic holds the lock");
    // A device that is dropped reports itself lost; by then nobody asks.
    slot.get_or_insert(failure);
}

impl Gpu {
    /// Uploads texels as a 32-bit float texture to be read by shaders.
    pub fn upload_texture(&self, [width, height]: [u32; 2], texels: &[[f32; 4]]) -> wgpu::TextureView {
        use wgpu::util::DeviceExt;
        let texture = self.device.create_texture_with_data(
            &self.queue,
            &wgpu::TextureDescriptor {
                label: Some("upload"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rgba32Float,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
            wgpu::util::TextureDataOrder::LayerMajor,
            bytemuck::cast_slice(texels),
        );
        texture.create_view(&Default::default())
    }

    /// Waits for the queue and copies a 32-bit float texture back, row by row.
    pub fn read_texture(&self, texture: &wgpu::Texture) -> Result<Vec<[f32; 4]>, GpuError> {
        const TEXEL: u32 = 16;
        let (width, height) = (texture.width(), texture.height());
        let row = (width * TEXEL).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: u64::from(row) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            texture.size(),
        );
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
        self.wait()?;
        let lost = |reason: String| GpuError::Lost { adapter: self.adapter.name.clone(), reason };
        receiver.recv().map_err(|e| lost(e.to_string()))?.map_err(|e| lost(e.to_string()))?;
        let bytes = buffer.get_mapped_range(..).map_err(|e| lost(e.to_string()))?;
        let texels = bytes
            .chunks(row as usize)
            .flat_map(|r| r[..(width * TEXEL) as usize].chunks_exact(TEXEL as usize))
            .map(bytemuck::pod_read_unaligned)
            .collect();
        Ok(texels)
    }
}

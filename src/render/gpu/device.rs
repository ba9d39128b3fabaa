//! Adapters and devices for programs without a device of their own. Nothing here blocks: see [`crate::blocking`] for that.

use crate::boxed::BoxFuture;
use std::borrow::Cow;
use std::fmt;
use std::future::poll_fn;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Poll, Waker};

use super::GpuError;

/// What an adapter is and can do.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
#[expect(clippy::struct_excessive_bools, reason = "each tells of another capability")]
pub struct Adapter {
    /// Name, as the driver says.
    pub name: String,
    /// vulkan, metal, dx12.
    pub backend: String,
    /// Driver and its version.
    pub driver: String,
    /// A software rasteriser.
    pub software: bool,
    /// Has ray queries: shaders need no traversal to find what rays meet.
    pub ray_queries: bool,
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
    /// Describes an adapter.
    pub fn of(adapter: &wgpu::Adapter) -> Self {
        let (info, features, limits) = (adapter.get_info(), adapter.features(), adapter.limits());
        Self {
            name: info.name,
            backend: info.backend.to_string(),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            software: info.device_type == wgpu::DeviceType::Cpu,
            ray_queries: features.contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY),
            float32_filterable: features.contains(wgpu::Features::FLOAT32_FILTERABLE),
            float32_blendable: features.contains(wgpu::Features::FLOAT32_BLENDABLE),
            max_texture: limits.max_texture_dimension_2d,
            max_storage_bytes: limits.max_storage_buffer_binding_size,
        }
    }
}

async fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let mut found = instance.enumerate_adapters(wgpu::Backends::PRIMARY).await;
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
pub fn adapters() -> BoxFuture<'static, Vec<Adapter>> {
    Box::pin(async move { enumerate().await.iter().map(Adapter::of).collect() })
}

/// What makes a device more exact and faster, and lets passes be timed.
const WANTED_FEATURES: wgpu::Features = wgpu::Features::FLOAT32_FILTERABLE
    .union(wgpu::Features::FLOAT32_BLENDABLE)
    .union(wgpu::Features::TIMESTAMP_QUERY)
    .union(wgpu::Features::EXPERIMENTAL_RAY_QUERY);

fn descriptor(required_features: wgpu::Features, required_limits: wgpu::Limits) -> wgpu::DeviceDescriptor<'static> {
    let is_experimental = required_features.intersects(wgpu::Features::EXPERIMENTAL_RAY_QUERY);
    wgpu::DeviceDescriptor {
        label: Some("pinspot"),
        required_features,
        required_limits,
        experimental_features: if is_experimental { experimental() } else { wgpu::ExperimentalFeatures::disabled() },
        ..Default::default()
    }
}

/// wgpu's token for features whose validation is not complete yet.
#[expect(unsafe_code, reason = "wgpu asks for it; there is no other way to ray queries")]
fn experimental() -> wgpu::ExperimentalFeatures {
    // SAFETY: wgpu may not check yet what ray queries require, so `pinhole::gpu::acceleration` and `ray_queries.wgsl` see to it: structures
    // are built before commands that use them, from buffers that hold all their vertices, with finite matrices; queries are initialised
    // before they proceed, with ranges that are not negative, and read once they have proceeded to the end.
    unsafe { wgpu::ExperimentalFeatures::enabled() }
}

/// A device, and what went wrong with it.
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
    OutOfMemory,
}

impl Gpu {
    /// Opens the best adapter, or the best one with `name` in its name (any case).
    pub fn open(name: Option<&str>) -> BoxFuture<'_, Result<Self, GpuError>> {
        Box::pin(async move {
            let found = enumerate().await;
            let matches = |a: &wgpu::Adapter| {
                name.is_none_or(|name| a.get_info().name.to_lowercase().contains(&name.to_lowercase()))
            };
            let Some(adapter) = found.iter().find(|a| matches(a)) else {
                return Err(match name {
                    Some(name) if !found.is_empty() => GpuError::UnknownAdapter {
                        name: name.into(),
                        found: found.iter().map(|a| a.get_info().name).collect::<Vec<_>>().join(", "),
                    },
                    _ => GpuError::NoAdapter,
                });
            };
            Self::from_adapter(adapter).await
        })
    }

    /// Opens the adapter at a place in the list of [`adapters`].
    pub fn open_nth(index: usize) -> BoxFuture<'static, Result<Self, GpuError>> {
        Box::pin(async move { Self::from_adapter(enumerate().await.get(index).ok_or(GpuError::NoAdapter)?).await })
    }

    /// Opens the best adapter with no more than what every WebGPU device has: what runs on it runs in browsers.
    pub fn open_minimal() -> BoxFuture<'static, Result<Self, GpuError>> {
        Box::pin(async move {
            let found = enumerate().await;
            let adapter = found.first().ok_or(GpuError::NoAdapter)?;
            Self::request(adapter, wgpu::Features::empty(), wgpu::Limits::default()).await
        })
    }

    async fn from_adapter(adapter: &wgpu::Adapter) -> Result<Self, GpuError> {
        let wanted = adapter.features() & WANTED_FEATURES;
        match Self::request(adapter, wanted, adapter.limits()).await {
            // A driver may promise ray queries and refuse them.
            Err(_) if wanted.contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY) => {
                Self::request(adapter, wanted - wgpu::Features::EXPERIMENTAL_RAY_QUERY, adapter.limits()).await
            }
            opened => opened,
        }
    }

    async fn request(
        adapter: &wgpu::Adapter,
        required_features: wgpu::Features,
        required_limits: wgpu::Limits,
    ) -> Result<Self, GpuError> {
        if !adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::CUBE_ARRAY_TEXTURES) {
            let reason = "it has no arrays of cube maps, which every WebGPU device has".to_owned();
            return Err(GpuError::NoDevice { adapter: adapter.get_info().name, reason });
        }
        let (device, queue) = adapter
            .request_device(&descriptor(required_features, required_limits))
            .await
            .map_err(|e| GpuError::NoDevice { adapter: adapter.get_info().name, reason: e.to_string() })?;
        Ok(Self::of_device(adapter, device, queue))
    }

    /// What a device should be asked for to serve [`Self::of_device`] well: all limits of the adapter and, where it has them, 32-bit
    /// textures that are filtered and blended, timestamps, and ray queries.
    pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
        descriptor(adapter.features() & WANTED_FEATURES, adapter.limits())
    }

    /// A device that the program has for other purposes, too. Its callbacks for loss and errors become Pinspot's.
    pub fn of_device(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let summary = Adapter::of(adapter);
        let failure = Arc::new(Mutex::new(None));
        let slot = failure.clone();
        device.set_device_lost_callback(move |_, message| keep_first(&slot, Failure::Lost(message)));
        let slot = failure.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let failure = match error {
                wgpu::Error::OutOfMemory { .. } => Failure::OutOfMemory,
                other => Failure::Refused(other.to_string().replace('\n', " ")),
            };
            keep_first(&slot, failure);
        }));
        Self { adapter: summary, device, queue, failure }
    }

    /// The first thing that went wrong since the device was opened.
    pub fn check(&self) -> Result<(), GpuError> {
        let adapter = self.adapter.name.clone();
        match lock(&self.failure).clone() {
            None => Ok(()),
            Some(Failure::Lost(reason)) => Err(GpuError::Lost { adapter, reason }),
            Some(Failure::Refused(reason)) => Err(GpuError::Refused { adapter, reason }),
            Some(Failure::OutOfMemory) => Err(GpuError::OutOfMemory { adapter }),
        }
    }

    /// Completes when all work submitted before this call is done.
    pub fn submitted_work_done(&self) -> impl Future<Output = Result<(), GpuError>> {
        let completion = Completion::default();
        let done = completion.clone();
        self.queue.on_submitted_work_done(move || done.complete(()));
        self.completed(completion)
    }

    /// What a callback of the device hands over. Each poll of the future drives the device, so that any executor makes progress.
    async fn completed<T>(&self, completion: Completion<T>) -> Result<T, GpuError> {
        poll_fn(|context| {
            let polled = self.device.poll(wgpu::PollType::Poll);
            let outcome = completion.take_or_register(context.waker());
            if let Err(error) = self.check() {
                return Poll::Ready(Err(error));
            }
            match (outcome, polled) {
                (Some(value), _) => Poll::Ready(Ok(value)),
                (None, Err(error)) => Poll::Ready(Err(self.lost(error))),
                (None, Ok(_)) => {
                    // Browsers call back by themselves, and only once their event loop gets its turn.
                    if cfg!(not(target_family = "wasm")) {
                        context.waker().wake_by_ref();
                    }
                    Poll::Pending
                }
            }
        })
        .await
    }

    fn lost(&self, reason: impl fmt::Display) -> GpuError {
        GpuError::Lost { adapter: self.adapter.name.clone(), reason: reason.to_string() }
    }
}

/// A value that a callback hands over to a future.
#[derive(Debug)]
struct Completion<T>(Arc<Mutex<Slot<T>>>);

#[derive(Debug)]
struct Slot<T> {
    value: Option<T>,
    waker: Option<Waker>,
}

impl<T> Default for Completion<T> {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(Slot { value: None, waker: None })))
    }
}

impl<T> Clone for Completion<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> Completion<T> {
    fn complete(&self, value: T) {
        let waker = {
            let mut slot = lock(&self.0);
            slot.value = Some(value);
            slot.waker.take()
        };
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    fn take_or_register(&self, waker: &Waker) -> Option<T> {
        let mut slot = lock(&self.0);
        slot.waker = Some(waker.clone());
        slot.value.take()
    }
}

/// A panic elsewhere leaves these values whole: each is written at once.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps the first failure. The loss of a device explains what it refused before it reported that.
fn keep_first(slot: &Mutex<Option<Failure>>, failure: Failure) {
    let mut slot = lock(slot);
    // A device that is dropped reports itself lost; by then nobody asks.
    if slot.is_none() || matches!((&*slot, &failure), (Some(Failure::Refused(_)), Failure::Lost(_))) {
        *slot = Some(failure);
    }
}

impl Gpu {
    /// Uploads texels, row by row, as a 32-bit float texture to be read by shaders. Texels that are missing are zero.
    pub fn upload_texture(&self, [width, height]: [u32; 2], texels: &[[f32; 4]]) -> wgpu::TextureView {
        use wgpu::util::DeviceExt;
        let count = width as usize * height as usize;
        let mut texels = Cow::Borrowed(texels);
        if texels.len() < count {
            texels.to_mut().resize(count, [0.0; 4]);
        }
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
            bytemuck::cast_slice(&texels),
        );
        texture.create_view(&Default::default())
    }

    /// Copies a 32-bit float texture back, row by row, once the work submitted before this call is done.
    pub fn read_texture(&self, texture: &wgpu::Texture) -> impl Future<Output = Result<Vec<[f32; 4]>, GpuError>> {
        let rows = Rows::of(texture);
        let buffer = self.read_back_buffer(u64::from(rows.stride) * u64::from(rows.count));
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(rows.stride), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            texture.size(),
        );
        let bytes = self.read_back(encoder, buffer);
        async move { Ok(rows.texels(&bytes.await?)) }
    }

    /// Copies the first bytes of a buffer back, once the work submitted before this call is done. Their number is a multiple of four.
    pub fn read_buffer(&self, buffer: &wgpu::Buffer, bytes: u64) -> impl Future<Output = Result<Vec<u8>, GpuError>> {
        let copy = self.read_back_buffer(bytes);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, bytes);
        self.read_back(encoder, copy)
    }

    /// A buffer that is copied to and mapped.
    pub(crate) fn read_back_buffer(&self, size: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        })
    }

    /// Submits commands that copy to a buffer, and reads it.
    fn read_back(
        &self,
        encoder: wgpu::CommandEncoder,
        buffer: wgpu::Buffer,
    ) -> impl Future<Output = Result<Vec<u8>, GpuError>> {
        self.queue.submit([encoder.finish()]);
        self.read_mapped(buffer)
    }

    /// Reads a buffer that can be mapped, once the work submitted before this call is done.
    pub(crate) fn read_mapped(&self, buffer: wgpu::Buffer) -> impl Future<Output = Result<Vec<u8>, GpuError>> {
        let completion = Completion::default();
        let mapped = completion.clone();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| mapped.complete(result));
        async move {
            self.completed(completion).await?.map_err(|e| self.lost(e))?;
            let bytes = buffer.get_mapped_range(..).map_err(|e| self.lost(e))?.to_vec();
            buffer.unmap();
            Ok(bytes)
        }
    }
}

/// A buffer with these contents, of which there are some. wgpu's own function for it panics if the device is lost; here the buffer is
/// left as it is, and whoever submits learns of the loss.
pub(crate) fn buffer_with(
    device: &wgpu::Device,
    label: &str,
    contents: &[u8],
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: (contents.len() as u64).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
        usage,
        mapped_at_creation: true,
    });
    if let Ok(mut mapped) = buffer.get_mapped_range_mut(..) {
        mapped.slice(..contents.len()).copy_from_slice(contents);
        drop(mapped);
        buffer.unmap();
    }
    buffer
}

/// How the rows of a 32-bit float texture lie in a buffer.
struct Rows {
    /// Bytes from row to row.
    stride: u32,
    /// Bytes of a row's texels.
    length: u32,
    count: u32,
}

impl Rows {
    fn of(texture: &wgpu::Texture) -> Self {
        let length = texture.width() * size_of::<[f32; 4]>() as u32;
        let stride = length.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        Self { stride, length, count: texture.height() }
    }

    fn texels(&self, bytes: &[u8]) -> Vec<[f32; 4]> {
        bytes
            .chunks(self.stride as usize)
            .flat_map(|row| row[..self.length as usize].chunks_exact(size_of::<[f32; 4]>()))
            .map(bytemuck::pod_read_unaligned)
            .collect()
    }
}

//! Where sums and rays are computed: the CPU, or a GPU whose device is opened once and serves any number of engines.

use std::fmt;
#[cfg(feature = "gpu")]
use std::sync::{Arc, OnceLock};

use serde::Serialize;

use crate::Error;
use crate::OptionError;
use crate::boxed::BoxFuture;
#[cfg(feature = "gpu")]
use crate::gpu::{Adapter, Gpu, GpuError};
use crate::options::FilterChoice;
use crate::pinhole::Filter;
#[cfg(feature = "gpu")]
use crate::pinhole::gpu::{HardwareVerdict, PipelineCache, check_hardware_filter};

/// What a program waits for where sums are computed on a GPU.
#[cfg(feature = "gpu")]
pub use wgpu::Device;

/// Without the feature `gpu` there is no device.
#[cfg(not(feature = "gpu"))]
#[derive(Clone, Debug)]
pub enum Device {}

/// The requested back end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum BackendChoice {
    /// A hardware GPU if there is one, else the CPU, which is faster than a software GPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The best adapter, or the best one whose name contains this; includes software adapters.
    #[cfg(feature = "gpu")]
    Gpu(Option<String>),
}

/// An open back end. Clones share the device and its pipelines, which are compiled once for any number of engines.
#[derive(Clone, Debug)]
pub struct Backend(Kind);

#[derive(Clone, Debug)]
enum Kind {
    Cpu,
    #[cfg(feature = "gpu")]
    Gpu(Arc<SharedGpu>),
}

/// A device, its pipelines, and the measured quality of its filter.
#[cfg(feature = "gpu")]
#[derive(Debug)]
pub(crate) struct SharedGpu {
    pub gpu: Gpu,
    pub pipelines: PipelineCache,
    /// The verdict on its hardware filter, measured when first needed.
    verdict: OnceLock<HardwareVerdict>,
}

impl Backend {
    /// The CPU, with SIMD and all cores.
    pub fn cpu() -> Self {
        Self(Kind::Cpu)
    }

    /// A GPU through wgpu.
    #[cfg(feature = "gpu")]
    pub fn gpu(gpu: Gpu) -> Self {
        Self(Kind::Gpu(Arc::new(SharedGpu { gpu, pipelines: PipelineCache::default(), verdict: OnceLock::new() })))
    }

    /// Opens a back end. [`BackendChoice::Auto`] and [`BackendChoice::Cpu`] always succeed; a GPU fails if there is no
    /// such adapter.
    ///
    /// ```
    /// use pinspot::{Backend, BackendChoice, blocking};
    ///
    /// let backend = blocking::wait(None, Backend::open(&BackendChoice::Auto))?;
    /// println!("{:?}", backend.report());
    /// # Ok::<(), pinspot::Error>(())
    /// ```
    pub fn open(choice: &BackendChoice) -> BoxFuture<'_, Result<Self, Error>> {
        Box::pin(async move {
            match choice {
                BackendChoice::Cpu => Ok(Self::cpu()),
                #[cfg(feature = "gpu")]
                BackendChoice::Gpu(name) => Ok(Self::gpu(Gpu::open(name.as_deref()).await?)),
                #[cfg(feature = "gpu")]
                BackendChoice::Auto => {
                    let hardware = Gpu::open(None).await.ok().filter(|gpu| !gpu.adapter.software);
                    Ok(hardware.map_or_else(Self::cpu, Self::gpu))
                }
                #[cfg(not(feature = "gpu"))]
                BackendChoice::Auto => Ok(Self::cpu()),
            }
        })
    }

    /// Its description for reports.
    pub fn report(&self) -> BackendReport {
        match &self.0 {
            Kind::Cpu => BackendReport::Cpu { threads: rayon::current_num_threads() },
            #[cfg(feature = "gpu")]
            Kind::Gpu(shared) => BackendReport::Gpu { adapter: shared.gpu.adapter.clone() },
        }
    }

    /// Whether it is a GPU.
    pub fn is_gpu(&self) -> bool {
        !matches!(self.0, Kind::Cpu)
    }

    /// The device, on a GPU.
    #[cfg(feature = "gpu")]
    pub(crate) fn shared_gpu(&self) -> Option<&Arc<SharedGpu>> {
        match &self.0 {
            Kind::Cpu => None,
            Kind::Gpu(shared) => Some(shared),
        }
    }

    /// Notices the loss of the device before it is used: wgpu panics where a buffer of a lost device is mapped.
    #[cfg(feature = "gpu")]
    pub fn check(&self) -> Result<(), GpuError> {
        if let Some(shared) = self.shared_gpu() {
            // Calls back if the device is lost; its own errors say no more.
            let _ = shared.gpu.device.poll(wgpu::PollType::Poll);
            shared.gpu.check()?;
        }
        Ok(())
    }

    /// The device, on a GPU. It has to be polled while a future of the engine is pending, as `blocking::wait` does.
    pub fn device(&self) -> Option<&Device> {
        match &self.0 {
            Kind::Cpu => None,
            #[cfg(feature = "gpu")]
            Kind::Gpu(shared) => Some(&shared.gpu.device),
        }
    }

    /// The filter that a choice resolves to on this back end, with a warning about it if there is one.
    #[cfg_attr(not(feature = "gpu"), expect(clippy::unused_async, reason = "only a GPU has to be waited for"))]
    pub(crate) async fn resolve_filter(&self, choice: FilterChoice) -> Result<(Filter, Option<String>), Error> {
        #[cfg(feature = "gpu")]
        if let Kind::Gpu(shared) = &self.0 {
            return Ok(shared.resolve_filter(choice).await?);
        }
        match choice.filter() {
            Some(Filter::Hardware) => Err(OptionError::Conflict {
                key: "filter",
                reason: "hardware needs a GPU".to_owned(),
                remedies: &[("filter", "anisotropic"), ("backend", "gpu")],
            }
            .into()),
            filter => Ok((filter.unwrap_or(Filter::Anisotropic), None)),
        }
    }
}

#[cfg(feature = "gpu")]
impl SharedGpu {
    async fn verdict(&self) -> Result<HardwareVerdict, GpuError> {
        if let Some(known) = self.verdict.get() {
            return Ok(*known);
        }
        let verdict = check_hardware_filter(&self.gpu).await?;
        Ok(*self.verdict.get_or_init(|| verdict))
    }

    async fn resolve_filter(&self, choice: FilterChoice) -> Result<(Filter, Option<String>), GpuError> {
        let filter = match choice.filter() {
            None if self.verdict().await?.is_right() => Filter::Hardware,
            None => Filter::Anisotropic,
            Some(filter) => filter,
        };
        if choice.filter() != Some(Filter::Hardware) {
            return Ok((filter, None));
        }
        let verdict = self.verdict().await?;
        let warning = (!verdict.is_right()).then(|| {
            format!(
                "the hardware filter of '{}' is wrong for explicit gradients on cube maps (RMS error {:.2} of the pattern's standard deviation), so the picture is wrong as well; use the anisotropic filter",
                self.gpu.adapter.name, verdict.rms_error
            )
        });
        Ok((filter, warning))
    }
}

/// A back end as reports describe it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase", tag = "backend")]
#[non_exhaustive]
pub enum BackendReport {
    /// The CPU.
    Cpu {
        /// Worker threads.
        threads: usize,
    },
    /// A GPU.
    #[cfg(feature = "gpu")]
    Gpu {
        /// The adapter.
        adapter: Adapter,
    },
}

impl BackendReport {
    /// The adapter's description; `None` on the CPU.
    pub fn adapter(&self) -> Option<String> {
        match self {
            Self::Cpu { .. } => None,
            #[cfg(feature = "gpu")]
            Self::Gpu { adapter } => Some(adapter.to_string()),
        }
    }
}

impl fmt::Display for BackendReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu { threads } => write!(f, "the CPU ({threads} threads)"),
            #[cfg(feature = "gpu")]
            Self::Gpu { adapter } => adapter.fmt(f),
        }
    }
}

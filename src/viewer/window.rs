//! The native window around the viewer, by eframe.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use eframe::{egui, egui_wgpu};

use super::document::Document;
use super::{Viewer, loader};
use crate::BackendChoice;
use crate::image::write_png;
use pinspot_render::gpu::{Adapter, Gpu};

/// Why there is no window.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// The scene could not be opened.
    #[error("{0}")]
    Scene(String),
    /// There is no display, or no graphics driver.
    #[error("cannot open a window: {0}")]
    Window(String),
    /// The screenshot could not be written.
    #[error("{0}")]
    Screenshot(String),
}

/// The scene that is shown if none is named.
const DEFAULT_SCENE: &str = "ring-natural";

/// Opens a window on a scene file or a built-in scene. Returns when it is closed. With a file for a screenshot, it closes by itself
/// once the picture is finished and the screenshot (PNG) is written.
///
/// # Errors
/// A scene that cannot be read, no display, no graphics driver, or a screenshot that cannot be written.
pub fn view(scene: Option<&str>, choice: BackendChoice, screenshot: Option<PathBuf>) -> Result<(), ViewError> {
    let document = Document::open(scene.unwrap_or(DEFAULT_SCENE)).map_err(ViewError::Scene)?;
    let viewport = egui::ViewportBuilder::default()
        .with_title("Pinspot")
        .with_app_id("pinspot")
        .with_inner_size([1240.0, 760.0])
        .with_min_inner_size([320.0, 240.0])
        .with_drag_and_drop(true);
    let mut options = eframe::NativeOptions { viewport, renderer: eframe::Renderer::Wgpu, ..Default::default() };
    if let egui_wgpu::WgpuSetup::CreateNew(setup) = &mut options.wgpu_options.wgpu_setup {
        ask_for_shared_device(setup, &choice);
    }
    let failed = Arc::new(Mutex::new(None));
    let closing = screenshot.map(|path| ClosingScreenshot { path, failed: failed.clone(), is_taken: false });
    let open = move |context: &eframe::CreationContext<'_>| {
        let viewer = Viewer::new(document, choice, context.egui_ctx.clone(), context.wgpu_render_state.clone());
        Ok(Box::new(Window { viewer, closing }) as Box<dyn eframe::App>)
    };
    check_display()?;
    eframe::run_native("pinspot", options, Box::new(open)).map_err(|e| ViewError::Window(e.to_string()))?;
    let failed = failed.lock().unwrap_or_else(PoisonError::into_inner).take();
    failed.map_or(Ok(()), |reason| Err(ViewError::Screenshot(reason)))
}

/// The window's device is to render previews, too: of the adapter that was asked for, and with what it can do.
fn ask_for_shared_device(setup: &mut egui_wgpu::WgpuSetupCreateNew, choice: &BackendChoice) {
    let for_window = setup.device_descriptor.clone();
    setup.device_descriptor = Arc::new(move |adapter| {
        if adapter.get_info().backend == wgpu::Backend::Gl {
            for_window(adapter)
        } else {
            Gpu::device_descriptor(adapter)
        }
    });
    if let BackendChoice::Gpu(Some(name)) = choice {
        let name = name.to_lowercase();
        setup.native_adapter_selector = Some(Arc::new(move |adapters, surface| {
            let draws = |adapter: &&wgpu::Adapter| surface.is_none_or(|surface| adapter.is_surface_supported(surface));
            let is_wanted = |adapter: &&wgpu::Adapter| adapter.get_info().name.to_lowercase().contains(&name);
            let usable = || adapters.iter().filter(draws);
            usable()
                .find(is_wanted)
                .or_else(|| usable().next())
                .cloned()
                .ok_or_else(|| "no adapter draws on it".to_owned())
        }));
    }
}

/// The window's device for rendering; `None` if it can only draw windows, or if it is not what a choice of a back end means: software
/// adapters render only if a GPU is asked for.
pub(super) fn shared_device(window: &egui_wgpu::RenderState, choice: &BackendChoice) -> Option<Gpu> {
    let adapter = Adapter::of(&window.adapter);
    let suits = match choice {
        BackendChoice::Auto => !adapter.software,
        BackendChoice::Cpu => false,
        BackendChoice::Gpu(name) => {
            name.as_ref().is_none_or(|name| adapter.name.to_lowercase().contains(&name.to_lowercase()))
        }
    };
    let draws_only = window.adapter.get_info().backend == wgpu::Backend::Gl;
    (suits && !draws_only).then(|| Gpu::of_device(&window.adapter, window.device.clone(), window.queue.clone()))
}

/// Refuses to open a window where there is nothing to show it on.
#[cfg(all(unix, not(target_os = "macos")))]
fn check_display() -> Result<(), ViewError> {
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if ["WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"].into_iter().any(is_set) {
        return Ok(());
    }
    Err(ViewError::Window("there is no display (neither WAYLAND_DISPLAY nor DISPLAY is set)".to_owned()))
}

/// Other systems always have a display.
#[cfg(not(all(unix, not(target_os = "macos"))))]
fn check_display() -> Result<(), ViewError> {
    Ok(())
}

/// The viewer as a native window.
struct Window {
    viewer: Viewer,
    closing: Option<ClosingScreenshot>,
}

/// A screenshot after which the window closes.
struct ClosingScreenshot {
    path: PathBuf,
    failed: Arc<Mutex<Option<String>>>,
    is_taken: bool,
}

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
        self.viewer.ui(ui);
        if let Some(closing) = self.closing.as_mut().filter(|_| self.viewer.is_finished()) {
            closing.take(ui.ctx());
        }
    }
}

impl ClosingScreenshot {
    fn take(&mut self, context: &egui::Context) {
        if std::mem::replace(&mut self.is_taken, true) {
            return;
        }
        let (path, failed, window) = (self.path.clone(), self.failed.clone(), context.clone());
        let write = move |shown: Arc<egui::ColorImage>| {
            if let Err(error) = write_png(&path, &loader::image_of(&shown)) {
                *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error.to_string());
            }
            window.send_viewport_cmd(egui::ViewportCommand::Close);
        };
        context.send_viewport_cmd(egui::ViewportCommand::Screenshot(egui::ScreenshotCallback::new(write)));
        context.request_repaint();
    }
}

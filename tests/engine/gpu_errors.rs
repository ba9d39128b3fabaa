//! What goes wrong on a GPU is said, not thrown.

use glam::Vec3;
use pinspot::blocking::wait;
use pinspot::low_level::environment::CubeMap;
use pinspot::low_level::gpu::{Gpu, GpuError};
use pinspot::low_level::pinhole::gpu::{
    Engine, EnvironmentCube, FrameInputs, FrameLight, GatherOptions, LightBoundsBuilder,
};
use pinspot::low_level::pinhole::{Footprint, Params, PinholeSample, Pinholes};
use pinspot::low_level::sampling::Strategy;
use pinspot::scene::Medium;
use pinspot::wgpu;
use pinspot::{Backend, NoProgress};

use crate::support::{floor, gpu, pinholes_of, scene};

/// An image of one sample.
fn inputs<'a>(
    receivers: &'a wgpu::TextureView,
    size: [u32; 2],
    pinholes: &'a Pinholes,
    environment: &'a EnvironmentCube,
) -> FrameInputs<'a> {
    FrameInputs {
        positions: receivers,
        normals: receivers,
        viewers: None,
        size,
        pinholes,
        maps: None,
        light: FrameLight::Environment(environment),
        params: Params::default(),
    }
}

#[test]
fn a_lost_device_is_an_error() {
    let gpu = wait(None, Gpu::open(None)).unwrap();
    gpu.device.destroy();
    let message = wait(Some(&gpu.device), gpu.submitted_work_done()).unwrap_err().to_string();
    assert!(message.contains("lost") && message.contains(&gpu.adapter.name), "{message}");
}

/// Pictures that a device has no memory for are rendered on the CPU.
#[test]
fn the_cpu_takes_over_where_memory_is_too_small() {
    let gpu = wait(None, Gpu::open(None)).unwrap();
    // The largest texture that may be asked for takes terabytes.
    let wgpu::Limits { max_texture_dimension_2d: edge, max_texture_array_layers: layers, .. } = gpu.device.limits();
    let largest = wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: edge, height: edge, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let _textures: Vec<_> =
        (0..1000).map(|_| gpu.device.create_texture(&largest)).take_while(|_| gpu.check().is_ok()).collect();
    assert!(matches!(gpu.check(), Err(GpuError::OutOfMemory { .. })));
    let (scene, options) = pinspot::load("mirror-sphere").unwrap();
    let mut engine = pinspot::Engine::new(scene, options.with_size([16, 16]).with_samples(50), Backend::gpu(gpu));
    let rendered = wait(None, engine.render(&NoProgress)).unwrap();
    assert!(rendered.layers[0].1.mean().x > 0.0);
    assert!(rendered.report.warnings.iter().any(|warning| warning.contains("too little memory")));
    assert_eq!(engine.backend().report(), Backend::cpu().report());
}

/// A device may be lost between any two calls.
#[test]
fn no_call_panics_on_a_lost_device() {
    let gpu = wait(None, Gpu::open(None)).unwrap();
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    let receivers = floor(1.0, 2);
    gpu.device.destroy();
    let environment = EnvironmentCube::upload(&gpu.device, &gpu.queue, &cube).unwrap();
    let view = gpu.upload_texture([2, 2], &receivers.positions);
    let pinholes = vec![PinholeSample::default()].into();
    let inputs = inputs(&view, [2, 2], &pinholes, &environment);
    let mut frame = Engine::new(&gpu.device, &GatherOptions::default()).frame(&gpu.device, &inputs).unwrap();
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    frame.record(&mut encoder, 0..frame.batch_count());
    gpu.queue.submit([encoder.finish()]);
    let message = wait(Some(&gpu.device), gpu.read_texture(frame.caustic())).unwrap_err().to_string();
    assert!(message.contains("lost"), "{message}");
}

#[test]
fn an_unknown_adapter_is_named_with_those_there_are() {
    let message = wait(None, Gpu::open(Some("voodoo"))).unwrap_err().to_string();
    assert!(message.contains("voodoo") && message.contains(&gpu().adapter.name), "{message}");
}

#[test]
fn too_large_a_texture_is_an_error() {
    let gpu = gpu();
    let receivers = floor(1.0, 2);
    let view = gpu.upload_texture([2, 2], &receivers.positions);
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    let environment = EnvironmentCube::upload(&gpu.device, &gpu.queue, &cube).unwrap();
    let engine = Engine::new(&gpu.device, &GatherOptions::default());
    let too_wide = gpu.adapter.max_texture + 1;
    let pinholes = vec![PinholeSample::default()].into();
    let inputs = inputs(&view, [too_wide, 1], &pinholes, &environment);
    let error = engine.frame(&gpu.device, &inputs).unwrap_err();
    assert!(matches!(error, GpuError::TextureTooLarge { .. }));
    let message = error.to_string();
    assert!(message.contains(&too_wide.to_string()) && message.contains("the image"), "{message}");
}

/// A shader that was compiled for mirrors alone would take water for one, and one for clear air see through fog.
#[test]
fn samples_that_refract_and_media_need_an_engine_for_them() {
    let gpu = gpu();
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    let environment = EnvironmentCube::upload(&gpu.device, &gpu.queue, &cube).unwrap();
    let view = gpu.upload_texture([2, 2], &floor(1.0, 2).positions);
    let water = scene("[[object]]\nshape = { plane = {} }\nrefractor = { eta = 1.333 }\n");
    let pinholes = pinholes_of(&water, 10, Strategy::Neighbourhood, Footprint::Cells, 1);
    let inputs = inputs(&view, [2, 2], &pinholes, &environment);
    let for_mirrors = Engine::new(&gpu.device, &GatherOptions::default());
    assert!(matches!(for_mirrors.frame(&gpu.device, &inputs), Err(GpuError::NoRefraction)));
    let for_water = Engine::new(&gpu.device, &GatherOptions { refraction: true, ..Default::default() });
    assert!(for_water.frame(&gpu.device, &inputs).is_ok());
    let fog = Medium { sigma_s: Vec3::ONE, sigma_a: Vec3::ZERO, g: 0.0 };
    let params = Params { medium: Some(fog), ..inputs.params };
    assert!(matches!(for_water.frame(&gpu.device, &FrameInputs { params, ..inputs }), Err(GpuError::NoMedium)));
}

/// What would be refused by the device, or worse, is refused before.
#[test]
fn images_and_cubes_that_are_impossible_are_errors() {
    let gpu = gpu();
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    let uploaded = EnvironmentCube::upload(&gpu.device, &gpu.queue, &cube).unwrap();
    let odd = EnvironmentCube::from_view(uploaded.view().clone(), 0, 1.0);
    assert!(matches!(LightBoundsBuilder::new(&gpu.device, &odd), Err(GpuError::CubeSize { size: 0 })));
    let view = gpu.upload_texture([2, 2], &[]);
    let pinholes = vec![PinholeSample::default()].into();
    let inputs = inputs(&view, [0, 1], &pinholes, &uploaded);
    let frame = Engine::new(&gpu.device, &GatherOptions::default()).frame(&gpu.device, &inputs);
    assert!(matches!(frame, Err(GpuError::EmptyImage { .. })));
}

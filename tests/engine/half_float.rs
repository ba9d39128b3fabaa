//! A device that has only what WebGPU promises: it filters half floats but not 32-bit ones, and blends neither.

use glam::Vec3;
use pinspot::low_level::environment::CubeMap;
use pinspot::low_level::pinhole::gpu::{Engine, EnvironmentCube, FrameInputs, FrameLight, GatherOptions};
use pinspot::low_level::pinhole::{Footprint, Params};
use pinspot::low_level::sampling::Strategy;
use pinspot::wgpu;
use wgpu::util::DeviceExt;

use crate::support::{floor, on_cpu, pinholes_of, rel_l2, scene};

#[test]
fn a_sun_beyond_half_floats_survives_on_a_plain_device() {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter =
        pollster::block_on(instance.request_adapter(&Default::default())).expect("run the tests by tests/run");
    // Default limits, no features.
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default())).unwrap();
    let sun = Vec3::new(0.3, 0.8, 0.5).normalize();
    let cube =
        CubeMap::from_radiance(128, None, |d| Vec3::splat(if d.dot(sun) > 0.999 { 5e6 } else { 0.5 + 0.4 * d.x }));
    let sphere = "[[object]]\nshape = { sphere = { radius = 0.5 } }\ntranslate = [0.0, 1.0, 0.0]\nreflector = {}\n";
    let pinholes = pinholes_of(&scene(sphere), 700, Strategy::Neighbourhood, Footprint::Cells, 1);
    let receivers = floor(2.0, 16);
    let params = Params::default();

    let environment = EnvironmentCube::upload(&device, &queue, &cube).unwrap();
    assert!(environment.radiance_scale() > 1.0);
    let [positions, normals] =
        [&receivers.positions, &receivers.normals].map(|texels| texture(&device, &queue, texels));
    let engine = Engine::new(&device, &GatherOptions::default());
    let inputs = FrameInputs {
        positions: &positions,
        normals: &normals,
        viewers: None,
        size: [16, 16],
        pinholes: &pinholes,
        maps: None,
        light: FrameLight::Environment(&environment),
        params,
    };
    let mut frame = engine.frame(&device, &inputs).unwrap();
    let mut encoder = device.create_command_encoder(&Default::default());
    frame.record(&mut encoder, 0..frame.batch_count());
    let got = read(&device, &queue, encoder, frame.caustic());
    let error = rel_l2(&got, &on_cpu(&receivers, &pinholes, &cube, &params));
    assert!(error < 1e-3, "{error}");
}

fn texture(device: &wgpu::Device, queue: &wgpu::Queue, texels: &[[f32; 4]]) -> wgpu::TextureView {
    let descriptor = wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: 16, height: 16, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    };
    let order = wgpu::util::TextureDataOrder::LayerMajor;
    device
        .create_texture_with_data(queue, &descriptor, order, bytemuck::cast_slice(texels))
        .create_view(&Default::default())
}

/// 16 texels of 16 bytes are one aligned row.
fn read(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    mut encoder: wgpu::CommandEncoder,
    texture: &wgpu::Texture,
) -> Vec<[f32; 4]> {
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 256 * 16,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(256), rows_per_image: None };
    let destination = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), destination, texture.size());
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    bytemuck::cast_slice(&buffer.get_mapped_range(..).unwrap()).to_vec()
}

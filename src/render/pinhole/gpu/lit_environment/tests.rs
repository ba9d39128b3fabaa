use super::*;
use crate::blocking::wait;
use crate::environment::{CubeSize, Environment, LightGeometry, LitBy};
use crate::gpu::Gpu;
use crate::scene::Light;
use crate::scene::shapes::{Plane, Shape, Sphere};
use crate::scene::{Mesh, Transform};
use crate::tracing::{SeenBy, Tracer};

const SIZE: u32 = 64;

fn texels(gpu: &Gpu, lit: &LitEnvironment, level: u32) -> Vec<Vec4> {
    let size = SIZE >> level;
    let (row, wide) = (16 * size, lit.pipelines.format == TextureFormat::Rgba32Float);
    assert!(wide, "lavapipe and all hardware of today filter 32-bit textures");
    let stride = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let texture = lit.cube.view().texture();
    let bytes = u64::from(stride * size) * FACES as u64;
    let buffer = gpu.read_back_buffer(bytes);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: Some(size) };
    let extent = wgpu::Extent3d { width: size, height: size, depth_or_array_layers: FACES as u32 };
    let from = wgpu::TexelCopyTextureInfo { mip_level: level, ..texture.as_image_copy() };
    encoder.copy_texture_to_buffer(from, wgpu::TexelCopyBufferInfo { buffer: &buffer, layout }, extent);
    gpu.queue.submit([encoder.finish()]);
    let bytes = wait(Some(&gpu.device), gpu.read_mapped(buffer)).unwrap();
    let rows = bytes.chunks_exact(stride as usize).map(|bytes| &bytes[..row as usize]);
    rows.flat_map(bytemuck::pod_collect_to_vec::<_, Vec4>).collect()
}

/// Both draw what is nearest, with the same mips; twice, as in frames that follow each other.
#[test]
fn both_back_ends_draw_the_same_emitters() {
    let gpu = wait(None, Gpu::open(None)).unwrap();
    let ball = Arc::new(Shape::Sphere(Sphere::of_radius(1.0)).mesh().unwrap());
    let plate = Arc::new(Shape::Plane(Plane { size: [3.0, 5.0] }).mesh().unwrap());
    let light = Light::Spot { direction: Vec3::Y, sigma_rad: 0.4, radiance: Vec3::new(0.0, 0.0, 3.0) };
    let sky = Environment::new(&light, CubeSize::Texels(SIZE)).unwrap();
    let background = Arc::new(EnvironmentCube::upload(&gpu.device, &gpu.queue, &sky.cube).unwrap());
    let pipelines = Arc::new(LitPipelines::new(&gpu.device));
    let mut lit = LitEnvironment::new(&gpu.device, pipelines, background);
    for (turn, centre) in [(0.0, Vec3::ZERO), (0.7, Vec3::new(0.2, 0.3, -0.1))] {
        let emitter = |mesh: &Arc<Mesh>, scale, place: [f32; 3], radiance: [f32; 3]| PlacedEmitter {
            mesh: mesh.clone(),
            placement: Transform { scale, translate: Vec3::from_array(place), rotate_rad: Vec3::new(turn, 0.3, -turn) },
            radiance: Vec3::from_array(radiance),
        };
        let emitters = [
            emitter(&ball, 1.5, [0.3, 6.0, 0.4], [0.0, 4.0, 0.0]),
            emitter(&ball, 0.5, [0.4, 2.0, 0.5], [3.0, 0.0, 0.0]),
            emitter(&plate, 1.0, [0.0, -1.0, 0.5], [1.0, 1.0, 1.0]),
        ];
        let view = CubeView { centre, rotation_rad: 0.4 + turn, intensity: 2.0 };
        lit.update((&gpu.device, &gpu.queue), &emitters, view);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        lit.record(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
        let expected = on_cpu(&sky, &emitters, view);
        for level in 0..=SIZE.ilog2() {
            let (found, expected) = (texels(&gpu, &lit, level), expected.cube.level(level));
            assert_eq!(found.len(), expected.len());
            let differences = found.iter().zip(&expected).map(|(a, b)| (*a - *b).abs().max_element());
            let mean = differences.sum::<f32>() / found.len() as f32;
            // The CPU tests sixteen points along a texel's edge.
            assert!(mean < 0.01, "level {level}: {mean}");
        }
    }
    gpu.check().unwrap();
}

fn on_cpu(sky: &Environment, emitters: &[PlacedEmitter], view: CubeView) -> Environment {
    let meshes: Vec<Mesh> = emitters.iter().map(|e| e.mesh.placed(&e.placement, "emitter").unwrap().0).collect();
    let seen_by = SeenBy { camera: true, light: false, mirrored: false };
    let tracer = Tracer::of_emitters(None, meshes.iter().map(|mesh| (mesh, seen_by)));
    let shining = (0..).zip(&meshes).zip(emitters).map(|((object, mesh), e)| (object, mesh, e.radiance));
    let geometry = LightGeometry::new(&shining.collect::<Vec<_>>(), Arc::new(tracer), view.centre);
    let CubeView { rotation_rad, intensity, .. } = view;
    sky.behind(LitBy { geometry: Arc::new(geometry), rotation_rad, intensity })
}

// What objects do to photons. Layout: src/render/image_space/gpu/layout.rs.

#import constants

struct PhotonSurface {
    // Relative refractive indices; 0 of mirrors.
    eta: vec3f,
    // REFLECTS_IN_FRONT and so on.
    flags: u32,
    // Of receivers, where what photons reflect has to be known.
    albedo: vec3f,
    // MATERIAL_PHONG or MATERIAL_GGX, else Lambertian.
    kind: u32,
    specular: vec3f,
    // Phong's exponent, or GGX's α.
    width: f32,
    // The number of its curve of reflectance.
    curve: u32,
}

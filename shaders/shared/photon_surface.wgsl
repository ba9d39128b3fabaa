// What objects do to photons. Layout: src/image_space/gpu/layout.rs.

#import constants

struct PhotonSurface {
    // Relative refractive indices; 0 of mirrors.
    eta: vec3f,
    // REFLECTS_IN_FRONT and so on.
    flags: u32,
    // The number of its curve of reflectance.
    curve: u32,
}

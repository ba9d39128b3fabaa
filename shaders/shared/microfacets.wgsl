// Terms of the BRDF of surfaces of microfacets. CPU twin: src/base/brdf/mod.rs.

#import constants

const PI: f32 = 3.14159265;

// A lobe over a diffuse part, 1/sr: of Phong, with the exponent `width`, or GGX, with α; otherwise Lambertian. n, l and v are the unit normal,
// towards the light and towards the viewer.
fn lobe_brdf(kind: u32, albedo: vec3f, specular: vec3f, width: f32, n: vec3f, l: vec3f, v: vec3f) -> vec3f {
    let cos_l = dot(n, l);
    let cos_v = dot(n, v);
    if cos_l <= 0.0 || cos_v <= 0.0 {
        return vec3f(0.0);
    }
    let diffuse = albedo / PI;
    if kind == MATERIAL_PHONG {
        let mirrored = max(dot(2.0 * cos_l * n - l, v), 0.0);
        // pow(0, 0) is implementation-defined.
        let lobe = select(0.0, pow(max(mirrored, 1e-30), width), mirrored > 0.0 || width == 0.0);
        return diffuse + specular * ((width + 2.0) / (2.0 * PI) * lobe);
    }
    if kind == MATERIAL_GGX {
        let h = normalize(l + v);
        let lobe = distribution(dot(n, h), width) * masking(cos_l, cos_v, width);
        let passes = (1.0 - schlick(specular, cos_l)) * (1.0 - schlick(specular, cos_v));
        return diffuse * passes + schlick(specular, dot(l, h)) * lobe;
    }
    return diffuse;
}

fn schlick(specular: vec3f, cosine: f32) -> vec3f {
    let c = 1.0 - saturate(cosine);
    return specular + (1.0 - specular) * (c * c * c * c * c);
}

fn distribution(cosine: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let bump = cosine * cosine * (a2 - 1.0) + 1.0;
    return a2 / (PI * bump * bump);
}

fn masking(cos_l: f32, cos_v: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let part = cos_l * sqrt(cos_v * cos_v * (1.0 - a2) + a2) + cos_v * sqrt(cos_l * cos_l * (1.0 - a2) + a2);
    return 0.5 / max(part, 1e-9);
}

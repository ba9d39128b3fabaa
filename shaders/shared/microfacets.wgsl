// Terms of the BRDF of surfaces of microfacets. CPU twin: src/brdf/mod.rs.

const PI: f32 = 3.14159265;

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

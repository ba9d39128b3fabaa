//! The objects of a scene file: placements, meshes and materials.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use serde::Deserialize;

use super::{Builder, Key, one};
use crate::brdf::{BrdfTable, Gloss, LEAST_ROUGHNESS, TableError};
use crate::reflectance::{Finish, Metal};
use crate::scene::assets::readable_name;
use crate::scene::closed::check_closed;
use crate::scene::shapes::Shape;
use crate::scene::wavefront::{ObjPart, ObjParts, Surface, load_obj, load_obj_by_material};
use crate::scene::{
    Emitter, Interfaces, MAX_RADIANCE, Mesh, Object, Receiver, Reflector, Refractor, SceneError, Sides, Transform,
};
use crate::words::escaped;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ObjectTable {
    name: Option<String>,
    mesh: Option<String>,
    shape: Option<Shape>,
    #[serde(default)]
    translate: [f64; 3],
    #[serde(default)]
    rotate_deg: [f32; 3],
    #[serde(default = "one")]
    scale: f32,
    crease_angle_deg: Option<f32>,
    sides: Option<Sides>,
    reflector: Option<ReflectorTable>,
    refractor: Option<RefractorTable>,
    receiver: Option<ReceiverTable>,
    emitter: Option<EmitterTable>,
    #[serde(default = "yes")]
    camera_visible: bool,
}

/// What an animation needs to know of the objects that one table makes.
pub(super) struct Animated {
    /// The table's name.
    pub name: Option<String>,
    /// The objects' indices in the scene.
    pub objects: Range<usize>,
    /// The shape, if it is one.
    pub shape: Option<Shape>,
    /// Whether its mesh is so far from its origin that it is placed in double precision, once and for all.
    pub is_far: bool,
}

impl ObjectTable {
    pub fn animated(&self, objects: Range<usize>, is_far: bool) -> Animated {
        Animated { name: self.name.clone(), objects, shape: self.shape, is_far }
    }

    /// Whether, as an emitter, it does not say whether it is near.
    pub fn leaves_nearness_open(&self) -> bool {
        self.emitter.as_ref().is_none_or(|emitter| emitter.near.is_none())
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReflectorTable {
    #[serde(default)]
    sides: Sides,
    #[serde(default = "white")]
    reflectance: [f32; 3],
    metal: Option<Metal>,
    coat: Option<f64>,
    #[serde(default)]
    roughness: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RefractorTable {
    eta: Option<Indices>,
    cauchy: Option<[f64; 2]>,
    interfaces: Option<u32>,
    #[serde(default = "yes")]
    fresnel: bool,
}

/// One refractive index, or one for each channel.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged, expecting = "expected a number, or three for red, green and blue")]
enum Indices {
    One(f64),
    PerChannel([f64; 3]),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReceiverTable {
    #[serde(default = "grey")]
    albedo: [f32; 3],
    phong: Option<PhongTable>,
    ggx: Option<GgxTable>,
    table: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EmitterTable {
    radiance: [f32; 3],
    near: Option<bool>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PhongTable {
    specular: [f32; 3],
    exponent: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GgxTable {
    #[serde(default = "plastic")]
    specular: [f32; 3],
    roughness: f32,
}

fn grey() -> [f32; 3] {
    [0.5; 3]
}
/// Reflectance of a refractive index of 1.5.
fn plastic() -> [f32; 3] {
    [0.04; 3]
}

fn white() -> [f32; 3] {
    [1.0; 3]
}
fn yes() -> bool {
    true
}
/// Default crease angle of meshes without normals.
pub(super) const CREASE_ANGLE_DEG: f32 = 40.0;

fn crease_angle_rad(table: &ObjectTable) -> f32 {
    table.crease_angle_deg.unwrap_or(CREASE_ANGLE_DEG).to_radians()
}

fn note_dropped(origin: &str, triangles: usize, notes: &mut Vec<String>) {
    if triangles > 0 {
        notes.push(format!("{}: dropped {triangles} degenerate triangles", escaped(origin)));
    }
}

/// The placement of a mesh whose positions count from somewhere far away; the translation is as the file gives it, metres.
fn placed_from(origin: DVec3, placement: Transform, translate: [f64; 3]) -> Transform {
    if origin == DVec3::ZERO {
        return placement;
    }
    let [x, y, z] = placement.rotate_rad.as_dvec3().to_array();
    let rotation = DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
    let translate = rotation * (f64::from(placement.scale) * origin) + DVec3::from(translate);
    Transform { translate: translate.as_vec3(), ..placement }
}

impl Builder<'_> {
    /// An object, or one per material of a mesh that has its own materials, and whether it is far from its origin.
    pub(super) fn objects(
        &self,
        index: usize,
        table: &ObjectTable,
        notes: &mut Vec<String>,
    ) -> Result<(Vec<Object>, bool), SceneError> {
        let name = table.name.as_ref().map_or_else(|| format!("object {}", index + 1), |name| escaped(name));
        let key = |k: &str| Key { shown: format!("object '{name}'.{k}"), path: format!("object.{index}.{k}") };
        if !(table.scale.is_finite() && table.scale != 0.0) {
            return Err(self.error(key("scale"), format!("is {}, but must be a number other than zero", table.scale)));
        }
        if table.crease_angle_deg.is_some_and(|angle| !(0.0..=180.0).contains(&angle)) {
            return Err(self.error(key("crease_angle_deg"), "must be from 0 to 180"));
        }
        let placement = Transform {
            scale: table.scale,
            rotate_rad: self.vector(key("rotate_deg"), table.rotate_deg)? * (std::f32::consts::PI / 180.0),
            translate: self.vector(key("translate"), table.translate.map(|metres| metres as f32))?,
        };
        let reflector = match &table.reflector {
            None => None,
            Some(r) => Some(Reflector { sides: r.sides, finish: self.finish(r, &key)? }),
        };
        let receiver = match &table.receiver {
            None => None,
            Some(r) => Some(self.receiver(r, &key)?),
        };
        let refractor = match &table.refractor {
            None => None,
            Some(_) if reflector.is_some() || receiver.is_some() => {
                let message =
                    "is neither reflector nor receiver: light passes through it; give them an object of their own";
                return Err(self.error(key("refractor"), message));
            }
            Some(r) => Some(self.refractor(r, &key)?),
        };
        let emitter = match &table.emitter {
            None => None,
            Some(_) if reflector.is_some() || refractor.is_some() || receiver.is_some() => {
                let message = "is neither reflector, refractor nor receiver: give the light an object of its own";
                return Err(self.error(key("emitter"), message));
            }
            Some(e) => {
                let radiance = self.colour(key("emitter.radiance"), e.radiance, MAX_RADIANCE)?;
                Some(Emitter { radiance, is_near: e.near.unwrap_or(false) })
            }
        };
        let camera_visible = table.camera_visible;
        let has_material = reflector.is_some() || refractor.is_some() || receiver.is_some() || emitter.is_some();
        if let (Some(file), None, false) = (&table.mesh, table.shape, has_material) {
            let ObjParts { parts, origin, notes: of_materials, undefined_materials } =
                load_obj_by_material(self.assets, Path::new(file), crease_angle_rad(table))?;
            notes.extend(of_materials);
            let placement = placed_from(origin, placement, table.translate);
            if undefined_materials > 0 {
                let file = readable_name(self.assets, Path::new(file));
                notes.push(format!(
                    "{file}: its faces name {undefined_materials} materials, but it names no material library (mtllib); \
                     they have no effect"
                ));
            }
            let object = |part: ObjPart| {
                let file = readable_name(self.assets, Path::new(file));
                let name = if part.material.is_empty() { name.clone() } else { format!("{name}/{}", part.material) };
                let Surface { mut reflector, mut refractor, receiver, emitter } = part.surface;
                let is_closed = || check_closed(&part.mesh).is_ok();
                if let Some(reflector) = &mut reflector {
                    // The inside of a solid is dark.
                    let own = || if is_closed() { Sides::Front } else { reflector.sides };
                    reflector.sides = table.sides.unwrap_or_else(own);
                }
                if let Some(refractor) = &mut refractor {
                    refractor.interfaces = if is_closed() { Interfaces::Two } else { Interfaces::One };
                }
                let mesh = Arc::new(part.mesh);
                let mut object = Object::new(name, mesh);
                (object.placement, object.camera_visible) = (placement, camera_visible);
                (object.reflector, object.refractor) = (reflector, refractor);
                (object.receiver, object.emitter) = (receiver, emitter);
                note_dropped(&file, part.report.dropped_triangles + object.checked_mesh_in_world()?.1, notes);
                Ok(object)
            };
            return Ok((parts.into_iter().map(object).collect::<Result<_, SceneError>>()?, origin != DVec3::ZERO));
        }
        if table.sides.is_some() {
            let message = "is for the mirrors among a mesh's own materials; give reflector = { sides = … } its sides";
            return Err(self.error(key("sides"), message));
        }
        let (mesh, dropped, origin) = self.mesh(table, &key)?;
        let placement = placed_from(origin, placement, table.translate);
        let mesh = Arc::new(mesh);
        let object =
            Object { name: name.clone(), mesh, placement, reflector, refractor, receiver, emitter, camera_visible };
        let (_, lost) = object.checked_mesh_in_world()?;
        if object.has_interfaces(Interfaces::Two) {
            let refuse =
                |reason| format!("is 2, but the mesh is not closed: {reason}; close it, or give interfaces = 1");
            check_closed(&object.mesh).map_err(|reason| self.error(key("refractor.interfaces"), refuse(reason)))?;
        }
        note_dropped(table.mesh.as_deref().unwrap_or(&object.name), dropped + lost, notes);
        Ok((vec![object], origin != DVec3::ZERO))
    }

    fn receiver(&self, table: &ReceiverTable, key: &dyn Fn(&str) -> Key) -> Result<Receiver, SceneError> {
        let gloss = match (&table.phong, &table.ggx, &table.table) {
            (None, None, None) => Gloss::None,
            (Some(phong), None, None) => {
                if !(0.0..=1e5).contains(&phong.exponent) {
                    return Err(self.error(key("receiver.phong.exponent"), "must be from 0 to 100000"));
                }
                let specular = self.colour(key("receiver.phong.specular"), phong.specular, 1.0)?;
                Gloss::Phong { specular, exponent: phong.exponent }
            }
            (None, Some(ggx), None) => {
                if !(LEAST_ROUGHNESS..=1.0).contains(&ggx.roughness) {
                    let message = format!("must be from {LEAST_ROUGHNESS} to 1; a smoother one is a reflector");
                    return Err(self.error(key("receiver.ggx.roughness"), message));
                }
                let specular = self.colour(key("receiver.ggx.specular"), ggx.specular, 1.0)?;
                Gloss::Ggx { specular, roughness: ggx.roughness }
            }
            (None, None, Some(file)) => Gloss::Table(Arc::new(self.table(file)?)),
            _ => return Err(self.error(key("receiver"), "give at most one of phong, ggx and table")),
        };
        Ok(Receiver { albedo: self.colour(key("receiver.albedo"), table.albedo, 1.0)?, gloss })
    }

    fn table(&self, file: &str) -> Result<BrdfTable, SceneError> {
        let name = readable_name(self.assets, Path::new(file));
        let fail = |error: std::io::Error| TableError::Read { file: name.clone(), reason: error.to_string() };
        let bytes = self.assets.read(Path::new(file)).map_err(fail)?;
        Ok(BrdfTable::decode(&name, &bytes)?)
    }

    fn finish(&self, table: &ReflectorTable, key: &dyn Fn(&str) -> Key) -> Result<Finish, SceneError> {
        if table.coat.is_some_and(|index| !(1.0..=4.0).contains(&index)) {
            return Err(self.error(key("reflector.coat"), "must be a refractive index from 1 to 4"));
        }
        let reflectance = self.colour(key("reflector.reflectance"), table.reflectance, 1.0)?.as_dvec3();
        if !(0.0..=1.0).contains(&table.roughness) {
            return Err(self.error(key("reflector.roughness"), "must be from 0 to 1"));
        }
        Ok(Finish { reflectance, metal: table.metal, coat: table.coat, roughness: table.roughness })
    }

    fn refractor(&self, table: &RefractorTable, key: &dyn Fn(&str) -> Key) -> Result<Refractor, SceneError> {
        let interfaces = match table.interfaces {
            None | Some(1) => Interfaces::One,
            Some(2) => Interfaces::Two,
            Some(_) => {
                let message =
                    "must be 1, for the surface of water or one face of a lens, or 2, for a closed object of glass";
                return Err(self.error(key("refractor.interfaces"), message));
            }
        };
        let (eta, given) = match (table.eta, table.cauchy) {
            (Some(Indices::One(eta)), None) => (DVec3::splat(eta), "eta"),
            (Some(Indices::PerChannel(eta)), None) => (eta.into(), "eta"),
            (None, Some([a, b])) => (Refractor::cauchy(a, b), "cauchy"),
            _ => {
                let message = "give either eta = 1.333 (or three indices, for red, green and blue) or cauchy = [a, b]";
                return Err(self.error(key("refractor"), message));
            }
        };
        if let Some(index) = eta.to_array().iter().find(|index| !Refractor::INDICES.contains(*index)) {
            let (least, most) = Refractor::INDICES.into_inner();
            let message = format!(
                "gives a refractive index of {index}, but it must be from {least} to {most}: that behind the surface over that in front of it"
            );
            return Err(self.error(key(&format!("refractor.{given}")), message));
        }
        Ok(Refractor { eta, fresnel: table.fresnel, interfaces })
    }

    /// An object's mesh, the number of dropped degenerate triangles, and what its positions count from, metres.
    fn mesh(&self, table: &ObjectTable, key: &dyn Fn(&str) -> Key) -> Result<(Mesh, usize, DVec3), SceneError> {
        match (&table.mesh, table.shape) {
            (Some(file), None) => {
                let (mesh, report, origin) = load_obj(self.assets, Path::new(file), crease_angle_rad(table))?;
                Ok((mesh, report.dropped_triangles, origin))
            }
            (None, Some(_)) if table.crease_angle_deg.is_some() => {
                Err(self.error(key("crease_angle_deg"), "is for meshes; built-in shapes have exact normals"))
            }
            (None, Some(shape)) => {
                let mesh = shape.mesh().map_err(|message| self.error(key("shape"), message))?;
                Ok((mesh, 0, DVec3::ZERO))
            }
            (given, _) => {
                let key = key(if given.is_some() { "mesh" } else { "name" });
                Err(self.error(key, "give exactly one of mesh = \"FILE.obj\" and shape = { … }"))
            }
        }
    }
}

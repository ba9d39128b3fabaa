//! The `[camera]` table of a scene file.

use glam::Vec3;
use serde::Deserialize;

use super::{Builder, Key};
use crate::scene::{Camera, Mesh, Projection, SceneError};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraTable {
    pub position: [f32; 3],
    pub target: [f32; 3],
    #[serde(default = "up")]
    pub up: [f32; 3],
    orthographic: Option<OrthographicTable>,
    perspective: Option<PerspectiveTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OrthographicTable {
    height: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PerspectiveTable {
    fov_y_deg: f32,
}

fn up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

impl Builder<'_> {
    pub(super) fn camera(&self, table: &CameraTable) -> Result<Camera, SceneError> {
        let position = self.place("camera.position", table.position)?;
        let target = self.place("camera.target", table.target)?;
        let up = self.vector("camera.up", table.up)?;
        let projection = match (&table.orthographic, &table.perspective) {
            (Some(o), None) if o.height > 0.0 && o.height <= Mesh::MAX_COORDINATE => {
                Projection::Orthographic { height: o.height }
            }
            (Some(o), None) => {
                return Err(self.error(
                    "camera.orthographic.height",
                    format!("is {}, but must be a positive length of at most 1e9", o.height),
                ));
            }
            (None, Some(p)) if p.fov_y_deg > 0.0 && p.fov_y_deg < 180.0 => {
                Projection::Perspective { fov_y_rad: p.fov_y_deg.to_radians() }
            }
            (None, Some(p)) => {
                return Err(self.error(
                    "camera.perspective.fov_y_deg",
                    format!("is {}, but must be between 0 and 180", p.fov_y_deg),
                ));
            }
            _ => {
                return Err(self.error(
                    "camera",
                    "give exactly one of orthographic = { height = … } and perspective = { fov_y_deg = … }",
                ));
            }
        };
        Camera::look_at(position, target, up, projection).ok_or_else(|| {
            self.error("camera", "position and target must differ, and up must not be along the view axis")
        })
    }

    pub fn place(&self, key: impl Into<Key>, value: [f32; 3]) -> Result<Vec3, SceneError> {
        let key = key.into();
        let value = self.vector(key.clone(), value)?;
        if value.abs().max_element() <= Mesh::MAX_COORDINATE {
            Ok(value)
        } else {
            Err(self.error(key, "must be at most 1e9 m from the origin"))
        }
    }
}

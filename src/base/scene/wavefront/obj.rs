//! Checks the statements of an OBJ file, so that errors have lines and `tobj` gets valid input only.

use std::fmt::Write;
use std::str::FromStr;

use glam::DVec3;

use super::text::{Statement, decoded, statements};
use crate::scene::MeshError;
use crate::words::escaped;

/// An OBJ file's text in a form that `tobj` always reads: vertices first, then faces with absolute indices.
pub(super) struct Checked {
    pub vertices: String,
    pub faces: String,
    /// What the vertices count from, metres: zero, or the middle of vertices so far away that 32-bit numbers would round them.
    pub origin: DVec3,
    /// Lines and file names of its material libraries.
    pub libraries: Vec<(usize, String)>,
    /// Lines and names of the materials in use, each once.
    pub materials: Vec<(usize, String)>,
}

/// Checks a file's statements; `name` is used in messages.
pub(super) fn check(name: &str, bytes: &[u8]) -> Result<Checked, MeshError> {
    let text = decoded(bytes);
    let mut checker = Checker::default();
    for statement in statements(&text) {
        let line = statement.line;
        let fail = |reason: String| MeshError::Statement { file: name.into(), line, reason: escaped(&reason) };
        checker.statement(&statement).map_err(fail)?;
    }
    checker.finished().map_err(|(line, reason)| MeshError::Statement { file: name.into(), line, reason })
}

/// A corner of a face: absolute indices from 1 of its position and its normal, if it has one.
type Corner = (usize, Option<usize>);

enum FaceStatement {
    Face { line: usize, corners: std::ops::Range<usize> },
    Material(usize),
}

#[derive(Default)]
struct Checker {
    positions: Vec<DVec3>,
    normals: usize,
    vertices: String,
    corners: Vec<Corner>,
    faces: Vec<FaceStatement>,
    libraries: Vec<(usize, String)>,
    materials: Vec<(usize, String)>,
}

impl Checker {
    fn statement(&mut self, statement: &Statement) -> Result<(), String> {
        match statement.keyword() {
            "v" => self.position(statement),
            "vn" => self.normal(statement),
            "f" | "fo" => self.face(statement),
            "usemtl" => {
                self.use_material(statement);
                Ok(())
            }
            "mtllib" => {
                self.libraries.push((statement.line, statement.rest().to_owned()));
                Ok(())
            }
            // Ignored: texture coordinates, groups, lines, free-form surfaces.
            _ => Ok(()),
        }
    }

    fn position(&mut self, statement: &Statement) -> Result<(), String> {
        let numbers = finite::<f64>(statement, "position")?;
        if numbers.iter().any(|number| !(*number as f32).is_finite()) {
            return Err("the position has a number that is not finite".into());
        }
        let used = match numbers.len() {
            // A fourth number is a weight, to divide by; colours are ignored.
            4 if numbers[3] != 0.0 => 4,
            3 | 6.. => 3,
            4 => return Err("the weight of a vertex must not be zero".into()),
            count => return Err(format!("a vertex has 3 coordinates, but here are {count}")),
        };
        let weight = if used == 4 { numbers[3] } else { 1.0 };
        self.positions.push(DVec3::new(numbers[0], numbers[1], numbers[2]) / weight);
        write_vertex(&mut self.vertices, "v", statement, used);
        Ok(())
    }

    fn normal(&mut self, statement: &Statement) -> Result<(), String> {
        let count = finite::<f32>(statement, "normal")?.len();
        if count != 3 {
            return Err(format!("a normal has 3 components, but here are {count}"));
        }
        self.normals += 1;
        write_vertex(&mut self.vertices, "vn", statement, 3);
        Ok(())
    }

    fn face(&mut self, statement: &Statement) -> Result<(), String> {
        let start = self.corners.len();
        for word in statement.words() {
            let corner = self.corner(word)?;
            self.corners.push(corner);
        }
        let corners = start..self.corners.len();
        if corners.len() < 3 {
            let reason = "a face has three corners or more, but here are {}; the file may be truncated";
            return Err(reason.replace("{}", &corners.len().to_string()));
        }
        self.faces.push(FaceStatement::Face { line: statement.line, corners });
        Ok(())
    }

    /// `position`, `position/texture`, `position//normal` or `position/texture/normal`.
    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut parts = word.split('/');
        let position = absolute(parts.next().unwrap_or_default(), self.positions.len(), word)?;
        let normal = match (parts.next(), parts.next(), parts.next()) {
            (_, Some("") | None, None) => None,
            (_, Some(normal), None) => Some(absolute(normal, self.normals, word)?),
            _ => return Err(format!("'{word}' is not a corner of a face")),
        };
        Ok((position, normal))
    }

    fn use_material(&mut self, statement: &Statement) {
        let known = self.materials.iter().position(|(_, name)| name == statement.rest());
        let index = known.unwrap_or_else(|| {
            self.materials.push((statement.line, statement.rest().to_owned()));
            self.materials.len() - 1
        });
        self.faces.push(FaceStatement::Material(index));
    }

    fn finished(self) -> Result<Checked, (usize, String)> {
        // If some corners have no normal, all normals are ignored.
        let with_normals = self.corners.iter().all(|(_, normal)| normal.is_some());
        let mut faces = String::new();
        for face in &self.faces {
            let (line, corners) = match face {
                FaceStatement::Face { line, corners } => (*line, &self.corners[corners.clone()]),
                FaceStatement::Material(index) => {
                    // By number, as names may contain anything.
                    let _ = writeln!(faces, "usemtl {index}");
                    continue;
                }
            };
            faces.push('f');
            for &(position, normal) in corners {
                let missing = |what: &str, index: usize, count: usize| {
                    let reason =
                        format!("the face names {what} {index}, but the file has {count}; it may be truncated");
                    Err((line, reason))
                };
                match normal {
                    _ if position > self.positions.len() => return missing("vertex", position, self.positions.len()),
                    Some(normal) if normal > self.normals => return missing("normal", normal, self.normals),
                    Some(normal) if with_normals => drop(write!(faces, " {position}//{normal}")),
                    _ => drop(write!(faces, " {position}")),
                }
            }
            faces.push('\n');
        }
        let origin = far_origin(&self.positions);
        let mut vertices = self.vertices;
        if origin != DVec3::ZERO {
            let normals: Vec<&str> = vertices.lines().filter(|line| line.starts_with("vn")).collect();
            let mut moved = String::new();
            for position in &self.positions {
                let DVec3 { x, y, z } = position - origin;
                let _ = writeln!(moved, "v {x} {y} {z}");
            }
            moved.push_str(&normals.join("\n"));
            moved.push('\n');
            vertices = moved;
        }
        Ok(Checked { vertices, faces, origin, libraries: self.libraries, materials: self.materials })
    }
}

/// From so many times their extent on, places are kept relative to the middle of all.
const FAR: f64 = 5000.0;

/// The middle of places that are far from the origin for their extent; else zero.
fn far_origin(positions: &[DVec3]) -> DVec3 {
    let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let middle = 0.5 * (low + high);
    let extent = (high - low).max_element();
    if extent > 0.0 && middle.abs().max_element() > FAR * extent { middle } else { DVec3::ZERO }
}

fn finite<N: FromStr + Into<f64> + Copy>(statement: &Statement, what: &str) -> Result<Vec<N>, String> {
    let numbers: Vec<N> = statement.numbers()?;
    match numbers.iter().find(|number| !(**number).into().is_finite()) {
        Some(_) => Err(format!("the {what} has a number that is not finite")),
        None => Ok(numbers),
    }
}

fn write_vertex(out: &mut String, keyword: &str, statement: &Statement, count: usize) {
    out.push_str(keyword);
    for word in statement.words().take(count) {
        out.push(' ');
        out.push_str(word);
    }
    out.push('\n');
}

/// An index from 1; negative ones count from the last of `count`.
fn absolute(index: &str, count: usize, word: &str) -> Result<usize, String> {
    let number = index.parse::<i64>().map_err(|_| format!("'{word}' is not a corner of a face"))?;
    match usize::try_from(number) {
        Ok(0) => Err(format!("'{word}' has the index 0, but indices count from 1")),
        Ok(index) => Ok(index),
        Err(_) => usize::try_from(number.unsigned_abs())
            .ok()
            .filter(|back| *back <= count)
            .map(|back| count + 1 - back)
            .ok_or_else(|| format!("'{word}' counts back beyond the first of {count}")),
    }
}

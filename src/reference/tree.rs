//! All that mirrors, as a tree: each object's triangles, halved by place and direction, with bounds of their points and
//! normals. It knows neither receivers nor light.

use glam::DVec3;

use super::cone::Cone;
use super::geometry::{Geometry, Triangle};

/// One tree per object that mirrors, in one array; `roots` are their nodes.
pub(super) struct Tree {
    pub nodes: Vec<Node>,
    pub roots: Vec<u32>,
}

pub(super) struct Node {
    pub bounds: Bounds,
    /// An inner node's children are the next node and this one.
    pub content: Content,
}

#[derive(Clone, Copy)]
pub(super) enum Content {
    Inner { second: u32 },
    Triangle(u32),
}

/// A sphere around the points of a region, a cone around its normals, and its area; m and m².
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    pub centre: DVec3,
    pub radius: f64,
    pub normals: Cone,
    pub area: f64,
    pub object: u32,
}

/// The corners of a part of a triangle, barycentric.
pub(super) type Part = [[f64; 3]; 3];

pub(super) const WHOLE: Part = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// A triangle on its way into the tree.
struct Item {
    id: u32,
    place: [f64; 6],
}

impl Tree {
    /// `sides`: for each object that mirrors, −1 where its back does, else 1.
    pub fn new(geometry: &Geometry, sides: &[Option<f64>]) -> Self {
        let mut builder = Builder { geometry, sides, nodes: Vec::new() };
        let objects = (0..sides.len() as u32).filter(|o| sides[*o as usize].is_some());
        let roots = objects.map(|object| builder.add_object(object)).collect();
        Self { nodes: builder.nodes, roots }
    }
}

struct Builder<'a> {
    geometry: &'a Geometry,
    sides: &'a [Option<f64>],
    nodes: Vec<Node>,
}

impl Builder<'_> {
    fn add_object(&mut self, object: u32) -> u32 {
        let all = &self.geometry.triangles;
        let own = (0..all.len() as u32).filter(|t| all[*t as usize].object == object);
        let mut own: Vec<Item> = own.map(|id| self.item(id)).collect();
        let corners = || own.iter().flat_map(|i| all[i.id as usize].corners);
        let (low, high) =
            (corners().fold(DVec3::INFINITY, DVec3::min), corners().fold(DVec3::NEG_INFINITY, DVec3::max));
        let diagonal = low.distance(high);
        for item in &mut own {
            item.place[..3].iter_mut().for_each(|p| *p /= diagonal);
        }
        let root = self.nodes.len() as u32;
        self.add_node(&mut own);
        root
    }

    /// A triangle as the tree sorts it: where it is, in diagonals of its object, and where it looks. Angles between
    /// directions matter about as much as differences of normals, so both count alike, and the two sheets of a thin wall
    /// part early.
    fn item(&self, id: u32) -> Item {
        let triangle = &self.geometry.triangles[id as usize];
        let third = [1.0 / 3.0; 3];
        let (position, normal) = (triangle.position(third), triangle.normal(third));
        Item { id, place: [position.x, position.y, position.z, normal.x, normal.y, normal.z] }
    }

    /// Adds a node for some triangles and all nodes below it: halves at the median of the longest axis.
    fn add_node(&mut self, items: &mut [Item]) -> Bounds {
        if let [item] = items {
            let triangle = &self.geometry.triangles[item.id as usize];
            let bounds = Bounds::of_part(triangle, &WHOLE, self.side(triangle));
            self.nodes.push(Node { bounds, content: Content::Triangle(item.id) });
            return bounds;
        }
        let extent = |axis: usize| {
            let values = items.iter().map(|i| i.place[axis]);
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            high - low
        };
        let axis = (0..6).max_by(|a, b| extent(*a).total_cmp(&extent(*b))).unwrap_or(0);
        let middle = items.len() / 2;
        items.select_nth_unstable_by(middle, |a, b| a.place[axis].total_cmp(&b.place[axis]));
        let place = self.nodes.len();
        self.nodes.push(Node { bounds: Bounds::BLANK, content: Content::Triangle(0) });
        let first = self.add_node(&mut items[..middle]);
        let second = self.nodes.len() as u32;
        let bounds = first.union(&self.add_node(&mut items[middle..]));
        self.nodes[place] = Node { bounds, content: Content::Inner { second } };
        bounds
    }

    fn side(&self, triangle: &Triangle) -> f64 {
        self.sides[triangle.object as usize].expect("only reflectors are in the tree")
    }
}

impl Bounds {
    const BLANK: Self = Self {
        centre: DVec3::ZERO,
        radius: 0.0,
        normals: Cone { axis: DVec3::Y, half_angle: 0.0 },
        area: 0.0,
        object: 0,
    };

    /// Of a part of a triangle whose normals are turned by `side`.
    pub fn of_part(triangle: &Triangle, part: &Part, side: f64) -> Self {
        let corners = part.map(|b| triangle.position(b));
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let radius = corners.iter().map(|c| c.distance_squared(centre)).fold(0.0, f64::max).sqrt();
        // Normals inside are positive combinations of those at the corners.
        let normals = Cone::around(&part.map(|b| side * triangle.normal(b)));
        let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        Self { centre, radius, normals, area, object: triangle.object }
    }

    fn union(&self, other: &Self) -> Self {
        let apart = self.centre.distance(other.centre);
        let (centre, radius) = if apart + other.radius <= self.radius {
            (self.centre, self.radius)
        } else if apart + self.radius <= other.radius {
            (other.centre, other.radius)
        } else {
            let radius = 0.5 * (self.radius + apart + other.radius);
            let towards = (other.centre - self.centre) / apart;
            (self.centre + towards * (radius - self.radius), radius * (1.0 + 1e-12))
        };
        let normals = self.normals.union(other.normals);
        Self { centre, radius, normals, area: self.area + other.area, object: self.object }
    }
}

//! Eight floats at a time, and vectors of them.

use std::ops::{Add, Mul, Sub};

use glam::Vec3;
use wide::f32x8;

/// Eight lanes.
pub(super) type F = f32x8;

/// Eight vectors, component by component.
#[derive(Clone, Copy)]
pub(super) struct V3(pub [F; 3]);

#[inline(always)]
pub(super) fn splat(value: f32) -> F {
    f32x8::splat(value)
}

#[inline(always)]
pub(super) fn splat3([x, y, z, _]: [f32; 4]) -> V3 {
    V3([x, y, z].map(splat))
}

#[inline(always)]
pub(super) fn vector(v: Vec3) -> V3 {
    V3(v.to_array().map(splat))
}

#[inline(always)]
pub(super) fn abs(x: F) -> F {
    x.abs()
}

#[inline(always)]
pub(super) fn clamp(x: F, low: F, high: F) -> F {
    x.max(low).min(high)
}

impl V3 {
    #[inline(always)]
    pub fn dot(self, other: Self) -> F {
        self.0[0] * other.0[0] + self.0[1] * other.0[1] + self.0[2] * other.0[2]
    }

    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([b * z - c * y, c * x - a * z, a * y - b * x])
    }
}

impl Add for V3 {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1], self.0[2] + other.0[2]])
    }
}

impl Sub for V3 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([self.0[0] - other.0[0], self.0[1] - other.0[1], self.0[2] - other.0[2]])
    }
}

impl Mul<F> for V3 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: F) -> Self {
        Self([self.0[0] * factor, self.0[1] * factor, self.0[2] * factor])
    }
}

//! Sixteen floats at a time, and vectors of them: one instruction with AVX-512, two with AVX2, four with SSE2 or NEON, chosen
//! at run time.
//!
//! Everything that takes a `Simd` must be inlined into the dispatched function, or it is compiled without the instructions:
//! mark functions and closures `#[inline(always)]`, and do not compute in closures given to `map` or `map_or`, which are no such
//! functions. What is called from several places and works for long is `#[inline(never)]` and calls [`Simd::vectorize`]: it is compiled
//! once for each instruction set. Without the attribute the compiler would take such a short function as one to inline, and compile what
//! it calls in each of its code generation units. `.ci/simd` finds what was missed in the machine code.

use std::ops::{Add, AddAssign, Mul, Sub};
use std::sync::OnceLock;

pub use fearless_simd::{Level, Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask};
use fearless_simd::{f32x16, mask32x16, u32x16};
use glam::Vec3;

/// Number of lanes: receivers and rays are processed in groups of this size.
pub const LANES: usize = 16;
/// All lanes.
pub const ALL: u32 = (1 << LANES) - 1;

/// Sixteen lanes.
pub type F<S> = f32x16<S>;
/// Sixteen integers.
pub type U<S> = u32x16<S>;
/// A Boolean in each lane.
pub(crate) type Mask<S> = mask32x16<S>;

/// Sixteen vectors, component by component.
#[derive(Clone, Copy)]
pub(crate) struct V3<S: Simd>(pub [F<S>; 3]);

/// Evaluates an expression with the instruction set of a [`Level`]: `dispatch!(level(), simd => sum(simd, …))`. It is compiled for
/// AVX-512, AVX2 and what every x86-64 processor has; SSE4.2 alone, of processors before 2013, is not worth its code.
#[cfg(target_arch = "x86_64")]
macro_rules! dispatch {
    ($level:expr, $simd:ident => $expression:expr) => {
        match $level {
            #[cfg(not(disable_dispatch_avx512))]
            $crate::lanes::Level::Avx512($simd) => $crate::lanes::vectorized!($simd => $expression),
            level => match level.as_avx2() {
                Some($simd) => $crate::lanes::vectorized!($simd => $expression),
                #[cfg(target_feature = "avx2")]
                None => unreachable!("every processor that runs this has AVX2"),
                #[cfg(not(target_feature = "avx2"))]
                None => {
                    let $simd = level.as_sse2().expect("every x86-64 processor has SSE2");
                    $crate::lanes::vectorized!($simd => $expression)
                }
            },
        }
    };
}
#[cfg(target_arch = "x86_64")]
macro_rules! vectorized {
    ($simd:ident => $expression:expr) => {
        $crate::lanes::Simd::vectorize(
            $simd,
            #[inline(always)]
            || $expression,
        )
    };
}
#[cfg(not(target_arch = "x86_64"))]
pub(crate) use fearless_simd::dispatch;
#[cfg(target_arch = "x86_64")]
pub(crate) use {dispatch, vectorized};

/// The instruction set of this processor.
pub fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(Level::new)
}

/// The same value in all lanes.
#[inline(always)]
pub fn splat<S: Simd>(simd: S, value: f32) -> F<S> {
    F::splat(simd, value)
}

#[inline(always)]
pub(crate) fn splat3<S: Simd>(simd: S, v: Vec3) -> V3<S> {
    V3([splat(simd, v.x), splat(simd, v.y), splat(simd, v.z)])
}

/// One value for each lane.
#[inline(always)]
pub fn lanes<S: Simd>(simd: S, values: [f32; LANES]) -> F<S> {
    F::load_array(simd, values)
}

/// One bit for each lane.
#[inline(always)]
pub fn bits<S: Simd>(mask: Mask<S>) -> u32 {
    mask.to_bitmask() as u32
}

/// Clamps each lane to a range.
#[inline(always)]
pub fn clamp<S: Simd>(x: F<S>, low: f32, high: impl fearless_simd::SimdInto<F<S>, S>) -> F<S> {
    x.max(low).min(high)
}

/// The lanes whose bits are set. Branching in every lane instead would often be mispredicted.
#[inline(always)]
pub fn set_bits(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = (bits != 0).then(|| bits.trailing_zeros() as usize & (LANES - 1));
        bits &= bits.wrapping_sub(1);
        lane
    })
}

/// log₂ of positive numbers, within 2e-5.
#[inline(always)]
pub fn log2<S: Simd>(x: F<S>) -> F<S> {
    let bits: u32x16<S> = x.to_bits();
    let exponent: F<S> = ((bits >> 23).to_float::<F<S>>()) - 127.0;
    let mantissa = F::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let t2 = t * t;
    // 2/ln 2 · artanh.
    let series = ((t2 * (2.885_39 / 7.0) + 2.885_39 / 5.0) * t2 + 2.885_39 / 3.0) * t2 + 2.885_39;
    exponent + t * series
}

impl<S: Simd> V3<S> {
    #[inline(always)]
    pub fn load(simd: S, [x, y, z]: &[[f32; LANES]; 3]) -> Self {
        Self([lanes(simd, *x), lanes(simd, *y), lanes(simd, *z)])
    }

    /// Selects lane by lane.
    #[inline(always)]
    pub fn select(mask: Mask<S>, if_set: Self, otherwise: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (if_set.0, otherwise.0);
        Self([mask.select(a, x), mask.select(b, y), mask.select(c, z)])
    }

    #[inline(always)]
    pub fn dot(self, other: Self) -> F<S> {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        a.mul_add(x, b.mul_add(y, c * z))
    }

    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([b * z - c * y, c * x - a * z, a * y - b * x])
    }

    /// self + other · factor.
    #[inline(always)]
    pub fn plus(self, other: Self, factor: F<S>) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([x.mul_add(factor, a), y.mul_add(factor, b), z.mul_add(factor, c)])
    }

    #[inline(always)]
    pub fn to_arrays(self) -> [[f32; LANES]; 3] {
        let [x, y, z] = self.0;
        [x.to_array(), y.to_array(), z.to_array()]
    }
}

impl<S: Simd> Add for V3<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a + x, b + y, c + z])
    }
}

impl<S: Simd> AddAssign for V3<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Simd> Sub for V3<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a - x, b - y, c - z])
    }
}

impl<S: Simd> Mul<F<S>> for V3<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: F<S>) -> Self {
        let [x, y, z] = self.0;
        Self([x * factor, y * factor, z * factor])
    }
}

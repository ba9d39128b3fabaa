//! The difference between the caustic and the ground truth: a thread computes both for a small picture, the latter better and better. Knows
//! nothing of the window, which it only wakes.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::time::Instant;

use glam::Vec3;

use super::stopwatch::Stopwatch;
use crate::blocking::wait;
use crate::image::{Aov, Image};
use crate::reference::{self, Estimate, Reference, StoppingCriterion};
use crate::scene::Scene;
use crate::{Backend, Engine, Error};
use pinspot_render::options::{FilterChoice, Options};

/// Longest edge of the pictures that are compared, pixels.
const SIZE: u32 = 128;
/// The relative standard error at which the ground truth is good enough.
const GOAL: f64 = 0.003;
/// The difference that is shown brightest, in typical irradiances.
const BRIGHTEST: f32 = 0.5;

/// A difference.
#[derive(Clone, Debug)]
pub struct Difference {
    /// The number of the radiance that it belongs to: that of the first view that shows it.
    pub view: u64,
    /// A heat map, display-linear: from black (none) by red and yellow to white (half of the typical irradiance, or more).
    pub heat: Image,
    /// √Σ(E − R)² / √ΣR².
    pub rel_l2: f64,
    /// The standard error of R, relative in the same way: smaller differences are not known to be there.
    pub uncertainty: f64,
    pub seconds: f64,
    /// It becomes no better.
    pub is_final: bool,
}

/// The comparison at hand, from the window's side. It ends when it is dropped.
pub struct Comparison {
    is_over: Arc<AtomicBool>,
    found: Receiver<Result<Difference, String>>,
    /// The last finding was told.
    has_ended: Cell<bool>,
}

impl Comparison {
    /// Compares a posed scene's caustic. `wake` is called whenever something is found.
    pub fn start(view: u64, scene: Scene, options: &Options, wake: impl Fn() + Send + 'static) -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        let (sender, found) = channel();
        let size = options.size_within(SIZE);
        let options = options.clone().with_size(size).with_pixel_samples(1).with_aovs(vec![Aov::Caustic]);
        // The CPU compares, so that a GPU has its time for pictures.
        let is_of_gpus = options.filter == FilterChoice::Hardware;
        let options = if is_of_gpus { options.with_filter(FilterChoice::Anisotropic) } else { options };
        let comparer = Comparer { view, began: Instant::now(), is_over: is_over.clone(), sender, wake: Box::new(wake) };
        std::thread::spawn(move || match comparer.compare(scene, options) {
            Ok(()) | Err(Error::Cancelled) => {}
            Err(error) => comparer.tell(Err(error.to_string())),
        });
        Self { is_over, found, has_ended: Cell::new(false) }
    }

    /// The latest finding, if there is a new one.
    pub fn found(&self) -> Option<Result<Difference, String>> {
        let mut latest = None;
        loop {
            match self.found.try_recv() {
                Ok(found) => {
                    self.has_ended.set(found.as_ref().map_or(true, |difference| difference.is_final));
                    latest = Some(found);
                }
                Err(TryRecvError::Disconnected) if !self.has_ended.replace(true) => {
                    return Some(Err("a defect of Pinspot ended the comparison; please report it".to_owned()));
                }
                Err(_) => return latest,
            }
        }
    }
}

impl Drop for Comparison {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

struct Comparer {
    view: u64,
    began: Instant,
    is_over: Arc<AtomicBool>,
    sender: Sender<Result<Difference, String>>,
    wake: Box<dyn Fn() + Send>,
}

impl Comparer {
    fn compare(&self, scene: Scene, options: Options) -> Result<(), Error> {
        let asked = reference::Options {
            size: options.size,
            chains: options.technique.chains(&scene),
            visibility: options.visibility,
            attenuation: options.attenuation,
            ..reference::Options::default()
        };
        let reference = Reference::new(scene.clone(), asked)?;
        let watch = Stopwatch::new(Some(&self.is_over));
        let rendered = wait(None, Engine::new(scene, options, Backend::cpu()).render(&watch))?;
        let caustic = &rendered.layers[0].1;
        let flag = &*self.is_over;
        let is_over = || flag.load(Ordering::Relaxed);
        let goal = StoppingCriterion::new(GOAL).with_should_stop(&is_over);
        let show = |truth: &Estimate, is_final: bool| {
            if truth.check().is_ok() {
                self.tell(Ok(self.difference(caustic, truth, is_final)));
            }
        };
        let truth = reference.solve(&goal, None, &watch, &mut |truth| {
            show(truth, false);
            Ok(())
        })?;
        show(&truth, true);
        Ok(())
    }

    fn difference(&self, caustic: &Image, truth: &Estimate, is_final: bool) -> Difference {
        let pairs = || caustic.pixels.iter().zip(&truth.irradiance.pixels);
        let squares = |values: &mut dyn Iterator<Item = Vec3>| -> f64 {
            values.map(|value| f64::from(value.length_squared())).sum::<f64>().sqrt()
        };
        let whole = squares(&mut truth.irradiance.pixels.iter().copied()).max(f64::MIN_POSITIVE);
        let typical = typical_irradiance(&truth.irradiance).max(f32::MIN_POSITIVE);
        let heat = pairs().map(|(a, b)| heat((*a - *b).abs().element_sum() / typical)).collect();
        Difference {
            view: self.view,
            heat: Image { width: caustic.width, height: caustic.height, pixels: heat },
            rel_l2: squares(&mut pairs().map(|(a, b)| *a - *b)) / whole,
            uncertainty: truth.rel_error(),
            seconds: self.began.elapsed().as_secs_f64(),
            is_final,
        }
    }

    fn tell(&self, found: Result<Difference, String>) {
        // Nobody listens to what is outdated.
        let _ = self.sender.send(found);
        (self.wake)();
    }
}

/// The mean over the irradiance itself, so that a small caustic in a dark picture counts, and not the darkness.
fn typical_irradiance(image: &Image) -> f32 {
    let sums = image.pixels.iter().map(|pixel| f64::from(pixel.element_sum()));
    let (sum, squares) = sums.fold((0.0, 0.0), |(sum, squares), value| (sum + value, squares + value * value));
    if sum > 0.0 { (squares / sum) as f32 } else { 0.0 }
}

/// The colour of a difference, in typical irradiances; display-linear.
fn heat(difference: f32) -> Vec3 {
    const STOPS: [Vec3; 5] =
        [Vec3::ZERO, Vec3::new(0.2, 0.0, 0.25), Vec3::new(0.8, 0.05, 0.02), Vec3::new(1.0, 0.6, 0.02), Vec3::ONE];
    // Small differences are told apart, too.
    let place = (difference / BRIGHTEST).clamp(0.0, 1.0).sqrt() * (STOPS.len() - 1) as f32;
    let first = (place as usize).min(STOPS.len() - 2);
    STOPS[first].lerp(STOPS[first + 1], place - first as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn larger_differences_are_brighter() {
        let brightness = |difference: f32| heat(difference).element_sum();
        assert!((0..100).all(|k| brightness(0.01 * k as f32) <= brightness(0.01 * (k + 1) as f32)));
        assert_eq!((heat(0.0), heat(9.0)), (Vec3::ZERO, Vec3::ONE));
    }

    #[test]
    fn darkness_does_not_count_as_typical() {
        let pixels = (0..100).map(|k| if k < 10 { Vec3::ONE } else { Vec3::ZERO }).collect();
        assert_eq!(typical_irradiance(&Image { width: 10, height: 10, pixels }), 3.0);
        assert_eq!(typical_irradiance(&Image::new(4, 4)), 0.0);
    }

    /// The reference becomes better and better, and the caustic differs little from it.
    #[test]
    fn a_caustic_is_compared_with_the_truth() {
        let (scene, options) = crate::load("ring-above").unwrap();
        let options = options.with_size([40, 40]).with_samples(1000);
        let comparison = Comparison::start(7, scene, &options, || ());
        let began = Instant::now();
        let mut last: Option<Difference> = None;
        while last.as_ref().is_none_or(|difference| difference.uncertainty > 0.02) {
            assert!(began.elapsed() < Duration::from_mins(2), "{last:?}");
            last = comparison.found().map(|found| found.unwrap()).or(last);
            std::thread::sleep(Duration::from_millis(20));
        }
        let last = last.unwrap();
        assert!(last.view == 7 && last.rel_l2 < 0.15, "{}", last.rel_l2);
        assert_eq!(last.heat.pixels.len(), 1600);
    }
}

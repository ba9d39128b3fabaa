//! The steps in which a picture is refined: a draft, then the view's own settings, on both sides of a comparison in turn.

use super::{Quality, Side, View};
use pinspot_render::options::Options;

/// What is left to refine.
#[derive(Debug, Default)]
pub struct Refinement {
    steps: Vec<RefinementStep>,
    done: usize,
}

/// A picture that is to be rendered.
#[derive(Debug)]
pub struct RefinementStep {
    pub view: u64,
    pub side: Side,
    pub options: Options,
    pub quality: Quality,
}

impl Refinement {
    /// All steps of a view; none while it moves.
    pub fn new(view: &View) -> Self {
        if view.is_playing {
            return Self::default();
        }
        let sides = [(Side::Current, Some(&view.options)), (Side::Kept, view.kept.as_ref())];
        let steps_of = |(side, options): (Side, Option<&Options>)| {
            let Some(options) = options else { return Vec::new() };
            let draft = options.coarse_to_fine().into_iter().nth(1).filter(|draft| draft.samples < options.samples);
            let draft = draft.map(|draft| draft.with_pixel_samples(1));
            let all: Vec<Options> = draft.into_iter().chain([options.clone()]).collect();
            let count = all.len();
            let step = |(index, options)| RefinementStep {
                view: view.number,
                side,
                options,
                quality: Quality::Refined(index + 1, count),
            };
            all.into_iter().enumerate().map(step).collect()
        };
        let mut steps: Vec<RefinementStep> = sides.into_iter().flat_map(steps_of).collect();
        // Drafts of both sides come first; the order is stable.
        steps.sort_by_key(|step| matches!(step.quality, Quality::Refined(index, count) if index == count));
        Self { steps, done: 0 }
    }

    /// The next step.
    pub fn next(&self) -> Option<&RefinementStep> {
        self.steps.get(self.done)
    }

    /// The next step is done.
    pub fn advance(&mut self) {
        self.done += 1;
    }

    /// The steps that are left belong to another view, which differs in the display alone.
    pub fn show(&mut self, view: &View) {
        for step in &mut self.steps {
            let of_side = if step.side == Side::Current { Some(&view.options) } else { view.kept.as_ref() };
            let Some(options) = of_side else { continue };
            step.view = view.number;
            (step.options.display, step.options.overlay) = (options.display, options.overlay);
        }
    }
}

//! The thread that takes apart what lies under the pointer while the scene rests. It has an engine of its own, which keeps the samples. It
//! knows nothing of the window, which it only wakes.

use std::sync::mpsc::{Receiver, Sender, channel};

use glam::Vec2;

use crate::image::Image;
use crate::scene::Scene;
use crate::{Backend, Engine, Inspection, NoProgress, TakenCell};
use pinspot_render::options::Options;

/// Rows of the environment's map.
const MAP_HEIGHT: u32 = 160;

/// What is to be looked at.
pub struct Question {
    /// Posed.
    pub scene: Scene,
    pub options: Options,
    /// As fractions of the picture's width and height.
    pub place: Vec2,
    /// The number of the view; its environment is drawn once.
    pub view: u64,
    /// The cells that the sum takes are wanted, too.
    pub with_cells: bool,
}

/// What was found.
pub struct Answer {
    /// The view that was asked about.
    pub view: u64,
    /// The environment, if it may have changed; display-linear.
    pub map: Option<Image>,
    pub found: Result<Option<Inspection>, String>,
    /// Cells that the sum takes for a receiver there; `None` if it is flat.
    pub cells: Option<Vec<TakenCell>>,
}

/// The thread, from the window's side. It ends with it.
pub struct Inspector {
    questions: Sender<Question>,
    answers: Receiver<Answer>,
}

impl Inspector {
    /// `wake` is called whenever there is an answer.
    pub fn start(wake: impl Fn() + Send + 'static) -> Self {
        let (questions, asked) = channel::<Question>();
        let (sender, answers) = channel();
        std::thread::spawn(move || {
            let mut state = None;
            while let Ok(question) = asked.recv() {
                // The pointer has moved on since.
                let question = asked.try_iter().last().unwrap_or(question);
                if sender.send(answer(question, &mut state)).is_err() {
                    return;
                }
                wake();
            }
        });
        Self { questions, answers }
    }

    /// Asks for something else than before. Returns whether the thread listens: a defect may have ended it.
    pub fn ask(&self, question: Question) -> bool {
        self.questions.send(question).is_ok()
    }

    /// The latest answer, if there is a new one.
    pub fn answer(&self) -> Option<Answer> {
        self.answers.try_iter().reduce(|earlier, later| Answer { map: later.map.or(earlier.map), ..later })
    }
}

fn answer(question: Question, state: &mut Option<(Engine, u64)>) -> Answer {
    let Question { scene, options, place, view, with_cells } = question;
    let is_known = state.as_ref().is_some_and(|(_, known)| *known == view);
    let (engine, known) =
        state.get_or_insert_with(|| (Engine::new(scene.clone(), options.clone(), Backend::cpu()), view));
    if !is_known {
        (*engine.scene_mut(), *engine.options_mut(), *known) = (scene, options, view);
    }
    let map = if is_known { None } else { engine.environment_map(MAP_HEIGHT, &NoProgress).ok() };
    let found = engine.inspect(place, &NoProgress);
    let cells = if with_cells { engine.cells_taken(place, &NoProgress) } else { Ok(Some(Vec::new())) };
    let (found, cells) = match (found, cells) {
        (Ok(found), Ok(cells)) => (Ok(found), cells),
        (Err(error), _) | (_, Err(error)) => (Err(error.to_string()), None),
    };
    Answer { view: *known, map, found, cells }
}

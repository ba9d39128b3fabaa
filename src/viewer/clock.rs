//! The time of the animation.

use std::time::Instant;

/// Where the animation is, and whether it goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// Seconds since its beginning.
    pub seconds: f32,
    pub is_playing: bool,
    /// Seconds of the animation per second.
    pub speed: f32,
    /// When it was advanced last, while it plays.
    advanced: Option<Instant>,
}

/// After a pause longer than this, seconds, time does not catch up: the window was hidden or busy.
const MAX_STEP: f32 = 0.5;

impl Default for Clock {
    fn default() -> Self {
        Self { seconds: 0.0, is_playing: false, speed: 1.0, advanced: None }
    }
}

impl Clock {
    /// Goes on to a moment; at the end of the animation it begins again. Returns whether time went on.
    pub fn advance(&mut self, now: Instant, duration: f32) -> bool {
        if !self.is_playing || duration <= 0.0 {
            self.advanced = None;
            return false;
        }
        let last = self.advanced.replace(now);
        let step = last.map_or(0.0, |last| now.duration_since(last).as_secs_f32().min(MAX_STEP));
        self.seconds = (self.seconds + self.speed * step).rem_euclid(duration);
        true
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn time_goes_round() {
        let mut clock = Clock { seconds: 3.9, is_playing: true, speed: 2.0, advanced: None };
        let start = Instant::now();
        let after = |seconds: f32| start + Duration::from_secs_f32(seconds);
        assert!(clock.advance(start, 4.0) && clock.seconds == 3.9);
        assert!(clock.advance(after(0.1), 4.0) && (clock.seconds - 0.1).abs() < 1e-4);
        assert!(clock.advance(after(60.0), 4.0) && (clock.seconds - 1.1).abs() < 1e-4);
        clock.speed = -1.0;
        assert!(clock.advance(after(60.2), 4.0) && (clock.seconds - 0.9).abs() < 1e-4);
        assert!(!clock.advance(after(60.3), 0.0), "nothing moves");
        clock.is_playing = false;
        assert!(!clock.advance(after(60.4), 4.0));
    }
}

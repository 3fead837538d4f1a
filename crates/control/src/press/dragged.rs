//! A drag after the last level: the forces are read on all axes before it and after it, and z stays where it is.

use super::ForceLoop;
use super::dialogue::LoopCommand;
use super::state::{PressState, TELL_SIGMAS};
use crate::drag::{Drag, DragContext, check_direction, least_after_n};
use crate::trip::{SafetyRule, Trip};

/// Progress of a drag.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum DragProgress {
    /// It hasn't begun.
    #[default]
    Ahead,
    /// It is under way; forces along x and y before it, N.
    From([f64; 2]),
    /// The tip rests again; forces before it, N, and the way that it went, mm.
    Went([f64; 2], [f64; 2]),
    /// It has ended.
    Over,
}

impl ForceLoop {
    /// Returns the drag that remains to be done.
    pub(super) fn drag_ahead(&self) -> Option<Drag> {
        self.task.drag().filter(|_| self.in_contact && self.dragged == DragProgress::Ahead)
    }

    /// Reads all axes at rest.
    pub(super) fn average_axes(&mut self, state: PressState) -> Result<LoopCommand, Trip> {
        let readings = self.readings();
        self.sigma_n = self.context.zero.sigma_mean_n(readings);
        self.go(state, LoopCommand::AverageAxes(readings))
    }

    /// Begins the drag.
    pub(super) fn brace(&mut self, force_n: f64, side_n: Option<[f64; 2]>) -> Result<LoopCommand, Trip> {
        self.check_fall(force_n)?;
        self.force_n = force_n;
        let (drag, side_n) = (self.task.drag().ok_or_else(unasked)?, side_n.ok_or_else(unasked)?);
        let context = DragContext {
            force_n,
            peak_n: self.peak_n,
            sigma_n: self.sigma_n,
            side_n,
            side_sigma_n: self.side_sigma_n(),
            age_s: self.moment.age_s,
            depth_mm: self.z_mm - self.first_mm,
        };
        let granted = self.context.permit.drag(&context, &drag)?;
        self.dragged = DragProgress::From(side_n);
        self.rested = None;
        self.go(PressState::Dragging, LoopCommand::Drag(granted))
    }

    /// Takes the way that the tip went, mm.
    pub(super) fn drag_went(&mut self, way: [f64; 2]) -> Result<LoopCommand, Trip> {
        if let DragProgress::From(before_n) = self.dragged {
            self.dragged = DragProgress::Went(before_n, way);
        }
        self.average_axes(PressState::Dragged)
    }

    /// Ends the drag: the force sideways must have followed it.
    pub(super) fn drag_ended(&mut self, force_n: f64, side_n: Option<[f64; 2]>) -> Result<LoopCommand, Trip> {
        let after_n = side_n.ok_or_else(unasked)?;
        if let DragProgress::Went(before_n, way) = self.dragged {
            check_direction(way, before_n, after_n, self.side_sigma_n())?;
            let way_mm = way[0].hypot(way[1]);
            let least_n = least_after_n(self.force_n, &self.context.limits, way_mm) - TELL_SIGMAS * self.sigma_n;
            if force_n < least_n {
                return Err(Trip::new(SafetyRule::Fallen, force_n, least_n, "N"));
            }
        }
        self.force_n = force_n;
        self.dragged = DragProgress::Over;
        self.sample()
    }

    /// Standard deviation of a mean along x or y, N.
    fn side_sigma_n(&self) -> f64 {
        let sigma_n = self.context.zero.side.map_or(0.0, |side| side.sigma_most_n());
        sigma_n / f64::from(self.readings().max(1)).sqrt()
    }
}

/// Returns the trip of a drag that no recipe asks for, or on a cell with one axis. The plan refuses both.
fn unasked() -> Trip {
    Trip::new(SafetyRule::NotPermitted, 0.0, 0.0, "axes for a drag")
}

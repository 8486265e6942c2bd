//! Which states of load steps are frames.

use piola_output::{OutputError, table};
use piola_solvers::steps::{Control, Drive as _};

use super::{Recorder, SceneDrive};
use crate::scene::Scene;
use crate::simulation::breaking;

/// Whether the end of this increment, from 1, is a frame: they are spread evenly over the increments.
pub(in crate::simulation) fn is_due(scene: &Scene, increment: usize) -> bool {
    let (frames, all) = (scene.output.frames, scene.steps.increments);
    let due = |step: usize| step * frames.min(all) / all;
    due(increment) > due(increment - 1)
}

impl Recorder<'_> {
    /// Writes the tables of the steps so far, and a frame where one is due.
    pub(super) fn write_step(&mut self, nominal: bool) -> Result<(), OutputError> {
        let scene = &self.fields.case.scene;
        if scene.steps.control != Control::Load {
            // Between nominal times t comes and goes: every so many steps there is a frame, too.
            let is_due = nominal || breaking::has_frame(scene, self.history.steps.len());
            if is_due && scene.output.frames > 0 {
                self.push_frame()?;
            }
        } else if nominal {
            self.nominal += 1;
            if is_due(scene, self.nominal) {
                self.push_frame()?;
            }
        }
        table::write_history(self.folder, &self.history)
    }

    /// Writes the last state as a frame.
    fn push_frame(&mut self) -> Result<(), OutputError> {
        self.fields.fill(&mut self.last);
        self.framed = self.history.steps.len();
        self.frames.push(&self.last)
    }

    /// A run may end anywhere, cut through or where nothing more is found: its last state is a frame in any
    /// case, where frames are wanted.
    pub(super) fn write_last_frame(&mut self) -> Result<(), OutputError> {
        let is_written = self.framed == self.history.steps.len();
        match !is_written && self.fields.case.scene.output.frames > 0 {
            true => self.push_frame(),
            false => Ok(()),
        }
    }

    /// Gives the energy what it takes of the time of the last state: later times were tried behind it.
    pub(super) fn return_to_last(&self, drive: &SceneDrive<'_>) {
        if let Some(step) = self.history.steps.last() {
            // It could be given it when that step was found.
            let _ = drive.begin(step.t);
        }
    }
}

//! What came of some trials, added up.

use std::fmt::{self, Display, Formatter};
use std::ops::AddAssign;

/// What came of some trials.
#[derive(Default)]
pub(super) struct KillTally {
    pub trials: usize,
    pub kills: usize,
    /// Kills before there was a folder, and what they left beside its place.
    pub early: usize,
    pub drafts: usize,
    /// Presses that were in the journal when their program was killed and that it hadn't told of.
    pub unacknowledged: usize,
    /// Presses that were acknowledged before the last session.
    pub acknowledged: usize,
    /// Rows that were acknowledged: not there, there with other values, made again.
    pub lost: usize,
    pub changed: usize,
    pub again: usize,
    /// Rows that a run without an end before its time would have measured otherwise, where the specimen has no memory.
    pub other: usize,
    pub first: Option<String>,
}

impl KillTally {
    pub(super) fn assert_clean(&self) {
        assert_eq!((self.lost, self.changed, self.again, self.other), (0, 0, 0, 0), "{self}; {:?}", self.first);
    }
}

impl AddAssign for KillTally {
    fn add_assign(&mut self, more: KillTally) {
        for (sum, part) in [
            (&mut self.trials, more.trials),
            (&mut self.kills, more.kills),
            (&mut self.early, more.early),
            (&mut self.drafts, more.drafts),
            (&mut self.unacknowledged, more.unacknowledged),
            (&mut self.acknowledged, more.acknowledged),
            (&mut self.lost, more.lost),
            (&mut self.changed, more.changed),
            (&mut self.again, more.again),
            (&mut self.other, more.other),
        ] {
            *sum += part;
        }
        self.first = self.first.take().or(more.first);
    }
}

impl Display for KillTally {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let KillTally {
            trials, kills, early, drafts, unacknowledged, acknowledged, lost, changed, again, other, ..
        } = self;
        write!(f, "{kills} kills in {trials} trials, {early} before there was a folder ({drafts} drafts left); ")?;
        write!(f, "{acknowledged} presses acknowledged, {unacknowledged} kept that were not; rows: {lost} lost, ")?;
        write!(f, "{changed} changed, {again} made again, {other} not as in a run that nothing interrupts")
    }
}

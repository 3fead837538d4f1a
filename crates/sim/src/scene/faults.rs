//! Faults that begin at a set time, for rehearsals and tests.

/// A fault that begins at a set time, for rehearsals and tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneFault {
    /// Kind of the fault.
    pub kind: FaultKind,
    /// Start of the fault, s since the rig was opened.
    pub from_s: f64,
    /// Size of the fault; `None`: [`FaultKind::usual`].
    pub value: Option<f64>,
}

/// Kinds of faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The load cell repeats its last reading forever.
    Stuck,
    /// The load cell reads only its offset and its noise, and no force.
    NoSensor,
    /// The load cell reads pushes as pulls.
    WrongSign,
    /// The load cell reads at most the value, N.
    Saturated,
    /// In the contact under way, or the next one, the true force drops to 35 % until the tip leaves the specimen. This happens
    /// once.
    Slip,
    /// From the next contact on, the specimen is a linear spring of the value, N/mm, without relaxation.
    HardContact,
    /// The specimen is gone, so there is no force any more.
    NoContact,
    /// The load cell's link is silent: requests are not answered.
    Stale,
    /// The stage's link is silent: requests are neither acted on nor answered.
    StageLost,
    /// The array's link is silent, as if it were unplugged: for the value, s, or for ever without one.
    ArrayLost,
    /// The array's outputs are multiplied by the value.
    ScaledOutputs,
    /// Each exchange of the stage takes longer by the value, ms.
    SlowStage,
    /// The load cell's noise is multiplied by the value.
    Noisy,
    /// The load cell's reading is higher by the value, N.
    DriftedZero,
    /// The load cell's count rolls over: above the value, N, it reads lower by twice the value.
    RollsOver,
    /// The load cell's amplifier loses gain: the whole reading is multiplied by the value, its zero included.
    LostGain,
    /// The specimen is nearer to the indenter by the value, mm. Rig files don't have this kind.
    Risen,
}

impl FaultKind {
    /// All kinds that a rig file can have, with their names there.
    pub const ALL: [(&str, FaultKind); 16] = [
        ("stuck", FaultKind::Stuck),
        ("no-sensor", FaultKind::NoSensor),
        ("wrong-sign", FaultKind::WrongSign),
        ("saturated", FaultKind::Saturated),
        ("slip", FaultKind::Slip),
        ("hard-contact", FaultKind::HardContact),
        ("no-contact", FaultKind::NoContact),
        ("stale", FaultKind::Stale),
        ("stage-lost", FaultKind::StageLost),
        ("array-lost", FaultKind::ArrayLost),
        ("scaled-outputs", FaultKind::ScaledOutputs),
        ("slow-stage", FaultKind::SlowStage),
        ("noisy", FaultKind::Noisy),
        ("drifted-zero", FaultKind::DriftedZero),
        ("rolls-over", FaultKind::RollsOver),
        ("lost-gain", FaultKind::LostGain),
    ];

    /// Returns the default value of a kind: 0.8 N, 20 N/mm, 200 ms, 2 or 10 times, -0.5 N or half; `None` for a kind without a value.
    pub fn usual(self) -> Option<f64> {
        match self {
            FaultKind::Saturated | FaultKind::RollsOver => Some(0.8),
            FaultKind::HardContact => Some(20.0),
            FaultKind::SlowStage => Some(200.0),
            FaultKind::ScaledOutputs => Some(2.0),
            FaultKind::Noisy => Some(10.0),
            FaultKind::DriftedZero => Some(-0.5),
            FaultKind::LostGain => Some(0.5),
            _ => None,
        }
    }
}

/// The faults of a scene.
#[derive(Clone)]
pub(super) struct SceneFaults(Vec<SceneFault>);

impl SceneFaults {
    pub(super) fn new(faults: Vec<SceneFault>) -> Self {
        SceneFaults(faults)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the values of a kind's faults that have begun by now.
    pub(super) fn values(&self, kind: FaultKind, now_s: f64) -> impl Iterator<Item = f64> {
        let by_now = self.0.iter().filter(move |fault| fault.kind == kind && fault.from_s <= now_s);
        by_now.map(move |fault| fault.value.or(kind.usual()).unwrap_or(0.0))
    }

    /// Whether a fault of a kind has begun by now.
    pub(super) fn any(&self, kind: FaultKind, now_s: f64) -> bool {
        self.values(kind, now_s).next().is_some()
    }

    /// Whether the array's link is silent now.
    pub(super) fn silences_array(&self, now_s: f64) -> bool {
        let until_s = |fault: &SceneFault| fault.from_s + fault.value.unwrap_or(f64::INFINITY);
        self.0.iter().any(|fault| fault.kind == FaultKind::ArrayLost && (fault.from_s..until_s(fault)).contains(&now_s))
    }

    /// Returns the kinds that begin after `after_s` and not later than `now_s`.
    pub(super) fn beginning(&self, after_s: f64, now_s: f64) -> impl Iterator<Item = FaultKind> {
        self.0.iter().filter(move |fault| fault.from_s > after_s && fault.from_s <= now_s).map(|fault| fault.kind)
    }

    /// Start of the next fault after `now_s`, s; infinite if there is no further fault.
    pub(super) fn next_s(&self, now_s: f64) -> f64 {
        self.0.iter().map(|fault| fault.from_s).filter(|&from_s| from_s > now_s).fold(f64::INFINITY, f64::min)
    }
}

//! What goes wrong at a moment, for rehearsals and tests.

/// Something that goes wrong at a moment, for rehearsals and tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// What goes wrong.
    pub kind: FaultKind,
    /// From when on, s since the rig was opened.
    pub from_s: f64,
    /// How much of it; none: [`FaultKind::usual`].
    pub value: Option<f64>,
}

/// What can go wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The load cell gives its last reading for ever.
    Stuck,
    /// The load cell reads its offset and its noise, and no force.
    NoSensor,
    /// The load cell reads pushes as pulls.
    WrongSign,
    /// The load cell reads no more than the value, N.
    Saturated,
    /// In the contact under way, or the next one, the true force drops to 35 % until the tip leaves the specimen; once.
    Slip,
    /// From the next contact to begin on, the specimen is a linear spring of the value, N/mm, that doesn't relax.
    HardContact,
    /// The specimen is gone: there is no force any more.
    NoContact,
    /// The load cell's link is silent: requests are not answered.
    Stale,
    /// The stage's link is silent: requests are neither acted on nor answered.
    StageLost,
    /// The stage takes the value longer over each exchange, ms.
    SlowStage,
    /// The load cell's noise is the value times as large.
    Noisy,
    /// The load cell reads the value more, N.
    DriftedZero,
}

impl FaultKind {
    /// All kinds, as they are named in a rig file.
    pub const ALL: [(&str, FaultKind); 12] = [
        ("stuck", FaultKind::Stuck),
        ("no-sensor", FaultKind::NoSensor),
        ("wrong-sign", FaultKind::WrongSign),
        ("saturated", FaultKind::Saturated),
        ("slip", FaultKind::Slip),
        ("hard-contact", FaultKind::HardContact),
        ("no-contact", FaultKind::NoContact),
        ("stale", FaultKind::Stale),
        ("stage-lost", FaultKind::StageLost),
        ("slow-stage", FaultKind::SlowStage),
        ("noisy", FaultKind::Noisy),
        ("drifted-zero", FaultKind::DriftedZero),
    ];

    /// The value of one that has no other: 0.8 N, 20 N/mm, 200 ms, 10 times or -0.5 N; none where it takes none.
    pub fn usual(self) -> Option<f64> {
        match self {
            FaultKind::Saturated => Some(0.8),
            FaultKind::HardContact => Some(20.0),
            FaultKind::SlowStage => Some(200.0),
            FaultKind::Noisy => Some(10.0),
            FaultKind::DriftedZero => Some(-0.5),
            _ => None,
        }
    }
}

/// The faults of a scene.
#[derive(Clone)]
pub(super) struct Faults(Vec<Fault>);

impl Faults {
    pub fn new(faults: Vec<Fault>) -> Self {
        Faults(faults)
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The values of a kind's faults that there are by now.
    pub fn values(&self, kind: FaultKind, now_s: f64) -> impl Iterator<Item = f64> {
        let by_now = self.0.iter().filter(move |fault| fault.kind == kind && fault.from_s <= now_s);
        by_now.map(move |fault| fault.value.or(kind.usual()).unwrap_or(0.0))
    }

    /// Whether there is one of a kind by now.
    pub fn any(&self, kind: FaultKind, now_s: f64) -> bool {
        self.values(kind, now_s).next().is_some()
    }

    /// The kinds that begin after `after_s` and by `now_s`.
    pub fn beginning(&self, after_s: f64, now_s: f64) -> impl Iterator<Item = FaultKind> {
        self.0.iter().filter(move |fault| fault.from_s > after_s && fault.from_s <= now_s).map(|fault| fault.kind)
    }

    /// When the next one begins after `now_s`, s; infinite: none does.
    pub fn next_s(&self, now_s: f64) -> f64 {
        self.0.iter().map(|fault| fault.from_s).filter(|&from_s| from_s > now_s).fold(f64::INFINITY, f64::min)
    }
}
